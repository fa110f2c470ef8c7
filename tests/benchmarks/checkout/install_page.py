"""Installs eventsweep into empty environments and writes what they weigh into a page.

Run: python tests/benchmarks install_page --page docs/install.md [--python PYTHON ...]

For each interpreter: a virtual environment, `pip install` of a wheel made of this checkout, the
size (`install_size`), and `eventsweep run planes`, which must leave a report. The first interpreter
installs the extra `mesh` as well, and makes a mesh. Lines that other machines wrote stay.
"""

from __future__ import annotations

import argparse
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.release import install
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import into_page
from table_code import Code

ROOT = Path(__file__).resolve().parents[3]
SIZE = Path(__file__).with_name("install_size.py")
LAST_LINE = re.compile(
    r"Python (?P<python>\S+): (?P<count>\d+) distributions, (?P<mb>\d+) MB; "
    r"never imported: (?P<unused>\d+)"
)
ROW = re.compile(r"^\| 3\..*$", re.MULTILINE)


@dataclass(frozen=True)
class Trial:
    """What came of one environment.

    Attributes:
        python: version of the interpreter.
        extra: name of the optional dependencies, or empty.
        count: distributions installed.
        size_mb: what they weigh.
        unused: distributions that nothing imports.
    """

    python: str
    extra: str
    count: int
    size_mb: int
    unused: int


def done(*command: str | Path, **environment: str) -> str:
    """Runs a program and returns what it prints.

    Raises:
        InputError: it failed; its last line says why.
    """
    ended = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=False,
        env=os.environ | {"PYTHONPATH": ""} | environment,
    )  # fmt: skip
    if ended.returncode:
        last = (ended.stderr or ended.stdout).strip().splitlines()[-1:]
        raise InputError(f"{' '.join(map(str, command))}: {' '.join(last)}")
    return ended.stdout


def read_size(printed: str) -> tuple[str, int, int, int]:
    """Python's version, distributions, MB and unused distributions, from `install_size`.

    Raises:
        InputError: it printed something else.
    """
    match = LAST_LINE.search(printed)
    if match is None:
        raise InputError("install_size printed no sum; run it by itself")
    return match["python"], int(match["count"]), int(match["mb"]), int(match["unused"])


def tried(python: str, wheel: Path, extra: str, folder: Path) -> Trial:
    """Installs a wheel into an empty environment, weighs that and runs the main job in it."""
    home = Path(tempfile.mkdtemp(prefix="env-", dir=folder))
    done(python, "-m", "venv", home)
    package = f"{wheel}[{extra}]" if extra else str(wheel)
    done(home / "bin/pip", "install", "--quiet", package)
    size = read_size(done(home / "bin/python", SIZE))
    run = folder / f"run-{home.name}"
    done(
        home / "bin/eventsweep", "run", "planes", "--seconds", "0.1", "--out", run, "--quiet",
        EVENTSWEEP_CACHE=str(folder / "cache"),
    )  # fmt: skip
    if not (run / "report.html").is_file():
        raise InputError(f"{home}: the main job left no report")
    if extra == "mesh":
        make_mesh(home / "bin/eventsweep", run / "planes" / "sequence", folder / "windows")
    return Trial(size[0], extra, *size[1:])


def make_mesh(program: Path, sequence: Path, out: Path) -> None:
    """Joins several windows, since one alone has no surface."""
    windows = ("--map.window-s", "0.04", "--map.stride-s", "0.02", "--method", "Alg1/H")
    done(program, "map", sequence, "--out", out, "--quiet", *windows)
    done(program, "fuse", out, "--mesh", "--voxel-m", "0.02")


def install_block() -> str:
    """The commands, from the one place that says where a release is."""
    whole, mesh = install(), install("mesh")
    return f"```sh\n{whole:{len(mesh)}}  # all but meshes\n{mesh}  # with meshes\n```\n"


def size_block(trial: Trial, before: str) -> str:
    """The table of what was tried; lines of other interpreters and systems stay as they are.

    Args:

        trial: what was tried here.
        before: the page.
    """
    system = f"{platform.system()} {platform.machine()}"
    rows = {key_of(row): row for row in ROW.findall(before)}
    extra = f"`{trial.extra}`" if trial.extra else "–"
    cells = trial.python, system, extra, trial.count, trial.size_mb, trial.unused
    row = f"| {' | '.join(map(str, cells))} |"
    rows[key_of(row)] = row
    head = (
        "| Python | System | Extra | Packages | MB | Never imported |\n|---|---|---|--:|--:|--:|\n"
    )
    return head + "\n".join(rows[key] for key in sorted(rows)) + "\n"


def key_of(row: str) -> tuple[str, str, int]:
    """What a line of the table is about: system, extra, and Python's minor version."""
    _, python, system, extra, *_ = (cell.strip() for cell in row.split("|"))
    return system, extra.strip("`–"), int(python.split(".")[1])


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "docs/install.md#commands": Code(),
        "docs/install.md#sizes": Code(
            ("install_page:read_size", "install_page:size_block", "install_size:main"),
            files=("pyproject.toml#project",),
        ),
    }


def main() -> int:
    """Tries the interpreters and writes the page; 2 where one of them fails."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--page", type=Path, required=True)
    parser.add_argument("--python", action="append", help="interpreter; by default this one's")
    parser.add_argument("--commands-only", action="store_true", help="install nothing")
    asked = parser.parse_args()
    with exit_code() as ended:
        into_page(asked.page, "commands", install_block(), code)
        if not asked.commands_only:
            for trial in trials(asked.python or [sys.executable]):
                block = size_block(trial, asked.page.read_text("utf-8"))
                into_page(asked.page, "sizes", block, code)
    return ended.value


def trials(pythons: list[str]) -> Iterator[Trial]:
    """The first interpreter with `mesh`, then every one without extras."""
    with tempfile.TemporaryDirectory(prefix="install-page-") as name:
        folder = Path(name)
        done(sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps", "-w", folder, ROOT)
        (wheel,) = folder.glob("*.whl")
        for python, extra in [(pythons[0], "mesh"), *((python, "") for python in pythons)]:
            yield tried(python, wheel, extra, folder)


if __name__ == "__main__":
    sys.exit(main())
