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

_PREFIX = "eventsweep."
_NOT_MEANING = {"ctx", "kind", "type_comment", "type_params", "lineno", "col_offset"}


def code_version(roots: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Hashes the source of modules, of every module of this project that they import, and files.

    Imports inside functions count like those at the top. What is loaded by a computed name does
    not, so it must be among the roots.

    Args:
        roots: dotted names of modules, of this project or any other.
        files: what the code reads beside itself, such as a scene's MJCF.

    Returns:
        16 hexadecimal digits, equal on every machine and for every Python.
    """
    return source_digest(closure(roots), files)


def source_digest(modules: Iterable[str], files: Iterable[Path] = ()) -> str:
    """Hashes the source of exactly these modules, and files."""
    lines = [f"{name.removeprefix(_PREFIX)} {_source_hash(name)}" for name in sorted(modules)]
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
            waiting += _imports(name)
    return found


def _tree(name: str) -> ast.Module | None:
    spec = importlib.util.find_spec(name)
    if spec is None or spec.origin is None or not spec.origin.endswith(".py"):
        return None
    return ast.parse(Path(spec.origin).read_bytes())


@cache
def _imports(name: str) -> tuple[str, ...]:
    tree = _tree(name)
    return tuple(sorted(set(_imported(tree)))) if tree else ()


def _imported(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if _ours(alias.name))
        elif isinstance(node, ast.ImportFrom) and node.module and _ours(node.module):
            yield node.module
            inner = (f"{node.module}.{alias.name}" for alias in node.names)
            yield from (name for name in inner if _is_module(name))


def _ours(name: str) -> bool:
    return name.startswith(_PREFIX)


@cache
def _is_module(name: str) -> bool:
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:  # its parent is a module, not a package
        return False


@cache
def _source_hash(name: str) -> str:
    tree = _tree(name)
    words = "\0".join(_words(tree)) if tree else "absent"
    return hashlib.sha256(words.encode()).hexdigest()


@cache
def _definition_hash(name: str) -> str:
    words = "\0".join(_words(_WithoutImports().visit(_tree(name) or ast.Module([], []))))
    return hashlib.sha256(words.encode()).hexdigest()


class _WithoutImports(ast.NodeTransformer):
    def visit_Import(self, _node: ast.Import) -> None:
        return None

    def visit_ImportFrom(self, _node: ast.ImportFrom) -> None:
        return None


def _words(node: object) -> Iterator[str]:
    """What a syntax tree says, without places, doc strings and what differs between Pythons."""
    if isinstance(node, ast.AST):
        yield f"({type(node).__name__}"
        for field, value in _fields(node):
            if field not in _NOT_MEANING and value is not None and value != []:
                yield field
                yield from _words(value)
        yield ")"
    elif isinstance(node, list):
        yield from (word for item in node if not _is_text(item) for word in _words(item))
    else:
        yield repr(node)


def _fields(node: ast.AST) -> Iterator[tuple[str, object]]:
    """Fields of a node; imports name modules by their place in the repository."""
    for field, value in ast.iter_fields(node):
        if field == "module" and isinstance(value, str):
            yield field, value.removeprefix(_PREFIX)
        else:
            yield field, value


def _is_text(node: object) -> bool:
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
