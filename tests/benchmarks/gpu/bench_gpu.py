"""What the GPU gives beside the CPU: `python tests/benchmarks bench_gpu --out FILE.json`.

Times whole calls of the mapper on both, compares volumes and maxima, and counts pictures of every
renderer; the tables are those of plugins/cuda/cuda.md. The JSON is written after every part, so
that a run that is stopped leaves what it has. Exit code 1 where a result is wrong, slow or not.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from cost_stream import WINDOW_US, MovingEdges
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.dsi.device import choose_device, code_of_device
from eventsweep.emvs.dsi.fusion import MEANS
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.methods import methods_by_name, with_volume
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.emvs.utils.runtime import versions
from eventsweep.emvs.window_result import WindowResult
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.suite.speed import processor
from eventsweep.sim.graphics import choice
from markdown_blocks import into_page
from table_code import Code, of_scenes

PAPER = (*(f"Alg1/{name}" for name in MEANS), "EMVS/cam0", "EMVS/cam1")
VOLUMES = ("Alg1/H", "EMVS/cam0", "EMVS/cam1")
NAMES = {"gpu": "GPU", "cpu": "CPU, all cores"}
LIMIT_MS, DSI_LIMIT, ARGMAX_LIMIT, LIGHT_LIMIT = 100.0, 1e-3, 0.999, 1e-6
"""Of a whole call on an H200; of volumes, maxima, and a shader's light against the CPU's."""
SCHEMA_VERSION = 3
_WRONG, _DRAWING_LIMIT_S = 1, 120.0
_SMI = ["nvidia-smi", "--query-gpu=name,driver_version", "--format=csv,noheader", "--id=0"]
Part = dict[str, Any]


@dataclass(frozen=True)
class Plan:
    """Sizes and rounds; the defaults are those of the published table.

    Attributes:
        size_px: columns and rows of both cameras.
        events: events per camera.
        planes: depth planes.
        rounds: timed calls on the GPU, after one that compiles; the median counts.
        cpu_rounds: the same on the CPU.
        rigs: whose cameras are drawn.
        frame_s: for how long pictures are drawn and counted, s.
    """

    size_px: tuple[int, int] = (1280, 720)
    events: int = 10_000_000
    planes: int = 100
    rounds: int = 7
    cpu_rounds: int = 2
    rigs: tuple[str, ...] = ("davis346", "tumvie", "tumvie-kb4")
    frame_s: float = 2.0

    def config(self, device: str) -> MapperConfig:
        """The mapper's settings: every function of Algorithm 1 and both cameras alone."""
        duration_s = 1e-6 * WINDOW_US
        return MapperConfig(device=device, methods=PAPER, planes=self.planes, duration_s=duration_s)


QUICK = Plan((16, 12), 60, 2, rounds=1, cpu_rounds=1, rigs=("oblique",), frame_s=0.05)
"""Tiny: it shows that the script runs; its figures mean nothing."""


def whole(plan: Plan, device: str, wrong: list[str]) -> Part:
    """Algorithm 1 with all functions, on the GPU and on the CPU.

    Raises:
        InputError: the device cannot be used.
    """
    recording = MovingEdges(plan.size_px, plan.events)
    recording.event_span_us(0)  # makes the events now
    calls: dict[str, Part] = {}
    with tempfile.TemporaryDirectory() as folder:
        own, results = {name: Path(folder) / name for name in NAMES}, {}
        for name, on, rounds in (("cpu", "cpu", plan.cpu_rounds), ("gpu", device, plan.rounds)):
            config = plan.config(on)
            calls[name], results[name] = called(recording, config, rounds)
            own[name].mkdir()
            saved = {"methods": VOLUMES, "save_dsi": True}
            map_window(recording, config.model_copy(update=saved), dsi_dir=own[name])
        calls["gpu"] |= apart(results["gpu"], results["cpu"], own["gpu"], own["cpu"])
        wrong += faults(calls["gpu"])
    load = {"events": 2 * plan.events, "planes": plan.planes, "size_px": plan.size_px}
    return {"load": load, "calls": {name: calls[name] for name in NAMES}}


def called(recording: MovingEdges, config: MapperConfig, rounds: int) -> tuple[Part, WindowResult]:
    """Times of a first call and of the median of others, s, and the last result."""
    seconds, stages, repeats, first = [], [], True, None
    for _ in range(rounds + 1):
        begin = time.perf_counter()
        last = map_window(recording, config)
        seconds.append(time.perf_counter() - begin)
        stages.append(last.seconds)
        first = first or last
        repeats &= same(first, last)
    medians = {name: float(np.median([one[name] for one in stages[1:]])) for name in stages[0]}
    median_s = float(np.median(seconds[1:]))
    times = {"first_s": seconds[0], "median_s": median_s, "stages_s": medians}
    return times | {"repeats": repeats}, last


def same(one: WindowResult, other: WindowResult) -> bool:
    """Whether two results have the same bits: depth, confidence, mask and argmax."""
    return all(
        np.array_equal(getattr(a, name), getattr(b, name), equal_nan=name == "depth_m")
        for a, b in zip(one.depth_maps.values(), other.depth_maps.values(), strict=True)
        for name in ("depth_m", "confidence", "mask", "argmax")
    )


def apart(gpu: WindowResult, cpu: WindowResult, ours: Path, theirs: Path) -> Part:
    """How far volumes lie apart, over the greatest value, and maxima in the worst method.

    A volume that is not finite is infinitely far.
    """
    most = 0.0
    for method in with_volume(methods_by_name(VOLUMES, 2)):
        file = f"{file_name(method.name)}.npy"
        one, other = np.load(ours / file), np.load(theirs / file)
        off = float(np.abs(one - other).max() / max(float(other.max()), 1e-30))
        most = max(most, off if np.isfinite(one).all() else np.inf)
    shares = [
        float(np.mean(gpu.depth_maps[name].argmax == one.argmax))
        for name, one in cpu.depth_maps.items()
    ]
    votes, expected = (sum(one.votes.counted for one in each.counts) for each in (gpu, cpu))
    return {"volume": most, "argmax": min(shares), "counted": votes - expected}


def faults(calls: Part) -> Iterator[str]:
    """What is wrong with the calls on the GPU, a sentence each."""
    if not calls["volume"] <= DSI_LIMIT:
        yield f"the DSI is off by {calls['volume']:.2g}, above {DSI_LIMIT:g}"
    if not calls["argmax"] >= ARGMAX_LIMIT:
        yield f"the argmax is equal in {calls['argmax']:.3%} of pixels only"
    if not calls["repeats"]:
        yield "votes gave other bits in another call"


def frames(plan: Plan, device: str, wrong: list[str]) -> Part:
    """Pictures per second of every renderer, each in a process of its own: drivers may crash.

    Raises:
        InputError: there is no GPU to draw on.
    """
    environment = {"MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    if device == "cuda":
        chosen = choice.choose(("egl", "osmesa"))
        if chosen.note or not choice.has_gpu():
            raise InputError("the GPU offers no EGL")
        environment = {"MUJOCO_GL": "egl", **chosen.environment}
    drawn = []
    for kind in ("classic", "float", "kernels", "shader"):
        for rig in plan.rigs:
            found: Part = {"kind": kind, "rig": rig} | _drawn(kind, rig, plan.frame_s, environment)
            if not max(found.get("apart", (0.0,))) <= LIGHT_LIMIT:
                wrong.append(f"{kind}, {rig}: off by {found['apart']} from the kernels")
            drawn.append(found)
    return {"drawn": drawn}


def _drawn(kind: str, rig: str, seconds: float, environment: dict[str, str]) -> Part:
    program = str(Path(__file__).with_name("gpu_draw.py"))
    try:
        done = subprocess.run(
            [sys.executable, program, kind, rig, str(seconds)], env=os.environ | environment,
            capture_output=True, text=True, errors="replace", timeout=_DRAWING_LIMIT_S + seconds,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return {"per_s": None, "drawn_by": "no answer in time"}
    lines = [line for line in done.stdout.splitlines() if line.startswith("{")]
    if done.returncode or not lines:
        said = (done.stderr or done.stdout).strip().splitlines() or ["silent"]
        return {"per_s": None, "drawn_by": f"exit {done.returncode}: {said[-1][:160]}"}
    found: Part = json.loads(lines[-1])
    return found


PARTS = {"whole": whole, "frames": frames}


def measured(plan: Plan, device: str) -> Iterator[Part]:
    """Measures part by part; yields the report so far after each. What fails counts as wrong."""
    report: Part = {
        "schema_version": SCHEMA_VERSION, "quick": plan == QUICK, "device": device,
        "measured": datetime.now(UTC).isoformat(timespec="seconds"), "machine": machine(device),
    }  # fmt: skip
    wrong: list[str] = []
    for name, part in PARTS.items():
        try:
            report[name] = part(plan, device, wrong)
        except InputError as error:
            report[name] = {"skipped": str(error)}
        except Exception as error:  # a rare machine should give its other figures all the same
            report[name] = {"skipped": f"{type(error).__name__}: {error}"}
            wrong.append(f"{name}: {report[name]['skipped']}")
        yield report | {"wrong": wrong}


def machine(device: str) -> str:
    """Processors, libraries, and the GPU as its driver names it."""
    gpu = "No GPU"
    if device == "cuda":
        said = subprocess.run(_SMI, capture_output=True, text=True, check=False).stdout
        gpu = ", driver ".join(word.strip() for word in said.split(",")) or "unknown GPU"
    cores, known = len(os.sched_getaffinity(0)), versions()
    load = f"{cores} cores of {processor()}, load average {os.getloadavg()[0]:.1f}"
    return f"{gpu}; {load}; Python {known['python']}, numba {known['numba']}"


def text(report: Part) -> str:
    """All tables, as Markdown; what was not measured says why."""
    trial = "A trial: these figures mean nothing. " if is_trial(report) else ""
    parts = [f"{trial}{report['machine']}. Measured {report['measured']}."]
    parts += [f"**Wrong:** {sentence}." for sentence in report["wrong"]]
    for name, table in (("whole", _calls), ("frames", _frames)):
        if found := report.get(name):
            reason = found.get("skipped")
            parts.append(f"Not measured: {name}, {reason}." if reason else table(found))
    return "\n\n".join(parts)


def is_trial(report: Part) -> bool:
    """Whether the script was only tried: tiny, or without a GPU."""
    return bool(report["quick"] or report["device"] != "cuda")


def _calls(part: Part) -> str:
    load, calls = part["load"], part["calls"]
    stages = list(calls["cpu"]["stages_s"])
    lines = []
    for name, one in calls.items():
        took_s, held = one["median_s"], "–"
        if name != "cpu":
            held = "yes" if 1e3 * took_s <= LIMIT_MS else "**no**"
        ms = [f"{1e3 * one['stages_s'].get(stage, 0):.4g}" for stage in stages]
        far = [f"{one['volume']:.2g}", f"{one['argmax']:.4%}"] if "volume" in one else ["–", "–"]
        lines.append([
            NAMES[name], f"{one['first_s']:.2f} s", f"{1e3 * took_s:.4g} ms", held, *ms,
            "yes" if one["repeats"] else "no", *far,
        ])  # fmt: skip
    width, height = load["size_px"]
    head = (
        f"{load['events'] / 1e6:g} M events, {width}×{height} px, {load['planes']} planes, six "
        "functions and both cameras alone; from events in memory to depth maps in memory.\n\n"
    )
    columns = ["by", "first call", "median call", f"≤ {LIMIT_MS:g} ms"]
    columns += [f"{stage}, ms" for stage in stages]
    columns += ["same bits each time", "DSI off, of its maximum", "argmax equal"]
    return head + _table(columns, lines)


def _frames(part: Part) -> str:
    drawn, lines = part["drawn"], []
    for one in drawn:
        if one["per_s"] is not None:
            off = ", ".join(f"{value:.2g}" for value in one.get("apart", ())) or "–"
            lines.append([one["kind"], one["rig"], f"{one['per_s']:.3g}", off])
    table = _table(["renderer", "camera of", "pictures/s", "light, depth from kernels'"], lines)
    by = dict.fromkeys((one["kind"], one["per_s"] is None, one["drawn_by"]) for one in drawn)
    said = [f"- {kind}: {'not measured, ' * missing}{words}" for kind, missing, words in by]
    return table + "\n" + "\n".join(said) + "\n"


def _table(columns: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rule = ["---", *("--:" for _ in columns[1:])]
    return "\n".join(f"| {' | '.join(row)} |" for row in (columns, rule, *lines)) + "\n"


def read(path: Path) -> Part:
    """Reads what `--out` wrote.

    Raises:
        InputError: no such file, no JSON, or another version's.
    """
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path}: cannot be read ({error}): name what --out wrote") from error
    if not isinstance(report, dict) or report.get("schema_version") != SCHEMA_VERSION:
        raise InputError(f"{path}: no report of schema version {SCHEMA_VERSION}: measure again")
    return report


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "plugins/cuda/cuda.md#gpu": Code(
            ("bench_gpu:PARTS", "bench_gpu:text", "gpu_draw:main"), code_of_device("cuda")[0]
        )
        + of_scenes(["desk"])
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures or reads, prints the tables, and fills the page where one is named."""
    parser = argparse.ArgumentParser(prog="python tests/benchmarks bench_gpu", description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON to write; must not exist, but for --force")
    parser.add_argument("--from", dest="source", type=Path, help="JSON to read; measures nothing")
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: only that it runs")
    parser.add_argument("--device", choices=["cuda", "cpu"], default="cuda", help="cpu: a trial")
    parser.add_argument("--force", action="store_true", help="replace FILE.json")
    with exit_code() as ended:
        ended.value = _run(parser.parse_args(arguments))
    return ended.value


def _run(asked: argparse.Namespace) -> int:
    if (asked.out is None) == (asked.source is None):
        raise InputError("name a file to write with --out, or one to read with --from")
    report = read(asked.source) if asked.source else _written(asked)
    sys.stdout.write(text(report))
    if asked.page is not None:
        if is_trial(report):
            raise InputError("a trial is no measurement: its figures stay off the page")
        into_page(asked.page, "gpu", text(report), code)
    for sentence in report["wrong"]:
        sys.stderr.write(f"wrong: {sentence}\n")
    return _WRONG if report["wrong"] else 0


def _written(asked: argparse.Namespace) -> Part:
    choose_device(asked.device)
    check_output(asked.out, force=asked.force)
    report: Part = {}
    for report in measured(QUICK if asked.quick else Plan(), asked.device):
        with atomic_path(asked.out) as partial:
            partial.write_text(json.dumps(report, indent=1), encoding="utf-8")
    return report


if __name__ == "__main__":
    sys.exit(main())
