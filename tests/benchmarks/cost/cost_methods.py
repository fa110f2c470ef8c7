"""What each method costs: `python tests/benchmarks cost_methods --page docs/methods.md`.

Whole calls of the mapper on one thread, by processor time: on a machine that others use too, the
wall's time would measure the neighbours. Rounds of all methods take turns, and the best one counts.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cost_limits import PAPER, peak_of_map
from cost_stream import MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from study_cost import machine

BASE = "Alg1/H"
_FOCUS, _LEARNED = "Focus/H", "Learned/H"
EIGHT, ALL = "`Alg1/`, six fusions, two cameras", "`all`: these eight, `Focus/H`"
SENSORS: dict[str, tuple[int, int]] = {"346×260": (346, 260), "1280×720": (1280, 720)}
ASKED: dict[str, tuple[str, ...]] = {
    "`EMVS/cam0`": ("EMVS/cam0",),
    "`Alg1/H`": (BASE,),
    "`Alg1/G`": ("Alg1/G",),
    "`Alg1/`, six fusions": tuple(f"Alg1/{name}" for name in ("min", "H", "G", "A", "RMS", "max")),
    "`Late/union`": ("Late/union",),
    "`Focus/H`": ("Focus/H",),
    "`Learned/H`": ("Learned/H",),
    EIGHT: PAPER,
    ALL: ("all",),
    "these eight, `Focus/H`, `Learned/H`": ("all", "Learned/H"),
    "`Alg2/AtHc@2`": ("Alg2/AtHc@2",),
    "`Alg2/AtHc@4`": ("Alg2/AtHc@4",),
    "`Alg2/HcAt@4`": ("Alg2/HcAt@4",),
    "`Alg2/AtHc@16`": ("Alg2/AtHc@16",),
    "`Alg2/` `AtHc`, `AcAt`, `HtHc`, `HcHt` `@4` together": tuple(
        f"Alg2/{name}@4" for name in ("AtHc", "AcAt", "HtHc", "HcHt")
    ),
}
"""What is asked of one call -> the methods."""

Seconds = NDArray[np.float64]


@dataclass(frozen=True)
class MethodsEffort:
    """How much is measured.

    Attributes:
        events: events of each of the two cameras.
        planes: depth planes.
        rounds: of so many the best counts.
    """

    events: int = 1_000_000
    planes: int = 100
    rounds: int = 3


def costs(
    effort: MethodsEffort, size_px: tuple[int, int], asked: Sequence[tuple[str, ...]]
) -> Seconds:
    """Measures calls of the mapper.

    Args:
        effort: how much.
        size_px: columns and rows of the cameras.
        asked: the methods of each call.

    Returns:
        (N,) processor time of each call, s.
    """
    recording = MovingEdges(size_px, effort.events)
    recording.event_span_us(0)  # makes the events now
    configs = [MapperConfig(planes=effort.planes, threads=1, methods=methods) for methods in asked]
    seconds = np.full((effort.rounds + 1, len(asked)), np.inf)
    for taken in seconds:
        for k, config in enumerate(configs):
            begin = time.process_time()
            map_window(recording, config)
            taken[k] = time.process_time() - begin
    best: Seconds = seconds[1:].min(axis=0)  # the first round compiles
    return best


def table(found: Mapping[str, Seconds], names: Sequence[str], base: int) -> str:
    """Markdown: seconds of the base, and everything else as multiples of it.

    Args:
        found: sensor -> (N,) seconds.
        names: of the calls.
        base: which of them is 1.
    """
    lines = ["| Methods in one run | " + " | ".join(found) + " |", "|---|" + "--:|" * len(found)]
    for k, name in enumerate(names):
        cells = (
            f"{seconds[k]:.2f} s" if k == base else f"× {seconds[k] / seconds[base]:.2f}"
            for seconds in found.values()
        )
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures, prints the table, and writes it into a page; 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks cost_methods", description=__doc__
    )
    parser.add_argument("--events", type=int, default=MethodsEffort.events, help="of each camera")
    parser.add_argument("--planes", type=int, default=MethodsEffort.planes)
    parser.add_argument(
        "--rounds", type=int, default=MethodsEffort.rounds, help="the best one counts"
    )
    parser.add_argument("--page", type=Path, help="page whose marked part gets the table")
    chosen = parser.parse_args(arguments)
    effort = MethodsEffort(chosen.events, chosen.planes, chosen.rounds)
    with exit_code() as code:
        text = _measured(effort)
        show(text, chosen.page, "costs")
    return code.value


def candidates(size_px: tuple[int, int], effort: MethodsEffort) -> int:
    """How many pixels `Learned/H` judges."""
    config = MapperConfig(planes=effort.planes, threads=1, methods=(_LEARNED,))
    found = map_window(MovingEdges(size_px, effort.events), config).depth_maps[_LEARNED]
    assert found.reliability is not None  # every learned method has one
    return int(np.count_nonzero(found.reliability))


def _measured(effort: MethodsEffort) -> str:
    about, names = machine(), list(ASKED)
    found = {
        sensor: costs(effort, size_px, list(ASKED.values())) for sensor, size_px in SENSORS.items()
    }
    events = f"{effort.events:,}".replace(",", " ")
    said = f"Two cameras of {events} events each, {effort.planes} planes, one thread of {about}"
    text = table(found, names, names.index("`Alg1/H`"))
    return f"{said}\n\n{text}\n{_learned(found, names, effort)}"


def _learned(found: Mapping[str, Seconds], names: Sequence[str], effort: MethodsEffort) -> str:
    """What a candidate of the learned extraction costs, and how much memory that takes."""
    sensor, size_px = list(SENSORS.items())[-1]
    seconds = dict(zip(names, found[sensor], strict=True))
    many = max(candidates(size_px, effort), 1)
    each_us = 1e6 * (seconds["`Learned/H`"] - seconds["`Focus/H`"]) / many
    share = seconds["`Learned/H`"] / seconds[EIGHT]
    focus = seconds[ALL] / seconds[EIGHT]
    peaks = (f"`{name}` {peak_of_map((name,), size_px, effort.events, effort.planes):.0f} MB"
             for name in (BASE, _FOCUS, _LEARNED))  # fmt: skip
    lines = (
        f"At {sensor}, against six fusions and two cameras: × {focus:.2f} with `Focus/H` too, "
        f"× {share:.2f} for `Learned/H` alone. It judges {many} pixels here: beyond `Focus/H`, "
        f"{each_us:.0f} µs for each.",
        f"Peak memory of a process that maps from disk: {', '.join(peaks)}.",
    )
    return "\n\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
