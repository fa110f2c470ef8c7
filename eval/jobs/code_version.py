"""Which code made a result: a hash over the source of a module and of all that it imports.

A stage's version changes when, and only when, code that the stage can reach says something else:
comments, layout and doc strings do not count, and neither does any module that it never imports.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
import json
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import default_cache
from eventsweep.emvs.utils.files import write_text

_PREFIX, _FOLDER = "eventsweep.", Path(__file__).parents[2]
_NEW: set[str] = set()
_NOT_MEANING = {"ctx", "kind", "type_comment", "type_params", "lineno", "col_offset"}


def code_version(roots: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Hashes the source of modules, of every module of this project that they import, and files.

    Imports inside functions count like those at the top. What is loaded by a computed name does
    not, so it must be among the roots. Returns 16 hexadecimal digits, the same on every machine and
    for every Python.
    """
    return source_digest(closure(roots), files)


def source_digest(modules: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Hashes the source of exactly these modules, and files."""
    lines = [f"{name.removeprefix(_PREFIX)} {_source(name)[1]}" for name in sorted(modules)]
    lines += [f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in files]
    _keep()
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def definition_digest(modules: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Hashes what modules define, and files: not their names, nor from where they import.

    It stays the same when code is moved, so that what is the same can still be compared.
    """
    lines = sorted(_definition_hash(name) for name in modules)
    lines += [hashlib.sha256(path.read_bytes()).hexdigest() for path in files]
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()[:16]


def closure(roots: Iterable[str]) -> set[str]:
    """The roots and every module of this project that they reach by imports."""
    found: set[str] = set()
    waiting = list(roots)
    while waiting:
        name = waiting.pop()
        if name not in found:
            found.add(name)
            waiting += _source(name)[0]
    return found


@cache
def _source(name: str) -> tuple[tuple[str, ...], str]:
    """What a module imports of this project, and the hash of its source.

    Both are kept in the user's cache while the file's size and time stay: parsing takes a second.
    """
    file = _file(name)
    if file is None:
        return (), "absent"
    facts = file.stat()
    state = [facts.st_mtime_ns, facts.st_size]
    known: Any = _kept().get(str(file))
    if not _is_of(known, state):
        imports, digest = _parsed(file)
        _kept()[str(file)] = known = [*state, list(imports), digest]
        _NEW.add(name)
    modules = (module for module in known[2] if module[0] != "?" or _file(module[1:]))
    return tuple(module.removeprefix("?") for module in modules), known[3]


def _is_of(known: Any, state: list[int]) -> bool:
    """Whether what was kept is whole, and of a file in this state."""
    if not isinstance(known, list) or len(known) != 4 or known[:2] != state:
        return False
    modules, digest = known[2:]
    texts = [*modules, digest] if isinstance(modules, list) else [None]
    return all(isinstance(text, str) and text for text in texts)


@cache
def _kept() -> dict[str, list[Any]]:
    with suppress(OSError, ValueError):
        stored = json.loads(_place().read_text(encoding="utf-8"))
        if isinstance(stored, dict):
            return stored
    return {}


def _keep() -> None:
    if _NEW:
        with suppress(OSError, InputError):
            _place().parent.mkdir(parents=True, exist_ok=True)
            write_text(_place(), json.dumps(_kept()))
        _NEW.clear()


def _place() -> Path:
    return default_cache() / "sources-1.json"


def _parsed(file: Path) -> tuple[tuple[str, ...], str]:
    tree = ast.parse(file.read_bytes())
    words: list[str] = []
    imports: list[ast.stmt] = []
    _add_words(tree, words, imports)
    return tuple(sorted(set(_imported(imports)))), _digest(words)


def _digest(words: list[str]) -> str:
    return hashlib.sha256("\0".join(words).encode()).hexdigest()


def _imported(imports: Iterable[ast.stmt]) -> Iterator[str]:
    """Modules of this project, and behind a question mark names that may be modules."""
    for node in imports:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and _ours(node.module):
            yield node.module
            yield from (f"?{node.module}.{alias.name}" for alias in node.names)


def _ours(name: str) -> bool:
    return name.startswith(_PREFIX)


@cache
def _file(name: str) -> Path | None:
    """The source of a module; of this project's without importing the packages that hold it."""
    if _ours(name):
        at = _FOLDER.joinpath(*name.split(".")[1:])
        return next(filter(Path.is_file, (at / "__init__.py", at.with_suffix(".py"))), None)
    spec = importlib.util.find_spec(name)
    origin = spec.origin if spec else None
    return Path(origin) if origin and origin.endswith(".py") else None


@cache
def _definition_hash(name: str) -> str:
    words: list[str] = []
    file = _file(name)
    tree = ast.parse(file.read_bytes()) if file else ast.Module([], [])
    _add_words(_WithoutImports().visit(tree), words, [])
    return _digest(words)


class _WithoutImports(ast.NodeTransformer):
    def visit_Import(self, _node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, _node: ast.ImportFrom) -> None:
        return None


def _add_words(node: object, words: list[str], imports: list[ast.stmt]) -> None:
    """Appends what a syntax tree says, without places, doc strings and what Pythons call anew.

    Imports name modules by their place in the repository; they are collected, too.
    """
    if isinstance(node, ast.AST):
        if isinstance(node, ast.Import | ast.ImportFrom):
            imports.append(node)
        words.append(f"({type(node).__name__}")
        for field in node._fields:
            value = None if field in _NOT_MEANING else getattr(node, field, None)
            if value is not None and value != []:
                words.append(field)
                is_module = field == "module" and isinstance(value, str)
                text = value.removeprefix(_PREFIX) if is_module else value
                _add_words(text, words, imports)
        words.append(")")
    elif isinstance(node, list):
        for item in node:
            if not _is_text(item):
                _add_words(item, words, imports)
    else:
        words.append(repr(node))


def _is_text(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
