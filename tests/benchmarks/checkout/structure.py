"""Measures how the product is laid out.

Run: python tests/benchmarks structure [ROOT ...] [--json] [--list]

Prints a Markdown table with a column for each checkout, such as before and after a change. A
checkout is read as text (`import_graph` says what counts as an import, a circle and a floor);
nothing of it is run.

- Lines are lines of text, empty ones and comments included. The product is every module of the
  packages. Developer tools draw, measure and write tables for the documentation: what lies in
  `tests/benchmarks` and `docs/figures` and is no test. Tests are the rest of `tests`, their helpers
  included; those of the tools are counted once more by themselves.
- The mapper's modules are all that `emvs.mapper` imports, directly or not, itself included.
- A subpackage is what `import_graph.subpackage` says: `emvs.dsi` with all below it; a module
  directly in a top-level package is a part by itself.
- A small module with one importer has fewer than 60 lines and one module of the product that
  imports it; `__init__` and scenes are left out. `--list` names them, and the longest chains and
  circles.
- What an addition touches: the files of the product that name an existing example of its kind. A
  file names it where the word is (part of) its own name, or in its code an identifier, an import
  or a string, docstrings and comments excepted; files that are not Python are searched as a
  whole. `ADDITIONS` holds the examples. It is a bound from above: a list of shown metrics counts,
  though it can stay as it is.
"""

from __future__ import annotations

import argparse
import ast
import json
import re
from collections import Counter
from collections.abc import Iterator, Mapping
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
    reachable,
    read_modules,
    subpackage_graph,
    within,
)

SMALL_LINES = 60
FULLEST = 6
TOOLS = ("tests/benchmarks", "docs/figures")
SUFFIXES = (".toml", ".xml", ".j2", ".js", ".css")

# what is added -> a regular expression that finds the example; `_` parts words
ADDITIONS = {
    "extraction (`derd`)": r"(?i:derd)",
    "fusion function (`RMS`)": r"RMS",
    "metric (`silog`)": r"silog",
    "scene (`hdr_night`)": r"hdr[_-]night",
    "verb (`prune`)": r"(?i:prune)",
    "renderer (`StereoRenderer`)": r"StereoRenderer",
    "event format (`aedat4`)": r"(?i:aedat4)",
    "encoding of a known format (`evt2`)": r"(?i:evt2)",
}


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
            name: _sizes([one.path for one in modules.values() if is_below(one, name)])
            for name in (*PACKAGES, *plug_ins(modules))
        },
        "into_plug_ins": into_plug_ins(graph),
        "folders": {
            name: _sizes([module.path for module in inside])
            for name, inside in sorted(folders.items())
        },
        "fullest_folders": dict(fullest.most_common(FULLEST)),
        "mapper_modules": len(reachable(graph, "emvs.mapper")) if "emvs.mapper" in graph else 0,
        "chains": chains(graph),
        "part_chains": chains(parts),
        "circles": circles(graph),
        "subpackages": len(parts),
        "subpackage_circles": circles(parts),
        "small_with_one_importer": small_with_one_importer(modules, graph),
        "classes_defined_twice": classes_defined_twice(modules),
        "additions": {what: named_in(root, modules, word) for what, word in ADDITIONS.items()},
    }


def is_below(module: Module, package: str) -> bool:
    """Whether a module lies in a package, at any depth."""
    return f"{module.name}.".startswith(f"{package}.")


def plug_ins(modules: Mapping[str, Module]) -> list[str]:
    """The packages below `plugins`."""
    return sorted(name for name in modules if name.startswith("plugins.") and name.count(".") == 1)


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


def classes_defined_twice(modules: dict[str, Module]) -> dict[str, list[str]]:
    """Class name -> modules, for classes at the top of more than one module."""
    found: dict[str, list[str]] = {}
    for name, module in modules.items():
        for node in module.tree.body:
            if isinstance(node, ast.ClassDef):
                found.setdefault(node.name, []).append(name)
    return {name: where for name, where in sorted(found.items()) if len(where) > 1}


def named_in(root: Path, modules: dict[str, Module], word: str) -> list[str]:
    """Files of the product that name an example in code, relative to the checkout, sorted."""
    pattern = re.compile(rf"(?<![A-Za-z0-9])(?:{word})(?![A-Za-z0-9])")
    code = [(one.path, "\n".join(_words(one.tree))) for one in modules.values()]
    texts = [
        (path, path.read_text(encoding="utf-8"))
        for package in PACKAGES
        for path in (root / package).rglob("*")
        if path.suffix in SUFFIXES
    ]
    return sorted(
        str(path.relative_to(root))
        for path, text in code + texts
        if pattern.search(path.stem) or pattern.search(text)
    )


def _words(tree: ast.Module) -> Iterator[str]:
    """Identifiers, imported names and strings; no docstrings and no comments."""
    skipped = {id(text) for text in _bare_strings(tree)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant):
            if isinstance(node.value, str) and id(node) not in skipped:
                yield node.value
            continue
        for field in ("id", "attr", "arg", "name", "asname", "module"):
            if isinstance(text := getattr(node, field, None), str):
                yield text


def _bare_strings(tree: ast.Module) -> Iterator[ast.Constant]:
    """Strings that are statements by themselves: docstrings, of modules, functions and values."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            yield node.value


def rows(found: dict[str, Any]) -> dict[str, str]:
    """The table's rows: what was measured -> the value as it is shown."""
    return {
        "product: modules, lines": _size(found["product"]),
        "core (all but `plugins`): modules, lines": _size(found["core"]),
        "imports into plug-ins from outside them": str(len(found["into_plug_ins"])),
        "tests: modules, lines": _size(found["tests"]),
        "tests of developer tools among them": _size(found["tests of tools"]),
        "developer tools: modules, lines": _size(found["tools"]),
        "median module, lines": f"{found['median_module_lines']:g}",
        **{f"`{name}`: modules, lines": _size(size) for name, size in found["packages"].items()},
        "fullest folders": ", ".join(f"`{k}` {n}" for k, n in found["fullest_folders"].items()),
        "modules that the mapper imports": str(found["mapper_modules"]),
        **{f"floors, {name}": str(len(one)) for name, one in found["chains"].items()},
        "circles of modules (modules in each)": _circle_sizes(found["circles"]),
        **{
            f"floors of subpackages, {name}": str(len(one))
            for name, one in found["part_chains"].items()
        },
        "subpackages": str(found["subpackages"]),
        "circles of subpackages (parts in each)": _circle_sizes(found["subpackage_circles"]),
        f"modules under {SMALL_LINES} lines with one importer": str(
            len(found["small_with_one_importer"])
        ),
        "class names defined more than once": str(len(found["classes_defined_twice"])),
        **{
            f"files that name an existing {what}": _files(files)
            for what, files in found["additions"].items()
        },
    }


def _size(size: dict[str, int]) -> str:
    return f"{size['modules']}, {size['lines']:,}"


def _circle_sizes(found: list[tuple[str, ...]]) -> str:
    return f"{len(found)} ({', '.join(str(len(one)) for one in found)})" if found else "0"


def _files(files: list[str]) -> str:
    modules = sum(file.endswith(".py") for file in files)
    return f"{len(files)}, {modules} of them modules"


def table(columns: dict[str, dict[str, str]]) -> str:
    """The rows as Markdown, one column for each checkout."""
    lines = ["| | " + " | ".join(columns) + " |", "|---|" + "---|" * len(columns)]
    names = list(next(iter(columns.values())))
    cells = ([row, *(one[row] for one in columns.values())] for row in names)
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in cells)])


def folder_table(found: dict[str, Any]) -> str:
    """Modules and lines of every folder, as Markdown."""
    sizes = found["folders"].items()
    lines = ["| folder | modules | lines |", "|---|---|---|"]
    lines += [f"| `{name}` | {one['modules']} | {one['lines']:,} |" for name, one in sizes]
    return "\n".join(lines)


def details(found: dict[str, Any]) -> str:
    """What stands behind the counts: chains, circles, small modules, classes, files."""
    parts = [f"Longest chain, {k}: {' -> '.join(v)}" for k, v in found["chains"].items()]
    parts += [f"Subpackages, {k}: {' -> '.join(v)}" for k, v in found["part_chains"].items()]
    parts += [f"Circle: {', '.join(one)}" for one in found["circles"]]
    parts += [f"Circle of subpackages: {', '.join(one)}" for one in found["subpackage_circles"]]
    small = found["small_with_one_importer"].items()
    parts += [f"Small: {name}, imported by {by} only" for name, by in small]
    twice = found["classes_defined_twice"].items()
    parts += [f"Class {name}: {', '.join(where)}" for name, where in twice]
    parts += [f"Addition, {k}: {', '.join(v)}" for k, v in found["additions"].items()]
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
        text = table({name: rows(found) for name, found in zip(names, measured, strict=True)})
        lists = measured if asked.list else []
        text = "\n\n".join([text, *(f"{folder_table(one)}\n\n{details(one)}" for one in lists)])
    print(text)  # noqa: T201


if __name__ == "__main__":
    main()
