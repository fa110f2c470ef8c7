"""The graph of imports, on checkouts and graphs that one can see through."""

from import_graph import (
    circles,
    components,
    floors,
    import_graph,
    longest_chain,
    reachable,
    read_modules,
    subpackage_graph,
)
from structure import files_by_kind, small_with_one_importer

# a imports b is "a": {"b"}

DIAMOND = {"top": {"left", "right"}, "left": {"base"}, "right": {"base"}, "base": set()}
CIRCLE = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}


def test_floors_are_counted_from_what_imports_nothing():
    assert floors(DIAMOND) == {"base": 1, "left": 2, "right": 2, "top": 3}
    assert longest_chain(DIAMOND) == ["top", "left", "base"]


def test_a_circle_is_one_floor():
    assert circles(CIRCLE) == [("b", "c")]
    assert components(CIRCLE) == [("d",), ("b", "c"), ("a",)]
    assert floors(CIRCLE) == {"a": 3, "b": 2, "c": 2, "d": 1}
    assert longest_chain(CIRCLE) == ["a", "b = c", "d"]
    assert reachable(CIRCLE, "c") == {"b", "c", "d"}


def checkout(folder, files):
    for name, text in files.items():
        path = folder / "emvs" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
    return read_modules(folder)


def test_every_way_to_import_is_seen(tmp_path):
    files = {
        "__init__.py": "", "errors.py": "", "config.py": "", "view.py": "",
        "dsi/__init__.py": "NAME = 1",
        "dsi/sweep.py": "from .. import errors\nfrom . import NAME\nfrom numpy import array",
        "mapper.py": "import emvs.errors\nfrom typing import TYPE_CHECKING\n"
        "if TYPE_CHECKING:\n    from emvs.config import X\n"
        "def f():\n    from emvs import view\n    from emvs.dsi import NAME, sweep",
    }  # fmt: skip
    graph = import_graph(checkout(tmp_path, files))
    assert graph["emvs.dsi.sweep"] == {"emvs.errors", "emvs.dsi"}
    assert graph["emvs.mapper"] == {
        "emvs.errors", "emvs.config", "emvs.view", "emvs.dsi", "emvs.dsi.sweep"
    }  # fmt: skip
    assert subpackage_graph(graph)["emvs.dsi"] == {"emvs.errors"}


def test_small_modules_are_found(tmp_path):
    files = {
        "small.py": "x = 1", "large.py": "x = 1\n" * 60, "shared.py": "",
        "one.py": "from emvs import small, large, shared",
        "two.py": "from emvs import shared",
    }  # fmt: skip
    modules = checkout(tmp_path, files)
    assert small_with_one_importer(modules, import_graph(modules)) == {"emvs.small": "emvs.one"}


def test_product_tests_and_tools_are_counted_apart(tmp_path):
    tests, tools = "tests/emvs/test_a tests/helpers/b", "docs/figures/c tests/benchmarks/d/study"
    for name in ("emvs/a", *tests.split(), *tools.split(), "tests/benchmarks/d/test_study"):
        path = tmp_path / f"{name}.py"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("x = 1\ny = 2\n", encoding="utf-8")
    counts = {kind: len(files) for kind, files in files_by_kind(tmp_path).items()}
    assert counts == {"product": 1, "core": 1, "tests": 3, "tests of tools": 1, "tools": 2}
