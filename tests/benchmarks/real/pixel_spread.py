"""How unequal pixels are: a real DAVIS240C beside simulated sensors that see its own picture.

`python tests/benchmarks pixel_spread --slider FOLDER [--poses FILE] [--page FILE]`. The recording
is `slider_depth` of the Event Camera Dataset: a camera that slides along its x axis, so that the
pixels of a row see the same things one after another. What a pixel sends beyond the median of its
neighbours in the row, in both halves of the recording alike, is its own. The simulated sensors see
the recording's first picture pass by at the recording's speed.

With `--poses`, a flight's file in TUM format, also how large a random walk its poses allow: a walk
is rough at all scales, so what remains of the real path above 10 Hz bounds it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, median_filter
from scipy.spatial.transform import Rotation

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.perturbations import Perturbation, perturbed_trajectory
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.sim.config import PixelConfig
from eventsweep.sim.motion.replay import smoothed
from eventsweep.sim.sensor.sensor import Sensor

Counts = NDArray[np.int64]
_ROW_PX, _FEW, _WARM, _SIGMAS = 13, 10, 3.0, 5.0
_QUARTILES = 1.349  # of a normal distribution, in standard deviations
_STEP_PX, _SPEED_PX_S, _SMOOTH_PX = 0.5, 96.0, 0.7
_ROUGH_HZ, _RATE_HZ, _DRAWS, _ENDS = 10.0, 100.0, 8, 20
# What `fit` finds for thresholds that make as many events as the recording has.
AS_MANY: dict[str, Any] = {"contrast_threshold_pos": 0.60, "contrast_threshold_neg": 0.43}
SIGMAS = (0.0, 0.03, 0.05, 0.08)


@dataclass(frozen=True)
class Spread:
    """What two halves of a recording say alike of its pixels.

    Attributes:
        events: events per pixel and second.
        fixed: standard deviation over pixels of the logarithm of their rate beside their
            neighbours', from quartiles: what is the same in both halves.
        warm_pixels: share of pixels that send thrice as much as their neighbours, in each half.
        warm_events: share of all events that those send.
        quiet_hz: events of pixels around which nothing moves, Hz per pixel: noise at most.
    """

    events: float
    fixed: float
    warm_pixels: float
    warm_events: float
    quiet_hz: float


def spread_of(events: Events, shape: tuple[int, int]) -> Spread:
    """Compares the two halves of one camera's events."""
    halves, span_us = halves_of(events, shape)
    seconds = (span_us[1] - span_us[0]) / 1e6
    sums, _ = PixelEvents.of(events, shape, span_us).quiet()
    quiet_s = float(sums[:, 0].sum())
    usual = [beside(counts) for counts in halves]
    known = np.logical_and(*(around >= _FEW for around in usual))
    logs = [np.log((c[known] + 0.5) / (u[known] + 0.5)) for c, u in zip(halves, usual, strict=True)]
    # The variance of a sum exceeds that of a difference by four covariances.
    both, apart = (np.subtract(*np.percentile(one, [75, 25])) / _QUARTILES
                   for one in (logs[0] + logs[1], logs[0] - logs[1]))  # fmt: skip
    warm = np.logical_and(*(_exceeds(c, u) for c, u in zip(halves, usual, strict=True)))
    total = halves[0] + halves[1]
    return Spread(
        float(total.mean() / seconds),
        float(np.sqrt(max(both**2 - apart**2, 0.0)) / 2),
        float(warm.mean()),
        float(total[warm].sum() / total.sum()),
        float(sums[:, [3, 5]].sum()) / quiet_s if quiet_s else float("nan"),
    )


def beside(counts: Counts) -> NDArray[np.float64]:
    """(H, W) the median of the pixels left and right of each, itself left out."""
    others = np.ones((1, _ROW_PX), bool)
    others[0, _ROW_PX // 2] = False
    return np.asarray(median_filter(counts.astype(np.float64), footprint=others, mode="mirror"))


def _exceeds(counts: Counts, usual: NDArray[np.float64]) -> NDArray[np.bool_]:
    most = _WARM * np.maximum(usual, np.median(counts))
    return np.asarray(counts > most + _SIGMAS * np.sqrt(most))


def halves_of(
    events: Events, shape: tuple[int, int]
) -> tuple[tuple[Counts, Counts], tuple[int, int]]:
    """(H, W) events per pixel of the first and the second half, and the span of both, µs."""
    first_us, last_us = int(events.t_us[0]), int(events.t_us[-1])
    cell = events.y.astype(np.int64) * shape[1] + events.x
    late = events.t_us > (first_us + last_us) // 2
    number = shape[0] * shape[1]
    parts = [np.bincount(cell[half], minlength=number).reshape(shape) for half in (~late, late)]
    return (parts[0], parts[1]), (first_us, last_us)


def passing(picture: NDArray[np.float32], seconds: float) -> Iterator[tuple[int, Any]]:
    """Times, µs, and the picture as it slides to the left, mirrored again and again."""
    endless = gaussian_filter(np.hstack([picture, picture[:, ::-1]]), _SMOOTH_PX, mode="wrap")
    width, across = picture.shape[1], np.arange(picture.shape[1])
    for k in range(int(seconds * _SPEED_PX_S / _STEP_PX)):
        left, share = divmod(k * _STEP_PX, 1)
        columns = (across + int(left)) % (2 * width), (across + int(left) + 1) % (2 * width)
        light = (1 - share) * endless[:, columns[0]] + share * endless[:, columns[1]]
        yield round(1e6 * k * _STEP_PX / _SPEED_PX_S), light.astype(np.float32)


def watched(picture: NDArray[np.float32], seconds: float, values: Mapping[str, Any]) -> Events:
    """What a sensor sends that sees the picture pass."""
    height, width = picture.shape
    sensor = Sensor(0, width, height, PixelConfig(**values), 0)
    frames = passing(picture, seconds)
    first_us, light = next(frames)
    sensor.start(light, first_us)
    return Events.concat([sensor.step(light, t_us).events for t_us, light in frames])


def sensors() -> dict[str, dict[str, Any]]:
    """Settings by name: a DAVIS346's thresholds, and those that make as many events as are real."""
    found = {}
    for sigma in SIGMAS:
        noise = {"preset": "davis346", "threshold_sigma": sigma}
        found[f"C as `davis346`, σ {sigma:g}"] = {"sensor": noise}
        found[f"C 0.60 and 0.43, σ {sigma:g}"] = {"sensor": noise, **AS_MANY}
    few = {
        "preset": "davis346", "threshold_sigma": 0.05, "hot_pixel_fraction": 0,
        "leak_rate_hz": 0.03, "shot_rate_dark_hz": 0.12, "shot_rate_bright_hz": 0.03,
    }  # fmt: skip
    found["C 0.60 and 0.43, σ 0.05, 0.3 of the noise"] = {"sensor": few, **AS_MANY}
    spread = {"preset": "davis346", "noise_spread_decades": 0.6}
    found["C as `davis346`, σ 0.03, noise spread by 0.6 decades"] = {"sensor": spread}
    return dict(sorted(found.items()))


def table(folder: Path) -> str:
    """Markdown: the real sensor and the simulated ones."""
    recording = open_recording(folder)
    first_us, last_us = recording.event_span_us(0)
    camera = recording.rig.cameras[0]
    shape = camera.height_px, camera.width_px
    events, seconds = recording.events(0, first_us, last_us + 1), (last_us - first_us) / 1e6
    if not isinstance(recording, EventCameraDataset):
        raise InputError(f"{folder} has no frames of the Event Camera Dataset: give slider_depth")
    first = recording.frame(0, int(recording.frame_times_us(0)[0]))
    picture = np.asarray(first, np.float32) / np.float32(255)
    lines = [
        "| sensor | events, Hz | quiet, Hz | own rate, σ ln | warm pixels, % | their events, % |",
        "|---|--:|--:|--:|--:|--:|",
        _line("**real DAVIS240C**", spread_of(events, shape)),
    ]
    for name, values in sensors().items():
        sys.stderr.write(f"{name}\n")
        lines.append(_line(name, spread_of(watched(picture, seconds, values), shape)))
    return "\n".join(lines) + "\n"


def _line(name: str, one: Spread) -> str:
    return (
        f"| {name} | {one.events:.1f} | {one.quiet_hz:.2f} | {one.fixed:.3f} "
        f"| {100 * one.warm_pixels:.3f} | {100 * one.warm_events:.2f} |"
    )


def rough(path: Trajectory) -> tuple[float, float]:
    """What remains of a path above 10 Hz: root mean square per axis, mm and deg."""
    t_us = np.arange(path.t_us[0], path.t_us[-1], 1e6 / _RATE_HZ).astype(np.int64)
    T_world_body = path.at(t_us)
    angles_rad = np.unwrap(Rotation.from_matrix(T_world_body[:, :3, :3]).as_euler("zyx"), axis=0)
    found = []
    for values, scale in ((T_world_body[:, :3, 3], 1e3), (angles_rad, np.degrees(1))):
        apart = (values - smoothed(values, _RATE_HZ, _ROUGH_HZ))[_ENDS:-_ENDS]
        found.append(float(scale * np.sqrt(np.mean(apart**2))))
    return found[0], found[1]


def walk_line(poses: Path) -> str:
    """Markdown: the random walks that leave as much above 10 Hz as the real poses do."""
    path = read_poses(poses)
    real = rough(path)
    rest = Trajectory.from_matrices(path.t_us, np.tile(np.eye(4), (len(path.t_us), 1, 1)))
    unit = Perturbation(pose_walk_mm=1, pose_walk_deg=0.1)
    drawn = [rough(perturbed_trajectory(rest, unit, seed)) for seed in range(_DRAWS)]
    mm, deg = np.array(real) / np.mean(drawn, axis=0) * (1, 0.1)
    return (
        f"Poses of {poses.name} vary by {real[0]:.2f} mm and {real[1]:.3f}° above {_ROUGH_HZ:g} "
        f"Hz, as much as random walks of {mm:.0f} mm and {deg:.2f}° per √s would: errors of the "
        "poses are no larger.\n"
    )


def main() -> int:
    """Prints the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slider", type=Path, required=True, help="the recording's folder")
    parser.add_argument("--poses", type=Path, help="a flight's poses, TUM format")
    asked = parser.parse_args()
    with exit_code() as code:
        text = table(asked.slider)
        if asked.poses is not None:
            text += "\n" + walk_line(asked.poses)
        sys.stdout.write(text)
    return code.value


if __name__ == "__main__":
    sys.exit(main())
