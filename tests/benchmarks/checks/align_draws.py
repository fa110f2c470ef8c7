"""How often `eventsweep align` finds planted clocks, rotations and principal points.

    python tests/benchmarks align_draws --out FOLDER [--page PAGE]

A few small sequences are simulated once and kept in the folder. Each draw takes seven frames of one
of them and spoils the frame camera's calibration, of a size near 3 ms, 0.3 degrees and 2 px in any
direction; found is what the estimate says. Scenes for development chose constants; the others were
opened with them. `--half` makes one of the two alone, and prints the 95 % quantile of errors in
standard deviations: `offset.WIDTHS` is that of `--half development`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import eventsweep as es
from eventsweep.emvs.data.image_stores import FrameCamera, Photo, Pictures
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.align.depths import depth_source
from eventsweep.plugins.align.offset import MARGIN_US, WIDTHS, Found, find_offset
from eventsweep.plugins.align.residual import samples
from eventsweep.plugins.align.rig import set_up
from markdown_blocks import show
from table_code import Code, of_scenes

MARK, PAGE = "align-draws", "plugins/align/align.md"
SECONDS, FRAMES, DRAWS = 0.7, 7, 60
SIZES = 3000.0, np.radians(0.3), 2.0
"""Of what is planted: clock, µs; rotation, rad; principal point, px; each times 0.8 to 1.2."""
Array = NDArray[np.float64]


def _rig(name: str, eye: Camera, grey: Camera) -> Rig:
    """A small event camera, and a frame camera 6 cm beside it that is turned by a few degrees."""
    T_body_cam = np.eye(4)
    turn = Rotation.from_euler("xyz", (-2, 1.5, 1), degrees=True)
    T_body_cam[:3, :3], T_body_cam[:3, 3] = turn.as_matrix(), (0.05, -0.03, 0.01)
    beside = Rig(f"{name}, frames", (grey,), (T_body_cam,), ("grey",))
    return Rig(name, (eye,), (np.eye(4),), ("eye",), beside)


LENSES = {
    "77°": _rig(
        "wide",
        Camera(173, 130, 112.9, 113.1, 86.2, 65.4, "radtan", (-0.1, 0.03, 0, 0)),
        Camera(240, 180, 150.3, 150.9, 122.1, 88.2, "radtan", (-0.17, 0.09, 4e-4, -3e-4)),
    ),
    "40°": _rig(
        "narrow",
        Camera(173, 130, 240.0, 240.4, 86.2, 65.4, "radtan", (-0.1, 0.03, 0, 0)),
        Camera(240, 180, 331.0, 330.4, 118.5, 91.2, "radtan", (-0.1, 0.05, 0, 0)),
    ),
}
"""By the width of the frames' view."""


@dataclass(frozen=True)
class Base:
    """A sequence to spoil."""

    scene: str
    lens: str
    sensor: str
    seed: int


HALVES = {
    "development": (
        Base("desk", "77°", "davis346", 0), Base("rpg-boxes", "40°", "ideal", 0),
        Base("planes", "77°", "ideal", 0), Base("rpg-monitor", "40°", "davis346", 0),
    ),
    "held out": (
        Base("boxes", "77°", "ideal", 1001), Base("mvsec-flying", "40°", "davis346", 1002),
        Base("rpg-bin", "77°", "davis346", 1003), Base("rpg-reader", "40°", "ideal", 1004),
    ),
}  # fmt: skip
FIRST = {"development": 0, "held out": 1000}
"""Of the seeds of the draws; those of the held-out half were never drawn before the table was."""


@dataclass(frozen=True)
class Late:
    """Pictures whose stamps are early."""

    pictures: Pictures
    late_us: int

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) what is stamped, µs."""
        return self.pictures.t_us - self.late_us

    def photo(self, index: int) -> Photo:
        """The picture."""
        return self.pictures.photo(index)


class Spoilt(DerivedRecording):
    """A recording that tells its frame camera's calibration wrongly; `values` would correct it."""

    def __init__(self, recording: Any, values: Array) -> None:
        super().__init__(recording)
        (true,) = recording.frame_cameras
        T_body_cam = true.T_body_cam.copy()
        T_body_cam[:3, :3] @= Rotation.from_rotvec(values[1:4]).as_matrix().T
        right_px, down_px = values[4:]
        lens = true.camera
        lens = replace(lens, cx_px=lens.cx_px - right_px, cy_px=lens.cy_px - down_px)
        pictures = Late(true.pictures, round(values[0]))
        self.frame_cameras = (FrameCamera(true.name, lens, T_body_cam, pictures),)
        self.truth_times_us, self.truth_depth_m = (
            recording.truth_times_us, recording.truth_depth_m,
        )  # fmt: skip


@dataclass(frozen=True)
class Drawn:
    """What was planted and what was found.

    Attributes:
        base: the sequence.
        planted: (8,) in the order and units of the estimates.
        found: the estimates.
    """

    base: Base
    planted: Array
    found: Found

    @property
    def off(self) -> Array:
        """(8,) errors."""
        return np.array([each.value for each in self.found.estimates]) - self.planted

    @property
    def half(self) -> Array:
        """(8,) half-widths."""
        return np.array([each.half for each in self.found.estimates])

    @property
    def known(self) -> NDArray[np.bool_]:
        """(8,) whether it is determined."""
        return np.array([each.known for each in self.found.estimates])


def sequence(base: Base, folder: Path) -> Recording:
    """The simulated sequence, kept if it is there."""
    path = folder / f"{base.scene}-{LENSES[base.lens].name}-seed{base.seed}"
    if not path.exists():
        frames = {"rate_hz": 25, "exposure_us": 5000}
        config = es.SimConfig(duration_s=SECONDS, sensor={"preset": base.sensor}, frames=frames)
        es.simulate(base.scene, path, config, seed=base.seed, rig=LENSES[base.lens])
    return es.open_recording(path)


def draws(half: str, folder: Path, count: int) -> list[Drawn]:
    """Every draw of a half; the first are the same for any `count`."""
    bases, done = HALVES[half], []
    for number in range(count):
        base, seed = bases[number % len(bases)], FIRST[half] + number
        rng = np.random.default_rng([sorted(HALVES).index(half), seed])
        done.append(_draw(base, sequence(base, folder), rng))
        sys.stderr.write(f"{half} {number + 1}/{count} {base.scene}\n")
    return done


def _draw(base: Base, recording: Recording, rng: np.random.Generator) -> Drawn:
    late_us, turn, shift = SIZES * rng.uniform(0.8, 1.2, 3)
    angle = rng.uniform(0, 2 * np.pi)
    values = np.concatenate([
        [round(late_us) * rng.choice((-1, 1))], turn * _direction(rng),
        [shift * np.cos(angle), shift * np.sin(angle)],
    ])  # fmt: skip
    spoilt: Any = Spoilt(recording, values)
    setup = set_up(spoilt, depth_source(spoilt, None))
    covered = setup.covered(MARGIN_US)
    first = int(rng.integers(len(covered) - FRAMES + 1))
    found = find_offset(setup, samples(setup, covered[first : first + FRAMES]))
    moved_px = found.mean_move_px[:, 1:] @ values[1:]
    planted = [values[0] / 1000, *np.degrees(values[1:4]), *values[4:], *moved_px]
    return Drawn(base, np.array(planted), found)


def _direction(rng: np.random.Generator) -> Array:
    one = rng.normal(size=3)
    return np.asarray(one / np.linalg.norm(one), np.float64)


def quantile(done: Sequence[Drawn]) -> float:
    """95 % of the errors, but for the clock's, are less than so many standard deviations.

    The clock's intervals allow for the sensor's delay above all, and say nothing of these.
    """
    off = [(WIDTHS * np.abs(one.off) / one.half)[1:][one.known[1:]] for one in done]
    return float(np.quantile(np.concatenate(off), 0.95))


def table(halves: dict[str, list[Drawn]]) -> str:
    """A line per value in Markdown."""
    lines = [
        f"Written by `python tests/benchmarks align_draws`: {DRAWS} draws each, seven frames of "
        f"240×180, events of 173×130. The development chose the width of intervals ({WIDTHS:g} "
        "standard deviations). The held-out motions and draws, of seeds from "
        f"{FIRST['held out']}, were opened after all constants were set; earlier states saw other "
        "motions in the same scenes. Half-widths and errors: medians of the held-out draws.",
        "",
        "| Value | Held out: within its interval | Not determined | Half-width | Error "
        "| Development: within |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    held, developed = halves["held out"], halves["development"]
    for k, each in enumerate(held[0].found.estimates):
        some = [one for one in held if one.known[k]]
        half, off = (
            f"{np.median([values[k] for values in column]):.3g} {each.unit}" if some else "–"
            for column in ([one.half for one in some], [np.abs(one.off) for one in some])
        )
        lines.append(
            f"| {each.name} | {_within(held, [k])} | {len(held) - len(some)} | {half} | {off} | "
            f"{_within(developed, [k])} |"
        )
    every = range(len(held[0].planted))
    lines.append(f"| all | {_within(held, every)} | | | | {_within(developed, every)} |")
    return "\n".join(lines) + "\n"


def _within(done: Sequence[Drawn], which: Sequence[int]) -> str:
    good = [
        abs(one.off[k]) <= one.half[k] for one in done for k in which if one.known[k]
    ]  # fmt: skip
    share = f", {100 * np.mean(good):.0f} %" if good else ""
    return f"{sum(good)} of {len(good)}{share}"


_NEVER_RUN = ("eventsweep.emvs.maps", "eventsweep.emvs.dsi")
"""Depth comes from sequences, not from maps."""


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    names = ("align_draws:draws", "align_draws:table", "align_draws:DRAWS")
    scenes = (base.scene for half in HALVES.values() for base in half)
    return {f"{PAGE}#{MARK}": Code(names, without=_NEVER_RUN) + of_scenes(scenes)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of the sequences")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--half", choices=HALVES, help="makes this half alone")
    parser.add_argument("--draws", type=int, default=DRAWS, help="of each half")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        if asked.half:
            done = draws(asked.half, asked.out, asked.draws)
            sys.stdout.write(table(dict.fromkeys(HALVES, done)))
            sys.stdout.write(f"95 % quantile: {quantile(done):.2f} standard deviations\n")
            return ended.value
        show(
            table({half: draws(half, asked.out, DRAWS) for half in HALVES}), asked.page, MARK, code
        )
    return ended.value


if __name__ == "__main__":
    raise SystemExit(main())
