"""What the GPU gives: `python tests/benchmarks bench_gpu --out FILE.json`.

The page is docs/performance.md.

Prints tables and writes JSON after every part, so that a run that is stopped leaves what it has.
Exit code 1 where a result is wrong, 2 where nothing can be measured, 0 otherwise, slow or not.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import gpu_tables
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.eval.cli.exit_codes import exit_code
from gpu_machine import check_device, machine
from gpu_parts import Bench
from gpu_plan import QUICK, BenchmarkPlan

_WRONG = 1


def run(bench: Bench, budget_s: float, only: Sequence[str] = ()) -> Iterator[dict[str, Any]]:
    """Measures part by part; yields the report so far after each.

    A part that cannot be measured says why, as does one whose turn comes after the time is spent.
    One that fails counts as wrong, and the others go on.
    """
    begin = time.monotonic()
    report: dict[str, Any] = {
        "schema_version": gpu_tables.SCHEMA_VERSION,
        "measured": datetime.now(UTC).isoformat(timespec="seconds"),
        "quick": bench.plan == QUICK,
        "device": bench.device,
        "machine": machine(bench.device),
        "parts": {},
    }
    for name, measure in bench.parts().items():
        if only and name not in only:
            continue
        spent_s = time.monotonic() - begin
        try:
            if spent_s > budget_s:
                raise InputError(f"{spent_s:.0f} s of {budget_s:.0f} were spent: raise --budget-s")
            part = measure()
        except InputError as error:
            part = {"skipped": str(error)}
        except Exception as error:  # a rare machine should give its other figures all the same
            traceback.print_exc()
            reason = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
            part = {"failed": reason}
            bench.wrong.append(f"{name}: {reason}")
        report["parts"][name] = part | {"took_s": time.monotonic() - begin - spent_s}
        yield report | {"wrong": list(bench.wrong), "took_s": time.monotonic() - begin}


def write_json(path: Path, report: dict[str, Any]) -> None:
    """Writes the report, whole or not at all; a number that is none becomes null."""
    with atomic_path(path) as partial:
        partial.write_text(json.dumps(_plain(report), indent=1, allow_nan=False), encoding="utf-8")


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(one) for one in value]
    return None if isinstance(value, float) and not abs(value) < float("inf") else value


def main(arguments: Sequence[str] | None = None) -> int:
    """Measures or reads, prints the tables, and fills the page where one is named."""
    parser = argparse.ArgumentParser(prog="python tests/benchmarks bench_gpu", description=__doc__)
    parser.add_argument("--out", type=Path, help="JSON to write; must not exist, but for --force")
    parser.add_argument("--from", dest="source", type=Path, help="JSON to read; measures nothing")
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    parser.add_argument("--quick", action="store_true", help="tiny sizes: only that it runs")
    parser.add_argument("--device", choices=["cuda", "cpu"], default="cuda", help="cpu: a trial")
    parser.add_argument("--only", action="append", default=[], metavar="PART", help="repeatable")
    parser.add_argument("--budget-s", type=float, default=420, help="no part begins after, s")
    parser.add_argument("--force", action="store_true", help="replace FILE.json")
    with exit_code() as code:
        code.value = _run(parser.parse_args(arguments))
    return code.value


def _run(asked: argparse.Namespace) -> int:
    if (asked.out is None) == (asked.source is None):
        raise InputError("name a file to write with --out, or one to read with --from")
    if asked.page is not None and (asked.quick or asked.device != "cuda"):
        raise InputError("a trial is no measurement: leave out --page, --quick and --device cpu")
    report = gpu_tables.read(asked.source) if asked.source else _measured(asked)
    sys.stdout.write(gpu_tables.text(report))
    if asked.page is not None:
        gpu_tables.into(asked.page, report)
    for sentence in report["wrong"]:
        sys.stderr.write(f"wrong: {sentence}\n")
    return _WRONG if report["wrong"] else 0


def _measured(asked: argparse.Namespace) -> dict[str, Any]:
    check_device(asked.device)
    check_output(asked.out, force=asked.force, folder=False)
    bench = Bench(QUICK if asked.quick else BenchmarkPlan(), asked.device)
    unknown = set(asked.only) - set(bench.parts())
    if unknown:
        raise InputError(
            f"part {', '.join(sorted(unknown))}: choose from {', '.join(bench.parts())}"
        )
    report: dict[str, Any] = {}
    for report in run(bench, asked.budget_s, asked.only):
        write_json(asked.out, report)
        name, part = list(report["parts"].items())[-1]
        words = part.get("skipped") or part.get("failed") or "done"
        sys.stderr.write(f"{name}: {words}, {part['took_s']:.1f} s\n")
    return report


if __name__ == "__main__":
    sys.exit(main())
