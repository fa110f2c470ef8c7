"""Which code made a result: a hash over the source of a module and of all that it imports.

A stage's version changes when, and only when, code that the stage can reach says something else:
comments, layout and doc strings do not count, and neither does any module that it never imports.
"""

from __future__ import annotations

import ast
import hashlib
import importlib.util
from collections.abc import Iterable, Iterator
from functools import cache
from pathlib import Path

_PREFIX, _FOLDER = "eventsweep.", Path(__file__).parents[2]
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


def _tree(name: str) -> ast.Module | None:
    file = _file(name)
    return ast.parse(file.read_bytes()) if file else None


@cache
def _source(name: str) -> tuple[tuple[str, ...], str]:
    """What a module imports of this project, and the hash of its source."""
    tree = _tree(name)
    return (tuple(sorted(set(_imported(tree)))), _hash(tree)) if tree else ((), "absent")


def _hash(tree: ast.Module) -> str:
    words: list[str] = []
    _add_words(tree, words)
    return hashlib.sha256("\0".join(words).encode()).hexdigest()


def _imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and _ours(node.module):
            yield node.module
            inner = (f"{node.module}.{alias.name}" for alias in node.names)
            yield from (name for name in inner if _file(name))


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
    return _hash(_WithoutImports().visit(_tree(name) or ast.Module([], [])))


class _WithoutImports(ast.NodeTransformer):
    def visit_Import(self, _node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, _node: ast.ImportFrom) -> None:
        return None


def _add_words(node: object, words: list[str]) -> None:
    """Appends what a syntax tree says, without places, doc strings and what Pythons call anew.

    Imports name modules by their place in the repository.
    """
    if isinstance(node, ast.AST):
        words.append(f"({type(node).__name__}")
        for field in node._fields:
            value = None if field in _NOT_MEANING else getattr(node, field, None)
            if value is not None and value != []:
                words.append(field)
                is_module = field == "module" and isinstance(value, str)
                _add_words(value.removeprefix(_PREFIX) if is_module else value, words)
        words.append(")")
    elif isinstance(node, list):
        for item in node:
            if not _is_text(item):
                _add_words(item, words)
    else:
        words.append(repr(node))


def _is_text(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
