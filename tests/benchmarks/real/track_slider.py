"""`track` on a real slider under laws of motion: `track_slider --slider FOLDER`.

The recording is `slider_depth` of the Event Camera Dataset, a camera seen again a baseline farther
on as a second or third one (`slid_pair`), its times those of other motions (`slid_laws`). With
`--page` the table is written into a page. `--law`, `--baseline-m` and `--three` choose others.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import track
from markdown_blocks import show
from slid_laws import Law, Restamped, SlidTriple
from slid_pair import SlidPair
from table_code import FOREIGN, Code
from track_faults import judged

MARK = "track-slider"
LAWS = (
    Law(), Law(faster=2), Law(faster=3), Law(faster=4), Law(faster=6), Law(waves=3), Law(stops=3),
    Law(back=True), Law(faster=2, back=True),
)  # fmt: skip
BASELINES_M, TRIPLE_M = (0.05, 0.1, 0.15), 0.07
_BELIEVED = Status.TRACKING, Status.STILL
_MOSTLY = 0.5  # of the poses


@dataclass(frozen=True)
class Cell:
    """What a track came to.

    Attributes:
        ate_percent: root mean square error of all poses, of the way, aligned rigidly.
        doubted: share of poses said to be worse than `tracking`, or than standing still.
        is_wrong: whether those said to be `tracking` are off by 2 % of their way, or 3 % of scale.
    """

    ate_percent: float
    doubted: float
    is_wrong: bool

    def __str__(self) -> str:
        doubted = " (doubted)" * (self.doubted > _MOSTLY)
        return f"{self.ate_percent:.2f}{doubted}{' **wrong**' * self.is_wrong}"


def tracked(recording: Recording) -> Cell:
    """Tracks, and scores all poses and those that are believed; the worst cell where none began."""
    try:
        found = track(recording)
    except InputError:
        return Cell(np.inf, 1.0, is_wrong=False)
    verdict = judged(found, recording.trajectory, (0, 0))
    off = score_poses(recording.trajectory, found.trajectory).values["ate_share"]
    believed = np.mean([status in _BELIEVED for status in found.statuses])
    return Cell(float(off), 1 - float(believed), verdict.is_wrong)


def rows(
    slider: Recording, laws: Sequence[Law], baselines_m: Sequence[float], triples_m: Sequence[float]
) -> Iterator[tuple[Law, list[Cell]]]:
    """A law after the other, with a cell per rig."""
    rigs = [SlidPair(slider, each) for each in baselines_m]
    rigs += [SlidTriple(slider, each) for each in triples_m]
    for law in laws:
        yield law, [tracked(Restamped(rig, law)) for rig in rigs]


def table(
    found: Sequence[tuple[Law, list[Cell]]], baselines_m: Sequence[float],
    triples_m: Sequence[float],
) -> str:  # fmt: skip
    """In Markdown, with what all cells come to."""
    heads = [f"{100 * each:g} cm" for each in baselines_m]
    heads += [f"three, {100 * each:g} cm" for each in triples_m]
    cells = [cell for _, row in found for cell in row]
    percent, wrong = [c.ate_percent for c in cells], sum(c.is_wrong for c in cells)
    lines = [["Speed", *heads], ["---", *["--:"] * len(heads)]]
    lines += [[str(law), *map(str, row)] for law, row in found]
    return "\n".join(
        [
            "Written by `python tests/benchmarks track_slider`: ATE of a real camera on a slider,",
            "as a pair or three of that baseline, in % of the way; doubted: most poses are.",
            "",
            *(f"| {' | '.join(line)} |" for line in lines),
            "",
            f"In the median {np.median(percent):.2f} %, {np.max(percent):.2f} % at worst; "
            f"silently wrong: {wrong} of {len(cells)}.",
            "",
        ]
    )


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    own = "track_slider:table", "track_slider:rows", "track_slider:LAWS"
    return {f"plugins/track/odometry.md#{MARK}": Code(own, without=FOREIGN)}


def law_of(text: str) -> Law:
    """`FASTER`, then `wavesN`, `stopsN` and `back`, with commas: `2,waves3`.

    Raises:
        ArgumentTypeError: another word, or a factor that is not above 0.
    """
    values: dict[str, float | int | bool] = {}
    try:
        for word in text.split(","):
            if word == "back":
                values["back"] = True
            elif word.startswith(("waves", "stops")):
                values[word[:5]] = int(word[5:])
            else:
                values["faster"] = float(word)
        law = Law(**values)  # type: ignore[arg-type]
        if not (0 < law.faster < np.inf and law.waves >= 0 and law.stops >= 0):
            raise ValueError(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r}: needs a factor of speed above 0, wavesN, stopsN or back, such as 2,waves3"
        ) from error
    return law


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--slider", type=Path, required=True, help="folder of slider_depth")
    parser.add_argument("--law", type=law_of, action="append", help="such as 2.5, or 2,waves3,back")
    parser.add_argument("--baseline-m", type=float, action="append", help="of a pair, m")
    parser.add_argument("--three", type=float, action="append", help="baseline of three, m")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    asked = parser.parse_args(arguments)
    chosen = asked.baseline_m or asked.three
    pairs_m = (asked.baseline_m or ()) if chosen else BASELINES_M
    triples_m = (asked.three or ()) if chosen else (TRIPLE_M,)
    with exit_code() as ended:
        found = list(rows(open_recording(asked.slider), asked.law or LAWS, pairs_m, triples_m))
        show(table(found, pairs_m, triples_m), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    raise SystemExit(main())
