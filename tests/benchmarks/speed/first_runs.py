"""CPU seconds of first and later runs: `python tests/benchmarks first_runs --page docs/gate.md`.

Runs the suite that the gate runs, `run desk`, and the recipe as it stands on the page: *cold* with
empty caches, *warm* with the compiled kernels and textures of the run before, and no results.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import show
from simulate_stages import machine
from table_code import ROOT, Code, of_suite

MARK = "first-runs"
_TEXTURES = "textures"
_SECTION = "## Gate your mapper in CI"
_BLOCK = re.compile(r"^```sh\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def recipe(page: str) -> str:
    """The recipe's commands as they stand on the page.

    Raises:
        InputError: there are none.
    """
    section = page.partition(f"{_SECTION}\n")[2].partition("\n## ")[0]
    lines = "".join(_BLOCK.findall(section))
    if "eventsweep simulate" not in lines or "eventsweep gate" not in lines:
        raise InputError(f"docs/gate.md: no recipe in `sh` blocks of {_SECTION!r}: restore them")
    return lines


def lines_of(page: str) -> dict[str, str]:
    """What is run, by its name in the table: lines of the shell, in an empty folder."""
    baseline = shlex.quote(str(ROOT / "reports/baseline.json"))
    return {
        "the recipe above": recipe(page),
        # Red is 1: it did all its work.
        "`gate`, without `--result`": f"eventsweep gate --baseline {baseline} || test $? = 1\n",
        "`run desk`": "eventsweep run desk --out out\n",
    }


def spent_s(lines: str, home: Path) -> float:
    """Processor time of commands, their processes' included, s; caches lie in `home`.

    Raises:
        InputError: a command failed.
    """
    programs = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    places = {"XDG_CACHE_HOME": str(home / "user"), "EVENTSWEEP_CACHE": str(home / "cache")}
    unset = {"NUMBA_CACHE_DIR", "GITHUB_STEP_SUMMARY"}
    known = {name: value for name, value in os.environ.items() if name not in unset}
    before = _children_s()
    with tempfile.TemporaryDirectory(dir=home) as folder:
        done = subprocess.run(
            ["sh", "-ec", lines], cwd=folder, env=known | places | {"PATH": programs},
            capture_output=True, text=True, check=False,
        )  # fmt: skip
    if done.returncode or "Traceback" in done.stderr:
        raise InputError(f"exit code {done.returncode} of `{lines}`: {done.stderr[-500:]}")
    return _children_s() - before


def forget_results(home: Path) -> None:
    """Removes what jobs made; textures stay, as kernels do."""
    for entry in (home / "cache").iterdir():
        if entry.name != _TEXTURES:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()


def cold_and_warm_s(lines: str) -> tuple[float, float]:
    """Processor time with empty caches, and once more without results."""
    with tempfile.TemporaryDirectory() as folder:
        home = Path(folder)
        cold = spent_s(lines, home)
        forget_results(home)
        return cold, spent_s(lines, home)


def table(page: str) -> str:
    """The block of the page."""
    about = machine()
    rows = [f"{about}\n\n| CPU seconds | cold | warm |\n|---|--:|--:|"]
    for name, lines in lines_of(page).items():
        cold, warm = cold_and_warm_s(lines)
        rows.append(f"| {name} | {cold:.0f} | {warm:.0f} |")
    return "\n".join(rows) + "\n"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {f"docs/gate.md#{MARK}": Code(("first_runs:table",)) + of_suite("suite-v5")}


def _children_s() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main() -> int:
    """Measures and writes the table; 2 where a command fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--page", type=Path, help="page between whose marks the table goes")
    asked = parser.parse_args()
    with exit_code() as ended:
        page = (ROOT / "docs/gate.md").read_text("utf-8")
        show(table(page), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
