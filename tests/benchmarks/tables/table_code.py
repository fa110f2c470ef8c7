"""Which code the numbers of a generated table come from, and its hash over any checkout.

A tool declares it beside itself as `code()`: page and mark -> `Code`. Of tools and of what tests
share, single functions count, with what they use; of the product whole modules, as for jobs
(`eval.jobs.code_version`). Comments, layout and doc strings change nothing.
"""

from __future__ import annotations

import ast
import hashlib
import importlib
import json
import tomllib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from functools import cache, cached_property
from pathlib import Path

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.eval.jobs import code_version
from eventsweep.eval.jobs.job import Job, order
from eventsweep.eval.stages import map as mapping
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.sim.mjcf import files_of

ROOT = Path(__file__).resolve().parents[3]
EXACT = "exact"
"""Instead of a hash: made of the code in seconds, and held equal to it by tests."""
FOREIGN = ("eventsweep.emvs.formats",)
"""What reads others' events and calibrations: simulated sequences never pass it."""
DRAWS = "eventsweep.plugins.raster.drawing"
"""What draws where there is no GPU: loaded by its entry point."""
_TOOLS = ("tests/**/*.py", "plugins/*/tests/**/*.py", "docs/figures/*.py")
_PACKAGE = "eventsweep"
Name = tuple[str, str]


@dataclass(frozen=True)
class Code:
    """What decides a table's numbers; nothing at all for a table that tests hold equal to the code.

    Attributes:
        functions: `MODULE:NAME` in tools, or in what tests share, that compute and write numbers.
        modules: of the product, beyond those that the functions import: what is loaded by name.
        files: paths in the checkout; `PATH#TABLE` for one table of a TOML file.
        data: a committed file with the numbers, or another table: this one is as old as that.
        without: packages of the product that are imported, but never run for these numbers.
    """

    functions: tuple[str, ...] = ()
    modules: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    data: str = ""
    without: tuple[str, ...] = ()

    def __add__(self, other: Code) -> Code:
        """Both together."""
        return Code(*(getattr(self, one.name) + getattr(other, one.name) for one in fields(self)))

    def digest(self, root: Path = ROOT) -> str:
        """Hash of this code in a checkout, 16 hexadecimal digits; `EXACT` where there is none."""
        if not (self.functions or self.modules or self.files):
            return EXACT
        lines = [f"{name} {digest}" for name, digest in sorted(self.parts(root).items())]
        return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]

    def parts(self, root: Path = ROOT) -> dict[str, str]:
        """Hashes by module, function of a tool, and file: what differs says what changed."""
        tools = Tools(root)
        found = {f"{stem}:{name}": digest for (stem, name), digest in tools.used(self).items()}
        found |= _reached(_package(root), (*self.modules, *tools.modules), self.without)
        return found | {file: _file_digest(root, file) for file in self.files}


def of_scenes(names: Iterable[str]) -> Code:
    """Modules and models of scenes, and what draws them where there is no GPU."""
    chosen = sorted(set(names))
    models = (path for name in chosen for path in files_of(scenes.load(name).mjcf))
    modules = (*map(scenes.module_of, chosen), DRAWS)
    return Code(modules=modules, files=_in_checkout(models), without=FOREIGN)


def of_jobs(jobs: Iterable[Job]) -> Code:
    """What jobs, and those that they need, run and read."""
    modules: set[str] = set()
    files: set[str] = set()
    for job in order(jobs):
        reached = getattr(importlib.import_module(job.stage), "code", None)
        more, read = reached(job.parameters) if reached else ((), ())
        modules |= {job.stage, *more}
        files |= set(_in_checkout(read))
    return Code(modules=tuple(sorted(modules)), files=tuple(sorted(files)), without=FOREIGN)


def of_methods(names: Iterable[str]) -> Code:
    """Plug-ins and weights of methods, and what says how reliable their depths are."""
    config = MapperConfig(methods=tuple(names))
    modules, files = mapping.code({"map": config.model_dump(mode="json")})
    return Code(modules=tuple(modules), files=_in_checkout(files))


def of_suite(name: str) -> Code:
    """What the jobs of a suite run and read, and its definition."""
    suite, _ = load(name)
    definition = f"eval/suite/definitions/{name}.toml"
    return of_jobs(suite_jobs(suite, tuple(suite.cases), [0])) + Code(files=(definition,))


class Tools:
    """Functions of tools in a checkout: what they use of each other and of the product."""

    def __init__(self, root: Path) -> None:
        self._root, self._files = root, _tool_files(root)
        self.modules: set[str] = set()
        self._used: dict[Name, str] = {}
        self._tops: dict[str, dict[str, ast.stmt]] = {}

    def used(self, code: Code) -> dict[Name, str]:
        """Hash of every function, class and constant that a declaration reaches."""
        waiting = [(stem, name) for stem, _, name in (one.partition(":") for one in code.functions)]
        while waiting:
            at = waiting.pop()
            if at not in self._used:
                node = self._top(at[0]).get(at[1])
                self._used[at] = "absent" if node is None else _says(node)
                waiting += [] if node is None else self._uses(at[0], node)
        return self._used

    def _uses(self, stem: str, node: ast.stmt) -> Iterator[Name]:
        for one in _said(node):
            if isinstance(one, ast.Import | ast.ImportFrom):
                yield from self._imported(one, None, ())
            elif isinstance(one, ast.Name):
                bound = self._top(stem).get(one.id)
                if isinstance(bound, ast.Import | ast.ImportFrom):
                    yield from self._imported(bound, one.id, _attributes(node, one.id))
                elif bound is not None:
                    yield stem, one.id

    def _imported(
        self, node: ast.Import | ast.ImportFrom, name: str | None, attributes: Iterable[str]
    ) -> Iterator[Name]:
        """Functions of tools behind an import; modules of the product are noted.

        Args:
            node: the import.
            name: as the code calls what it uses of it; None for all.
            attributes: what is used of a module.
        """
        whole = node.module or "" if isinstance(node, ast.ImportFrom) else ""
        for alias in node.names:
            if name not in (None, alias.asname or alias.name.partition(".")[0]):
                continue
            if (whole or alias.name).partition(".")[0] == _PACKAGE:
                self.modules |= set(self._of_product(whole, alias.name, attributes))
            elif whole in self._files:
                yield whole, alias.name
            elif not whole and alias.name in self._files:
                yield from ((alias.name, one) for one in attributes or self._top(alias.name))

    def _of_product(self, whole: str, name: str, attributes: Iterable[str]) -> Iterator[str]:
        """The modules behind a name of the product; `eventsweep` itself lists where names are."""
        if whole or name != _PACKAGE:
            inner, package = f"{whole}.{name}" if whole else name, _package(self._root)
            yield from (one for one in (whole, inner) if one != _PACKAGE and _file(package, one))
        else:
            yield from (self._places[one] for one in attributes if one in self._places)

    def _top(self, stem: str) -> dict[str, ast.stmt]:
        """What a module binds at its top, by name."""
        if stem not in self._tops:
            file = self._files.get(stem)
            self._tops[stem] = _bound(file, _changed_ns(file)) if file else {}
        return self._tops[stem]

    @cached_property
    def _places(self) -> dict[str, str]:
        listed = self._root / _PACKAGE / "__init__.pyi"
        body = ast.parse(listed.read_bytes()).body if listed.is_file() else []
        nodes = [node for node in body if isinstance(node, ast.ImportFrom)]
        return {
            alias.name: f"{_PACKAGE}.{node.module or alias.name}"
            for node in nodes for alias in node.names
        }  # fmt: skip


def _reached(package: Path, roots: Iterable[str], without: Iterable[str]) -> dict[str, str]:
    """Hashes of modules of the product, and of all that they import, as of a job's."""
    left_out = tuple(f"{name}." for name in without)
    found: dict[str, str] = {}
    waiting = list(roots)
    while waiting:
        name = waiting.pop()
        if name not in found and not f"{name}.".startswith(left_out):
            file = _file(package, name)
            imports, found[name] = _parsed(file, _changed_ns(file)) if file else ((), "absent")
            waiting += [one for one in imports if one[0] != "?"]
            waiting += [one[1:] for one in imports if one[0] == "?" and _file(package, one[1:])]
    return found


@cache
def _file(package: Path, name: str) -> Path | None:
    at = package.joinpath(*name.split(".")[1:])
    return next(filter(Path.is_file, (at / "__init__.py", at.with_suffix(".py"))), None)


def _changed_ns(file: Path) -> int:
    return file.stat().st_mtime_ns


@cache
def _parsed(file: Path, _changed_ns: int) -> tuple[tuple[str, ...], str]:
    return code_version._parsed(file)


@cache
def _says(node: ast.AST) -> str:
    words: list[str] = []
    code_version._add_words(node, words, [])
    return code_version._digest(words)


@cache
def _tool_files(root: Path) -> dict[str, Path]:
    found = (path for pattern in _TOOLS for path in sorted(root.glob(pattern)))
    return {path.stem: path for path in found}


@cache
def _bound(file: Path, _changed_ns: int) -> dict[str, ast.stmt]:
    body = ast.parse(file.read_bytes()).body
    return {name: node for node in body for name in _binds(node)}


def _said(node: ast.AST) -> Iterator[ast.AST]:
    """A syntax tree's nodes, without the types that functions state of themselves."""
    yield node
    for name, value in ast.iter_fields(node):
        if name not in ("annotation", "returns"):
            parts = value if isinstance(value, list) else [value]
            yield from (one for part in parts if isinstance(part, ast.AST) for one in _said(part))


def _attributes(node: ast.stmt, name: str) -> list[str]:
    """What of `name` a statement takes by a dot."""
    dotted = (one for one in ast.walk(node) if isinstance(one, ast.Attribute))
    return [d.attr for d in dotted if isinstance(d.value, ast.Name) and d.value.id == name]


def _binds(node: ast.stmt) -> Iterator[str]:
    match node:
        case ast.FunctionDef(name=name) | ast.ClassDef(name=name):
            yield name
        case ast.Import(names=names) | ast.ImportFrom(names=names):
            yield from (alias.asname or alias.name.partition(".")[0] for alias in names)
        case ast.Assign(targets=targets):
            named = (one for target in targets for one in ast.walk(target))
            yield from (one.id for one in named if isinstance(one, ast.Name))
        case ast.AnnAssign(target=ast.Name(id=name)):
            yield name


def _package(root: Path) -> Path:
    """The package's folder; before it had one, the checkout itself."""
    inner = root / _PACKAGE
    return inner if (inner / "emvs").exists() else root


def _in_checkout(paths: Iterable[Path]) -> tuple[str, ...]:
    return tuple(path.resolve().relative_to(ROOT).as_posix() for path in paths)


def _file_digest(root: Path, file: str) -> str:
    path, _, table = file.partition("#")
    at = root / path
    if not at.is_file():
        return "absent"
    content = at.read_bytes()
    if at.suffix == ".toml":
        whole = tomllib.loads(content.decode())
        content = json.dumps(whole.get(table) if table else whole, default=str).encode()
    return hashlib.sha256(content).hexdigest()
