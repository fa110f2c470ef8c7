"""The report of `bench_gpu.py` as tables: for the terminal and for the page."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from gpu_machine import title

SCHEMA_VERSION = 1
# What one bilinear vote adds: two sums of two lanes each, or four cells.
PER_VOTE = {"fixed": ("int64", 2), "float": ("float32", 4)}
_NAMES = {"fixed": "GPU, fixed-point votes", "float": "GPU, float votes", "cpu": "CPU, all cores"}

Part = dict[str, Any]
Parts = dict[str, Part]


def read(path: Path) -> dict[str, Any]:
    """Reads what `tests/benchmarks/gpu/bench_gpu.py --out` wrote.

    Raises:
        InputError: no such file, no JSON, or another version's.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}): name what --out wrote") from error
    found = report.get("schema_version") if isinstance(report, dict) else None
    if found != SCHEMA_VERSION:
        raise InputError(
            f"{path}: schema version {found}, this program reads {SCHEMA_VERSION}: measure again"
        )
    return dict(report)


def into(page: Path, report: dict[str, Any]) -> None:
    """Puts the tables into a page, between its marks named `gpu`.

    Raises:
        InputError: a page without them, or a report of a trial.
    """
    from markdown_blocks import into_page

    if is_trial(report):
        raise InputError("a trial is no measurement: its figures stay off the page")
    into_page(page, "gpu", text(report))


def is_trial(report: dict[str, Any]) -> bool:
    """Whether the script was only tried: tiny, without a GPU, or with numba's simulator of one."""
    gpu = report["machine"]["gpu"]
    return bool(report["quick"] or gpu is None or gpu["simulated"])


def text(report: dict[str, Any]) -> str:
    """All tables, as Markdown; what was not measured says why."""
    trial = "A trial: these figures mean nothing. " if is_trial(report) else ""
    if report["device"] != "cuda":
        trial += "The CPU stands in for the GPU. "
    wrong = [f"**Wrong:** {sentence}." for sentence in report["wrong"]]
    measured = f"Measured {report['measured']} in {report['took_s']:.0f} s."
    return "\n\n".join([f"{trial}{title(report['machine'])} {measured}", *wrong,
                        *_sections(report["parts"])]) + "\n"  # fmt: skip


def _sections(parts: Parts) -> Iterator[str]:
    for name, part in parts.items():
        heading, table = _TABLES[name]
        reason = part.get("skipped") or part.get("failed")
        yield f"### {heading}"
        yield f"Not measured: {reason}." if reason else table(parts)


def _atomics(parts: Parts) -> str:
    lines = (
        (r["kind"], r["grid"], f"{r['grid_bytes'] / 2**20:.4g} MiB", f"{r['per_s'] / 1e9:.3g}")
        for r in parts["atomics"]["rates"]
    )
    return _table(("type", "cells lie in", "size", "10⁹ additions/s"), lines)


def _whole(parts: Parts) -> str:
    part = parts["whole"]
    load, calls, limit_ms = part["load"], part["calls"], part["limit_ms"]
    cpu_s = calls["cpu"]["median_s"]
    lines = []
    for name, one in calls.items():
        took_s = one["median_s"]
        held = "–" if name == "cpu" else "yes" if 1e3 * took_s <= limit_ms else "**no**"
        lines.append((
            _NAMES[name], f"{one['first_s']:.2f} s", f"{1e3 * took_s:.4g} ms", held,
            f"{cpu_s / took_s:.3g} ×", "yes" if one["repeats"] else "no",
        ))  # fmt: skip
    width, height = load["size_px"]
    head = (
        f"{load['events'] / 1e6:g} M events, {width}×{height} px, {load['planes']} planes, six "
        "functions and both cameras alone; from events in memory to depth maps in memory.\n\n"
    )
    columns = ("by", "first call", "median call", f"≤ {limit_ms:g} ms", "CPU's time over it",
               "same bits each time")  # fmt: skip
    return "\n".join((
        head + _table(columns, lines), _stages(calls), _votes(load, calls, parts.get("atomics", {}))
    ))  # fmt: skip


def _stages(calls: Parts) -> str:
    stages = list(dict.fromkeys(stage for one in calls.values() for stage in one["stages_s"]))
    lines = (
        (_NAMES[name], *(f"{1e3 * one['stages_s'].get(stage, 0):.4g}" for stage in stages))
        for name, one in calls.items()
    )
    return _table(("of which, ms", *stages), lines)


def _votes(load: Part, calls: Parts, atomics: Part) -> str:
    pairs = load["events"] * load["planes"]
    lines = (
        (_NAMES[name], f"{1e3 * one['votes_s']:.4g}", f"{1e9 * one['votes_s'] / pairs:.3g}",
         f"{1e9 * one['median_s'] / pairs:.3g}", _share(one, PER_VOTE.get(name), atomics))
        for name, one in calls.items()
    )  # fmt: skip
    columns = ("votes alone", "ms", "ns per event and plane", "of the whole call",
               "of the atomic rate in L2")  # fmt: skip
    return _table(columns, lines)


def _share(one: Part, per_vote: tuple[str, int] | None, atomics: Part) -> str:
    """Additions per second while votes are cast over what the device does at random in its L2."""
    if per_vote is None or "rates" not in atomics:
        return "–"
    kind, additions = per_vote
    rates = {(rate["kind"], rate["grid"]): rate["per_s"] for rate in atomics["rates"]}
    return f"{100 * one['counted'] * additions / one['votes_s'] / rates[kind, 'L2']:.3g} %"


def _agreement(parts: Parts) -> str:
    lines = (
        (_NAMES[name], _exact(one["volume"]), _exact(one["relative"]),
         f"{100 * one['argmax']:.4f} %", _exact(one["counted"]))
        for name, one in parts["agreement"].items() if name in _NAMES
    )  # fmt: skip
    columns = ("against the CPU", "DSI, of its maximum", "DSI, of each value", "argmax equal",
               "votes counted")  # fmt: skip
    return _table(columns, lines)


def _sliding(parts: Parts) -> str:
    part = parts["sliding"]
    lines = (
        (name, str(one["windows"]), f"{one['events'] / 1e6:g}",
         f"{one['events'] / one['mapped_s'] / 1e6:.3g}",
         f"{one['events'] / one['written_s'] / 1e6:.3g}")
        for name, one in (("GPU", part["gpu"]), ("CPU", part["cpu"]))
    )  # fmt: skip
    columns = ("by", "windows", "10⁶ events", "10⁶ events/s, mapped", "… and written")
    return _table(columns, lines)


def _frames(parts: Parts) -> str:
    drawn = parts["frames"]["drawn"]
    lines = (
        (one["kind"], one["where"], one["rig"], f"{one['per_s']:.3g}", _apart(one.get("apart")))
        for one in drawn if one["per_s"] is not None
    )  # fmt: skip
    columns = "renderer", "on", "camera of", "pictures/s", "light, depth from kernels'"
    by: dict[tuple[bool, str], list[str]] = {}
    for one in drawn:
        by.setdefault((one["per_s"] is None, one["drawn_by"]), []).append(one["kind"])
    said = (
        f"- {', '.join(dict.fromkeys(kinds))}: {'not measured, ' * missing}{words}"
        for (missing, words), kinds in by.items()
    )
    return _table(columns, lines) + "\n" + "\n".join(said) + "\n"


def _apart(apart: Sequence[float] | None) -> str:
    return "–" if apart is None else ", ".join(_exact(one) for one in apart)


def _growth(parts: Parts) -> str:
    lines = (
        (g["quantity"], f"{g['amounts'][0]} … {g['amounts'][-1]}",
         ", ".join(f"{1e3 * second:.3g}" for second in g["seconds"]),
         f"{g['exponent']:.2f}", f"{g['last_exponent']:.2f}")
        for g in parts["growth"]["series"]
    )  # fmt: skip
    return _table(("grows", "from … to", "median call, ms", "exponent", "of the last two"), lines)


def _exact(value: float | None) -> str:
    return "none" if value is None else f"{value:.2g}"


def _table(columns: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rule = ["---", *("--:" for _ in columns[1:])]
    return "\n".join(f"| {' | '.join(row)} |" for row in (columns, rule, *lines)) + "\n"


_TABLES: dict[str, tuple[str, Callable[[Parts], str]]] = {
    "atomics": ("Atomic additions to random cells", _atomics),
    "whole": ("Algorithm 1, the whole call", _whole),
    "agreement": ("Agreement", _agreement),
    "sliding": ("Sliding windows", _sliding),
    "frames": ("Pictures per second", _frames),
    "growth": ("Growth", _growth),
}
