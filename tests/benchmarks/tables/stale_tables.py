"""Which generated tables are older than their code: `python tests/benchmarks stale_tables`.

Compares the hash of the code that each tool declares with that in `docs/measured.toml`, and writes
the list into the page; with `--check` it only says whether that is out of date. `--why` names what
changed since the tables' commits. `--made PAGE#MARK=COMMIT` notes that a table is of that commit.
"""

from __future__ import annotations

import argparse
import importlib
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import cache
from itertools import groupby
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import refresh
from measured import UNKNOWN, entries, git, write
from table_code import ROOT, Code

PAGE, MARK = "docs/architecture.md", "stale"
COMMAND = "python tests/benchmarks stale_tables"
_FIGURES = ROOT / "docs" / "figures"
_PAGES = ("README.md", "docs/*.md", "plugins/*/*.md")
_BEGIN = re.compile(r"^<!-- ([\w-]+): begin -->$", re.MULTILINE)
_DECLARES = re.compile(r"^def code\(\)", re.MULTILINE)


def blocks(root: Path = ROOT) -> list[str]:
    """Every generated block of the pages, as `PAGE#MARK`."""
    pages = [path for pattern in _PAGES for path in sorted(root.glob(pattern))]
    return [
        f"{page.relative_to(root).as_posix()}#{mark}"
        for page in pages
        for mark in _BEGIN.findall(page.read_text("utf-8"))
    ]


@cache
def declared() -> Mapping[str, Code]:
    """What the tools say that their tables depend on, by page and mark.

    Raises:
        InputError: two tools declare the same table.
    """
    sys.path.append(str(_FIGURES))
    found = code()
    for path in sorted((*ROOT.glob("tests/benchmarks/*/*.py"), *_FIGURES.glob("*.py"))):
        if path != Path(__file__).resolve() and _DECLARES.search(path.read_text("utf-8")):
            own = importlib.import_module(path.stem).code()
            if twice := sorted(own.keys() & found.keys()):
                raise InputError(f"{path}: {twice[0]} is another tool's as well; declare it once")
            found |= own
    return found


def digest_of(key: str, root: Path = ROOT) -> str:
    """Hash of a table's code in a checkout; of a table made from another one, of that one's."""
    one = declared()[key]
    return declared()[one.data].digest(root) if one.data in declared() else one.digest(root)


def stale(root: Path = ROOT) -> dict[str, str]:
    """Tables whose code has changed, or is not known, and the commits that they are of."""
    known = entries(root)
    return {
        key: known.get(key, {}).get("commit", UNKNOWN)
        for key in sorted(declared())
        if known.get(key, {}).get("code") != digest_of(key, root)
    }


def listed(found: Mapping[str, str]) -> str:
    """The list as Markdown, a line per page."""
    lines = ["| Page | Tables, made at |", "|---|---|"]
    for page, keys in groupby(found, lambda key: key.partition("#")[0]):
        link = "../" + page if not page.startswith("docs/") else page.removeprefix("docs/")
        tables = ", ".join(f"{key.partition('#')[2]} `{found[key]}`" for key in keys)
        lines.append(f"| [{Path(page).stem}]({link}) | {tables} |")
    return "\n".join(lines) + "\n" if found else "None.\n"


def code() -> dict[str, Code]:
    """The list itself is held to be that of the code."""
    return {f"{PAGE}#{MARK}": Code()}


@contextmanager
def checkout_at(commit: str) -> Iterator[Path]:
    """A folder with the files of a commit.

    Raises:
        InputError: there is no such commit.
    """
    with tempfile.TemporaryDirectory() as name:
        packed = Path(name) / "files.tar"
        asked = ["git", "-C", str(ROOT), "archive", "-o", str(packed), commit]
        done = subprocess.run(asked, capture_output=True, text=True, check=False)
        if done.returncode:
            raise InputError(f"no commit {commit}: {done.stderr.strip()}; fetch the whole history")
        root = Path(name) / "files"
        root.mkdir()
        subprocess.run(["tar", "-xf", str(packed), "-C", str(root)], check=True)
        yield root


def note(made: Sequence[str]) -> None:
    """Takes tables as made at commits, `PAGE#MARK=COMMIT`, by the code that those have."""
    pairs = [text.rpartition("=")[::2] for text in made]
    if unknown := [key for key, _ in pairs if key not in declared()]:
        raise InputError(f"no table {unknown[0]!r}: choose from {', '.join(sorted(declared()))}")
    found = entries(ROOT)
    for commit in dict.fromkeys(commit for _, commit in pairs):
        with checkout_at(commit) as root:
            short = git(ROOT, "rev-parse", "--short=8", commit).strip()
            for key in (key for key, of in pairs if of == commit):
                made_by = {"code": digest_of(key, root), "commit": short}
                found[key] = {**found.get(key, {}), **made_by}
    write(ROOT, found)


def reasons(found: Mapping[str, str]) -> Iterator[str]:
    """A line per stale table: what its code is made of that differs from its commit's."""
    for key, commit in found.items():
        if commit == UNKNOWN:
            yield f"{key}: of an unknown commit"
            continue
        with checkout_at(commit.rstrip("+")) as root:
            one = declared()[key]
            one = declared().get(one.data, one)
            before, now = one.parts(root), one.parts()
            names = sorted(n for n in before.keys() | now.keys() if before.get(n) != now.get(n))
            yield f"{key}: {len(names)} parts differ since {commit}: {', '.join(names)}"


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes or checks the list; 1 where a check finds it out of date, 2 on bad input."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("--check", action="store_true", help="write nothing")
    parser.add_argument("--why", action="store_true", help="name what changed; needs git")
    parser.add_argument("--made", nargs="+", default=(), metavar="PAGE#MARK=COMMIT")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        if asked.made:
            note(asked.made)
        found = stale()
        lines = reasons(found) if asked.why else (f"{key}: {of}" for key, of in found.items())
        for line in lines:
            sys.stdout.write(f"{line}\n")
        ended.value = refresh(
            ROOT / PAGE, MARK, listed(found), code, check=asked.check, command=COMMAND
        )
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
