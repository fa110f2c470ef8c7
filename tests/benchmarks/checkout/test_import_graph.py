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
from structure import classes_defined_twice, is_tool, named_in, small_with_one_importer, tool_lines

# a imports b is "a": {"b"}

DIAMOND = {"top": {"left", "right"}, "left": {"base"}, "right": {"base"}, "base": set()}
CIRCLE = {"a": {"b"}, "b": {"c"}, "c": {"b", "d"}, "d": set()}


def test_floors_are_counted_from_what_imports_nothing():
    assert floors(DIAMOND) == {"base": 1, "left": 2, "right": 2, "top": 3}
    assert longest_chain(DIAMOND) == ["top", "left", "base"]


def test_a_circle_is_one_floor_or_as_many_as_it_has_modules():
    assert circles(CIRCLE) == [("b", "c")]
    assert components(CIRCLE) == [("d",), ("b", "c"), ("a",)]
    assert floors(CIRCLE) == {"a": 3, "b": 2, "c": 2, "d": 1}
    assert floors(CIRCLE, whole_circles=True)["a"] == 4
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


def test_an_example_is_named_by_code_not_by_prose(tmp_path):
    files = {
        "prose.py": '"""RMS."""\n# RMS\nrms = 1', "code.py": "from x import RMS_CODE",
        "text.py": 'NAMES = ("Alg1/RMS",)', "suite.toml": "methods = ['RMS']", "notes.md": "RMS",
        "other.py": "ALARMS = 2",
    }  # fmt: skip
    found = named_in(tmp_path, checkout(tmp_path, files), "RMS")
    assert found == ["emvs/code.py", "emvs/suite.toml", "emvs/text.py"]


def test_small_modules_and_second_classes_are_found(tmp_path):
    files = {
        "small.py": "class Job: pass", "large.py": "x = 1\n" * 60, "shared.py": "",
        "one.py": "from emvs import small, large, shared\nclass Job: pass",
        "two.py": "from emvs import shared",
    }  # fmt: skip
    modules = checkout(tmp_path, files)
    assert small_with_one_importer(modules, import_graph(modules)) == {"emvs.small": "emvs.one"}
    assert classes_defined_twice(modules) == {"Job": ["emvs.one", "emvs.small"]}


def test_developer_tools_are_counted_wherever_they_lie(tmp_path):
    assert is_tool("eval.gpu_votes")
    assert is_tool("scenes._sheet")
    assert not is_tool("eval.gate_table")
    tests = tmp_path / "tests"
    (tests / "benchmarks").mkdir(parents=True)
    for name in ("bench_sweep", "test_sweep", "benchmarks/study_cost", "benchmarks/test_cost"):
        (tests / f"{name}.py").write_text("x = 1\ny = 2\n", encoding="utf-8")
    assert tool_lines(tests) == 4
