"""The studies: what is perturbed, by how much, and what simulator and mapper make of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from eventsweep.emvs.errors import InputError

METHODS = (
    "Alg1/H", "Alg1/min", "Alg1/A", "Alg2/AtHc@4", "EMVS/cam0", "Focus/H", "Learned/H",
)  # fmt: skip
"""What is compared by default, as far as there is a method of the name: `default_methods`."""
CASES = ("boxes", "desk", "planes")
SEEDS = (0, 1, 2)
SECONDS = 0.5
MARGIN_S = 0.05
"""The window keeps clear of both ends of the sequence: late clocks find events and poses."""


@dataclass(frozen=True)
class Change:
    """What one amount of a study changes; each part is plain JSON values.

    Attributes:
        sim: fields of `SimConfig`.
        scene: `baseline_m`, `heading_deg` or `light`, see `eval.studies.stages.simulate`.
        perturb: fields of `Perturbation`.
        map: fields of `MapperConfig`; the window stays about the middle, where the truth is.
    """

    sim: Mapping[str, Any] = field(default_factory=dict)
    scene: Mapping[str, float] = field(default_factory=dict)
    perturb: Mapping[str, float] = field(default_factory=dict)
    map: Mapping[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Study:
    """One thing that is perturbed by growing amounts, from the one that perturbs nothing onwards.

    Attributes:
        axis: what grows, for the figure.
        logarithmic: whether amounts are spaced by factors.
    """

    name: str
    axis: str
    unit: str
    amounts: tuple[float, ...]
    change: Callable[[float], Change]
    logarithmic: bool = False


def _perturb(**per_unit: float) -> Callable[[float], Change]:
    return lambda amount: Change(perturb={key: v * amount for key, v in per_unit.items()})


def _thresholds(value: float) -> Change:
    return Change(sim={"contrast_threshold_pos": value, "contrast_threshold_neg": value})


def _shot_noise(rate_hz: float) -> Change:
    rates = {"shot_rate_dark_hz": rate_hz, "shot_rate_bright_hz": rate_hz}
    return Change(sim={"sensor": rates})


def _light(share: float) -> Change:
    sim = {"sensor": {"preset": "davis346"}, "log_eps": 1e-3}
    return Change(sim=sim, scene={"light": share})


STUDIES: dict[str, Study] = {
    study.name: study
    for study in (
        Study(
            "pose-noise", "white noise of every pose, with 0.05 deg per mm", "mm",
            (0, 0.5, 1, 2, 5, 10, 20), _perturb(pose_white_mm=1, pose_white_deg=0.05),
        ),
        Study(
            "pose-walk", "random walk of the poses, with 0.05 deg per mm", "mm per sqrt(s)",
            (0, 2, 5, 10, 20, 50, 100), _perturb(pose_walk_mm=1, pose_walk_deg=0.05),
        ),
        Study(
            "pose-drift", "odometry's drift, with 1 deg/s of yaw per 5 %", "% of the way",
            (0, 1, 2, 5, 10, 20, 50), _perturb(drift_percent=1, drift_yaw_deg_s=0.2),
        ),
        Study(
            "pose-rate", "rate of the poses", "Hz",
            (1000, 200, 100, 50, 20, 10, 5),
            lambda rate_hz: Change(perturb={"pose_rate_hz": rate_hz}), logarithmic=True,
        ),
        Study(
            "pose-delay", "poses late against events", "ms",
            (0, 1, 2, 5, 10, 20, 40), _perturb(pose_delay_ms=1),
        ),
        Study(
            "camera-delay", "camera 1 late against camera 0", "ms",
            (0, 1, 2, 5, 10, 20, 40), _perturb(camera_delay_ms=1),
        ),
        Study(
            "focal-length", "focal lengths overestimated", "%",
            (0, 0.5, 1, 2, 5, 10, 20), _perturb(focal_percent=1),
        ),
        Study(
            "principal-point", "principal points shifted right", "px",
            (0, 0.5, 1, 2, 5, 10, 20, 50), _perturb(centre_px=1),
        ),
        Study(
            "stereo-yaw", "yaw error of camera 1, outwards", "deg",
            (0, 0.1, 0.2, 0.5, 1, 2, 5), _perturb(stereo_yaw_deg=1),
        ),
        Study(
            "stereo-pitch", "pitch error of camera 1", "deg",
            (0, 0.1, 0.2, 0.5, 1, 2), _perturb(stereo_pitch_deg=1),
        ),
        Study(
            "baseline-error", "baseline overestimated", "%",
            (0, 1, 2, 5, 10, 20, 50), _perturb(baseline_percent=1),
        ),
        Study(
            "event-share", "share of events that is kept", "%",
            (100, 50, 20, 10, 5, 2, 1), _perturb(keep_events=0.01), logarithmic=True,
        ),
        Study(
            "window-length", "length of the window", "s",
            (0.4, 0.2, 0.1, 0.05, 0.02),
            lambda seconds: Change(map={"duration_s": seconds}), logarithmic=True,
        ),
        Study(
            "planes", "depth planes", "planes",
            (400, 200, 100, 50, 25, 12, 6),
            lambda count: Change(map={"planes": int(count)}), logarithmic=True,
        ),
        Study(
            "contrast-threshold", "contrast threshold of both polarities", "log intensity",
            (0.1, 0.2, 0.3, 0.45, 0.7, 1.0), _thresholds,
        ),
        Study(
            "sensor-noise", "shot noise events of every pixel", "Hz",
            (0, 1, 2, 5, 10, 20, 50, 100), _shot_noise,
        ),
        Study(
            "baseline", "baseline of the rig", "m",
            (0.4, 0.2, 0.1, 0.05, 0.02),
            lambda width_m: Change(scene={"baseline_m": width_m}), logarithmic=True,
        ),
        Study(
            "heading", "direction of a straight way: 0 sideways, 90 ahead", "deg",
            (0, 15, 30, 45, 60, 75, 90), lambda a: Change(scene={"heading_deg": a}),
        ),
        Study(
            "illumination", "light, with the noise of a DAVIS346", "times day",
            (1, 0.3, 0.1, 0.03, 0.01), _light, logarithmic=True,
        ),
    )
}  # fmt: skip


def default_methods() -> tuple[str, ...]:
    """`METHODS`, without those of plug-ins that are not here."""
    from eventsweep.emvs import methods  # with numpy, which help need not wait for

    return tuple(name for name in METHODS if methods.named(name) is not None)


def study_named(name: str) -> Study:
    """Finds a study by its name."""
    if name not in STUDIES:
        raise InputError(f"no study {name!r}: choose from {', '.join(STUDIES)}")
    return STUDIES[name]
