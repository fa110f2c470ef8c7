"""The graph of who imports whom, read from the text of a checkout; nothing of it is imported.

A *module* is a Python file of the product, `__init__` included; its name follows its place in the
checkout, so `emvs.mapper` is what is imported as `eventsweep.emvs.mapper`. Module a imports b where
a statement anywhere in a names b: at the top, inside a function, or for type checkers only. `from p
import n` names the module p.n where there is one, else the package p. What Python runs besides
(the `__init__` of every package on the way) and what is imported by a computed name
(`scenes.load`) is not counted.

A *circle* is a strongly connected component of more than one module. The *floors* of a set of
modules are the longest chain of imports in it, a circle counted as one floor.
"""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

PACKAGES = ("emvs", "sim", "scenes", "eval", "eventsweep", "plugins")

Graph = dict[str, set[str]]


@dataclass(frozen=True)
class Module:
    """One file of the product, read once."""

    name: str
    path: Path
    text: str
    tree: ast.Module

    @property
    def lines(self) -> int:
        return len(self.text.splitlines())

    @property
    def is_package(self) -> bool:
        return self.path.name == "__init__.py"

    @property
    def folder(self) -> str:
        """The package in whose folder the file lies, dotted."""
        return self.name if self.is_package else self.name.rpartition(".")[0]


def read_modules(root: Path) -> dict[str, Module]:
    """All modules of a checkout's product packages, by dotted name, sorted."""
    files = (path for package in PACKAGES for path in (root / package).rglob("*.py"))
    paths = [path for path in files if "tests" not in path.relative_to(root).parts]
    modules = [_module(path, root) for path in paths]
    return {module.name: module for module in sorted(modules, key=lambda module: module.name)}


def _module(path: Path, root: Path) -> Module:
    parts = path.relative_to(root).with_suffix("").parts
    name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
    text = path.read_text(encoding="utf-8")
    return Module(name, path, text, ast.parse(text))


def import_graph(modules: Mapping[str, Module]) -> Graph:
    """Module name -> names of the product's modules that it imports."""
    return {
        name: {target for target in _imported(module, modules) if target != name}
        for name, module in modules.items()
    }


def _imported(module: Module, modules: Mapping[str, Module]) -> Iterator[str]:
    for node in ast.walk(module.tree):
        if isinstance(node, ast.Import):
            names = (_short(alias.name) for alias in node.names)
            yield from (name for name in names if name in modules)
        elif isinstance(node, ast.ImportFrom):
            source = _source(node, module)
            for alias in node.names:
                inner = _short(f"{source}.{alias.name}")
                if inner in modules or source in modules:
                    yield inner if inner in modules else source


def _source(node: ast.ImportFrom, module: Module) -> str:
    """The absolute name behind `from`; relative ones begin at the module's own folder."""
    if not node.level:
        return _short(node.module or "")
    parts = module.folder.split(".")
    parts = parts[: len(parts) - node.level + 1]
    return ".".join([*parts, node.module] if node.module else parts)


def _short(name: str) -> str:
    """A module's name by its place in the checkout: `emvs.mapper` of `eventsweep.emvs.mapper`."""
    short = name.removeprefix("eventsweep.")
    return short if short.partition(".")[0] in PACKAGES else name


def within(graph: Graph, package: str) -> Graph:
    """The part of a graph that lies in one package."""
    inside = {name for name in graph if name == package or name.startswith(package + ".")}
    return {name: graph[name] & inside for name in graph if name in inside}


def reachable(graph: Graph, start: str) -> set[str]:
    """All that one module imports, directly or through others, itself included."""
    seen, waiting = {start}, [start]
    while waiting:
        fresh = graph[waiting.pop()] - seen
        seen |= fresh
        waiting += fresh
    return seen


def importers(graph: Graph) -> Graph:
    """The graph with every arrow turned round."""
    turned: Graph = {name: set() for name in graph}
    for name, targets in graph.items():
        for target in targets:
            turned[target].add(name)
    return turned


def components(graph: Graph) -> list[tuple[str, ...]]:
    """Strongly connected components, each sorted; what is imported comes before what imports it."""
    turned, left, groups = importers(graph), set(graph), []
    for name in reversed(_finished(graph)):
        if name in left:
            members = reachable({other: turned[other] & left for other in left}, name)
            left -= members
            groups.append(tuple(sorted(members)))
    return groups[::-1]


def _finished(graph: Graph) -> list[str]:
    """Names in the order in which a depth-first walk leaves them."""
    order: list[str] = []
    seen: set[str] = set()
    for start in sorted(graph):
        stack = [] if start in seen else [(start, iter(sorted(graph[start])))]
        seen.add(start)
        while stack:
            target = next((other for other in stack[-1][1] if other not in seen), None)
            if target is None:
                order.append(stack.pop()[0])
            else:
                seen.add(target)
                stack.append((target, iter(sorted(graph[target]))))
    return order


def circles(graph: Graph) -> list[tuple[str, ...]]:
    """Groups of names that import each other in a circle, the largest first."""
    groups = (members for members in components(graph) if len(members) > 1)
    return sorted(groups, key=len, reverse=True)


def floors(graph: Graph) -> dict[str, int]:
    """Name -> the length of the longest chain that begins there; 1 where nothing is imported."""
    height: dict[str, int] = {}
    for members in components(graph):
        below = {target for name in members for target in graph[name]} - set(members)
        lower = max((height[target] for target in below), default=0)
        height.update(dict.fromkeys(members, 1 + lower))
    return height


def longest_chain(graph: Graph) -> list[str]:
    """One longest chain, from the top down; the members of a circle are joined by `=`."""
    height = floors(graph)
    circle = {name: members for members in components(graph) for name in members}
    chain: list[str] = []
    level = max(height.values(), default=0)
    candidates = set(graph)
    while level:
        top = min(name for name in candidates if height[name] == level)
        chain.append(" = ".join(circle[top]))
        candidates = {target for name in circle[top] for target in graph[name]}
        level -= 1
    return chain


def subpackage(name: str) -> str:
    """The part of the architecture that a module belongs to: `emvs.formats` for `emvs.formats.png`.

    A module directly in a top-level package, such as `emvs.mapper`, is a part by itself.
    """
    return ".".join(name.split(".")[:2])


def subpackage_graph(graph: Graph) -> Graph:
    """Which part imports a module of which other; a package's own `__init__` is left out."""
    parts: Graph = {}
    for name, targets in graph.items():
        if "." in name or name in ("eventsweep", "scenes"):
            own = parts.setdefault(subpackage(name), set())
            own |= {subpackage(target) for target in targets if _is_part(target)}
    return {part: targets - {part} for part, targets in parts.items()}


def _is_part(name: str) -> bool:
    return "." in name or name in ("eventsweep", "scenes")


def by_folder(modules: Iterable[Module]) -> dict[str, list[Module]]:
    """Folder -> modules that lie side by side in it, `__init__` included."""
    folders: dict[str, list[Module]] = {}
    for module in modules:
        folders.setdefault(module.folder, []).append(module)
    return folders
