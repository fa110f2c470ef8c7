"""Measures how the product is laid out.

Run: python tests/benchmarks structure [ROOT ...] [--json] [--list]

Prints a Markdown table with a column for each checkout; `import_graph` says what an import is.

- Lines are lines of text, empty ones and comments included. The product is every module of the
  packages. Developer tools draw, measure and write tables for the documentation: what lies in
  `tests/benchmarks` and `docs/figures` and is no test. Tests are the rest of `tests`, their helpers
  included; those of the tools are counted once more by themselves.
- A subpackage is what `import_graph.subpackage` says: `emvs.dsi` with all below it; a module
  directly in a top-level package is a part by itself.
- A small module with one importer has fewer than 60 lines and one module of the product that
  imports it; `__init__` and scenes are left out. `--list` names them, and the longest chains and
  circles.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from pathlib import Path
from statistics import median
from typing import Any

from import_graph import (
    PACKAGES,
    Graph,
    Module,
    by_folder,
    circles,
    import_graph,
    importers,
    longest_chain,
    read_modules,
    subpackage_graph,
    within,
)

SMALL_LINES = 60
FULLEST = 6
TOOLS = ("tests/benchmarks", "docs/figures")


def measure(root: Path) -> dict[str, Any]:
    """Every figure of one checkout; what `--json` prints."""
    modules = read_modules(root)
    graph = import_graph(modules)
    folders = by_folder(modules.values())
    fullest = Counter({folder: len(inside) for folder, inside in folders.items()})
    parts = subpackage_graph(graph)
    return {
        **{name: _sizes(files) for name, files in files_by_kind(root).items()},
        "median_module_lines": median(module.lines for module in modules.values()),
        "packages": {
            name: _sizes([modules[part].path for part in within(graph, name)])
            for name in (*PACKAGES, *sorted(part for part in parts if part.startswith("plugins.")))
        },
        "into_plug_ins": into_plug_ins(graph),
        "folders": {
            name: _sizes([module.path for module in inside])
            for name, inside in sorted(folders.items())
        },
        "fullest_folders": dict(fullest.most_common(FULLEST)),
        "chains": chains(graph),
        "part_chains": chains(parts),
        "circles": circles(graph),
        "subpackages": len(parts),
        "subpackage_circles": circles(parts),
        "small_with_one_importer": small_with_one_importer(modules, graph),
        "page_templates": page_templates(root),
    }


def into_plug_ins(graph: Graph) -> list[str]:
    """Imports that lead into a plug-in from anywhere outside it."""

    def owner(name: str) -> str:
        return ".".join(name.split(".")[:2]) if name.startswith("plugins.") else "core"

    edges = [(a, b) for a in graph for b in graph[a] if b.startswith("plugins.")]
    return sorted(f"{a} -> {b}" for a, b in edges if owner(a) != owner(b))


def chains(graph: Graph) -> dict[str, list[str]]:
    """One longest chain in each package, and in all; the scenes hardly import each other."""
    inside = {name: longest_chain(within(graph, name)) for name in ("emvs", "sim", "eval")}
    return inside | {"all": longest_chain(graph)}


def files_by_kind(root: Path) -> dict[str, list[Path]]:
    """Python files of the product, of the tests, of tests of tools among them, and of the tools."""
    everything = [path for name in PACKAGES for path in _python(root / name)]
    product = [path for path in everything if "tests" not in path.relative_to(root).parts]
    tests = [*_python(root / "tests"), *(path for path in everything if path not in product)]
    tools = [path for name in TOOLS for path in _python(root / name)]
    of_tools = [path for path in tools if path.name.startswith("test_")]
    tools = [path for path in tools if path not in of_tools]
    return {
        "product": product,
        "core": [path for path in product if path.relative_to(root).parts[0] != "plugins"],
        "tests": [path for path in tests if path not in tools],
        "tests of tools": of_tools,
        "tools": tools,
    }


def _python(folder: Path) -> list[Path]:
    """Python files below a folder; what a link in it leads to is counted where it lies."""
    return sorted(folder.rglob("*.py"))


def _sizes(files: list[Path]) -> dict[str, int]:
    lines = sum(len(path.read_text("utf-8").splitlines()) for path in files)
    return {"modules": len(files), "lines": lines}


def small_with_one_importer(modules: dict[str, Module], graph: Graph) -> dict[str, str]:
    """Module -> the only module that imports it, for the small ones."""
    return {
        name: next(iter(above))
        for name, above in importers(graph).items()
        if len(above) == 1
        and modules[name].lines < SMALL_LINES
        and not modules[name].is_package
        and name.split(".")[0] != "scenes"
    }


def page_templates(root: Path) -> list[str]:
    """Templates of whole pages; others hold parts of pages."""
    templates = (path for name in PACKAGES for path in sorted((root / name).rglob("*.j2")))
    whole = (path for path in templates if "<html" in path.read_text("utf-8"))
    return [str(path.relative_to(root)) for path in whole]


def rows(figures: dict[str, Any]) -> dict[str, str]:
    """The table's rows: what was measured -> the value as it is shown."""
    return {
        "product: modules, lines": _size(figures["product"]),
        "core (all but `plugins`): modules, lines": _size(figures["core"]),
        "imports into plug-ins from outside them": str(len(figures["into_plug_ins"])),
        "tests: modules, lines": _size(figures["tests"]),
        "tests of developer tools among them": _size(figures["tests of tools"]),
        "developer tools: modules, lines": _size(figures["tools"]),
        "median module, lines": f"{figures['median_module_lines']:g}",
        **{f"`{name}`: modules, lines": _size(size) for name, size in figures["packages"].items()},
        "fullest folders": ", ".join(f"`{k}` {n}" for k, n in figures["fullest_folders"].items()),
        **{f"floors, {name}": str(len(chain)) for name, chain in figures["chains"].items()},
        "circles of modules (modules in each)": _circle_sizes(figures["circles"]),
        **{f"floors of parts, {k}": str(len(chain)) for k, chain in figures["part_chains"].items()},
        "subpackages": str(figures["subpackages"]),
        "circles of subpackages (parts in each)": _circle_sizes(figures["subpackage_circles"]),
        "small modules with one importer": str(len(figures["small_with_one_importer"])),
        "page templates": str(len(figures["page_templates"])),
    }


def _size(size: dict[str, int]) -> str:
    return f"{size['modules']}, {size['lines']:,}"


def _circle_sizes(groups: list[tuple[str, ...]]) -> str:
    return f"{len(groups)} ({', '.join(str(len(group)) for group in groups)})" if groups else "0"


def table(columns: dict[str, dict[str, str]]) -> str:
    """The rows as Markdown, one column for each checkout."""
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    names = list(next(iter(columns.values())))
    cells = ([row, *(column[row] for column in columns.values())] for row in names)
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in cells)])


def details(figures: dict[str, Any]) -> str:
    """What stands behind the counts: chains, circles, small modules."""
    parts = [f"Longest chain, {k}: {' -> '.join(v)}" for k, v in figures["chains"].items()]
    parts += [f"Subpackages, {k}: {' -> '.join(v)}" for k, v in figures["part_chains"].items()]
    parts += [f"Circle: {', '.join(members)}" for members in figures["circles"]]
    circles_of_parts = figures["subpackage_circles"]
    parts += [f"Circle of subpackages: {', '.join(members)}" for members in circles_of_parts]
    small = figures["small_with_one_importer"].items()
    parts += [f"Small: {name}, imported by {by} only" for name, by in small]
    return "\n".join(f"- {part}" for part in parts)


def main() -> None:
    """Measures the checkouts named on the command line; by default the one this file is in."""
    parser = argparse.ArgumentParser(description="How the product is laid out.")
    here = Path(__file__).resolve().parents[3]
    parser.add_argument("root", type=Path, nargs="*", default=[here])
    parser.add_argument("--json", action="store_true", help="every figure, with names, as JSON")
    parser.add_argument("--list", action="store_true", help="also what stands behind the counts")
    asked = parser.parse_args()
    for root in asked.root:
        if not (root / "emvs").is_dir():
            parser.error(f"{root}: has no folder emvs; needs the root of a checkout")
    measured = [measure(root.resolve()) for root in asked.root]
    names = ["value"] if len(measured) == 1 else ["before", "after"]
    names += [str(root) for root in asked.root[2:]]
    text = json.dumps(dict(zip(names, measured, strict=True)), indent=1)
    if not asked.json:
        text = table({name: rows(figures) for name, figures in zip(names, measured, strict=True)})
        lists = measured if asked.list else []
        text = "\n\n".join([text, *(details(figures) for figures in lists)])
    print(text)  # noqa: T201


if __name__ == "__main__":
    main()
