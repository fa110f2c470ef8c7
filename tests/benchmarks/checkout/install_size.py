"""What the environment weighs, by distribution, and which of them nothing imports.

Run by the Python of the environment in question; it needs nothing but the standard library:
PYTHON tests/benchmarks/checkout/install_size.py [--most MB] [--brief]

A distribution is imported at once if a module of it is loaded when every module has been imported
that the code of eventsweep's packages names anywhere, also inside functions. It is imported on
demand if the code of such a distribution, which requires it, names a module of it somewhere, as
matplotlib does with contourpy. Otherwise nothing imports it.

With --most, ends with 1 where the environment weighs more.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import importlib.util
import re
import sys
import sysconfig
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

INSTALLERS = {"pip", "setuptools"}
"""They come with the environment itself."""


@dataclass(frozen=True)
class Weighed:
    """A distribution.

    Attributes:
        name: as `requires` names it: lower case, hyphens.
        size_bytes: of its files, compiled ones included.
        files: where they are.
    modules: top-level names that it brings.
        requires: names of others, those of extras left out.
    """

    name: str
    size_bytes: int
    files: frozenset[str]
    modules: frozenset[str]
    requires: frozenset[str]


def normal(name: str) -> str:
    """A distribution's name as everybody may write it, in one form."""
    return re.sub(r"[-_.]+", "-", name).lower()


def weigh(package: metadata.Distribution) -> Weighed:
    """Sums up what a distribution says that it installed."""
    paths = [Path(str(package.locate_file(file))) for file in package.files or ()]
    there = [path.resolve() for path in paths if path.is_file()]
    needs = [line for line in package.requires or () if "extra ==" not in line]
    names = {normal(re.split(r"[^\w.-]", line, maxsplit=1)[0]) for line in needs}
    size = sum(path.stat().st_size for path in there)
    tops = {file.parts[0].partition(".")[0] for file in package.files or ()}
    return Weighed(
        normal(package.name), size, frozenset(map(str, there)), frozenset(tops), frozenset(names)
    )


def named_modules(files: Iterable[Path]) -> set[str]:
    """Modules that some Python files import, anywhere in their code, by their dotted names."""
    trees = (ast.parse(path.read_text("utf-8")) for path in files)
    return {name for tree in trees for node in ast.walk(tree) for name in _named(node)}


def _named(node: ast.AST) -> list[str]:
    """What one piece of code imports: `import a`, `from a import b`, `import_module("a")`."""
    if isinstance(node, ast.Import):
        return [alias.name for alias in node.names]
    if isinstance(node, ast.ImportFrom) and node.module and not node.level:
        return [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
    if isinstance(node, ast.Call) and ast.unparse(node.func).endswith("import_module"):
        return [str(argument.value) for argument in node.args if isinstance(argument, ast.Constant)]
    return []


def load(names: Iterable[str]) -> None:
    """Imports what there is of these modules; names of functions and classes are none."""
    for name in sorted(names):
        try:
            importlib.import_module(name)
        except (ImportError, OSError):  # an extra that is not installed, or its system library
            continue


def loaded_files() -> set[str]:
    """The files of all modules that this process has imported."""
    files = (getattr(module, "__file__", None) for module in [*sys.modules.values()])
    return {str(Path(file).resolve()) for file in files if file}


def own_folders() -> list[Path]:
    """Where our package is in this environment, and its parts where they are links."""
    spec = importlib.util.find_spec("eventsweep")
    if spec is None or spec.origin is None:
        return []
    home = Path(spec.origin).parent
    return [home, *(path for path in home.iterdir() if path.is_symlink())]


def imported(packages: Sequence[Weighed], loaded: set[str]) -> dict[str, str]:
    """How each distribution is imported: `at once`, `by X, on demand`, or `never`."""
    how = {package.name: "at once" if package.files & loaded else "never" for package in packages}
    users = [package for package in packages if how[package.name] == "at once"]
    while users:  # what they import on demand may import more
        user = users.pop()
        unused = [package for package in packages if how[package.name] == "never"]
        waiting = [package for package in unused if package.name in user.requires]
        if not waiting:
            continue
        code = named_modules(Path(file) for file in user.files if file.endswith(".py"))
        named = {name.partition(".")[0] for name in code}
        for package in (package for package in waiting if package.modules & named):
            how[package.name] = f"by {user.name}, on demand"
            users.append(package)
    return how


def lines(packages: Sequence[Weighed], how: Mapping[str, str], *, brief: bool) -> Iterator[str]:
    """The table, largest first; `brief` leaves out what is imported and below 10 MB."""
    yield "| distribution | MB | imported | required by |"
    yield "|---|--:|---|---|"
    for package in sorted(packages, key=lambda package: -package.size_bytes):
        if brief and how[package.name] != "never" and package.size_bytes < 10e6:
            continue
        by = ", ".join(sorted(user.name for user in packages if package.name in user.requires))
        yield f"| {package.name} | {package.size_bytes / 1e6:.1f} | {how[package.name]} | {by} |"


def main() -> int:
    """Prints the table and the sum."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--most", type=float, help="MB that the environment may weigh")
    parser.add_argument("--brief", action="store_true", help="only what is large or not imported")
    asked = parser.parse_args()
    site = sysconfig.get_path("purelib")
    everything = map(weigh, metadata.distributions(path=[site]))
    packages = [package for package in everything if package.name not in INSTALLERS]
    if not (folders := own_folders()):
        parser.error("eventsweep is not installed here: run this by the environment's own Python")
    load(named_modules(path for folder in folders for path in folder.rglob("*.py")))
    how = imported(packages, loaded_files())
    unused = [package for package in packages if how[package.name] == "never"]
    total_mb, unused_mb = (sum(p.size_bytes for p in some) / 1e6 for some in (packages, unused))
    sys.stdout.write("\n".join(lines(packages, how, brief=asked.brief)))
    sys.stdout.write(
        f"\n\nPython {sys.version.split()[0]}: {len(packages)} distributions, {total_mb:.0f} MB; "
        f"never imported: {len(unused)}, {unused_mb:.0f} MB\n"
    )
    return int(asked.most is not None and total_mb > asked.most)


if __name__ == "__main__":
    sys.exit(main())
