"""Which tables an edit of code makes stale: those whose numbers it can change, and no other."""

import random
import shutil

import pytest

import measurements
import stale_tables
from import_graph import import_graph, reachable, read_modules
from measured import entries, record
from places import ROOT, needs_plugins
from refusals import line_of
from table_code import EXACT, Code, Tools

pytestmark = needs_plugins
SEED, DRAWN = 55, 20
COPIED = ("emvs", "sim", "scenes", "eval", "plugins", "eventsweep", "tests", "docs/figures")
LEARNED = {"plugins/learned/learned.md#confidence", "plugins/learned/learned.md#left-out"}
REAL = {"README.md#real", "plugins/learned/learned.md#real"}
COMMITTED = {"README.md#results", "plugins/ranking/ranking.md#ranking"}
TRACKED = {"plugins/track/odometry.md#track-scores", "plugins/track/odometry.md#track-latency"}
SLID = {"plugins/track/odometry.md#track-slider"}
SUITES = COMMITTED | {"docs/gate.md#first-runs"}
SCORED = SUITES | TRACKED | {
    "docs/paper.md#paper", "docs/paper.md#reproduction", "docs/studies.md#studies",
    "docs/baselines.md#baselines", "docs/gate.md#recipe", "docs/suite.md#scale",
    "plugins/diagnose/check.md#check-faults",
    "plugins/geometry/geometry.md#geometry-scores",
}  # fmt: skip
MAPPED = SCORED | LEARNED | {"plugins/cuda/cuda.md#gpu"}
SIMULATED = MAPPED | {
    "docs/simulator.md#simulate-stages", "docs/scenes.md#figures",
    "docs/simulator.md#fidelity", "docs/simulator.md#fidelity-rays",
    "docs/simulator.md#fidelity-drawn", "plugins/raster/raster.md#raster",
    "plugins/align/align.md#align-draws",
}  # fmt: skip
PLANES = SUITES | LEARNED | {
    "docs/gate.md#recipe", "docs/paper.md#paper", "docs/scenes.md#figures",
    "docs/studies.md#studies", "docs/suite.md#scale", "plugins/align/align.md#align-draws",
}  # fmt: skip
EDITS = {
    "emvs/dsi/fusion_kernels.py": MAPPED | REAL | SLID,
    "sim/rendering/renderer.py": SIMULATED,
    "eval/scoring/metrics.py": SCORED | SLID | {"plugins/geometry/geometry.md#large"},
    "emvs/formats/prophesee_kernels.py": {"docs/formats.md#speeds"},
    "scenes/planes.py": PLANES,
    "scenes/planes.xml": PLANES,
    "plugins/learned/networks/weights/learned.npz": SUITES | LEARNED | REAL | {
        "docs/studies.md#studies"
    },
    "plugins/track/odometry/tracker.py": TRACKED | SLID | {"docs/paper.md#paper"},
    "plugins/cuda/voting_kernels.py": {"plugins/cuda/cuda.md#gpu"},
    "plugins/raster/shading_kernels.py": SIMULATED,
    "plugins/geometry/nearest_kernels.py": {
        "plugins/geometry/geometry.md#geometry-scores", "plugins/geometry/geometry.md#large",
    },
    "plugins/video/film.py": set(),
    "eval/report/run_page.py": set(),
    "eval/report/templates/page.html.j2": set(),
    "eval/cli/main.py": set(),
    "tests/benchmarks/tables/markdown_blocks.py": set(),
    "tests/helpers/simulation/warped_depth.py": {"docs/scenes.md#figures"},
}  # fmt: skip
"""A file -> the tables whose numbers a change of it can change, as a reader of their pages says."""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A checkout without pictures, to be edited, and the hash of each table's code in it."""
    root = tmp_path_factory.mktemp("checkout")
    for name in COPIED:
        shutil.copytree(ROOT / name, root / name, symlinks=True,
                        ignore=shutil.ignore_patterns("__pycache__"))  # fmt: skip
    shutil.copy(ROOT / "pyproject.toml", root)
    return root, digests(root)


def digests(root):
    return {key: stale_tables.digest_of(key, root) for key in stale_tables.declared()}


def changed_by(copy, name, edited):
    """Tables that an edit of a file makes stale; the file is as before afterwards."""
    root, before = copy
    path = root / name
    content = path.read_bytes()
    path.write_bytes(edited(content))
    try:
        return {key for key, digest in digests(root).items() if digest != before[key]}
    finally:
        path.write_bytes(content)


def at_end(content):
    return content + b"\nplanted = 1\n"


def in_functions(content):
    """Of tools single functions count."""
    return content.replace(b"    return ", b"    planted = 1\n    return ")


def with_words(content):
    return content + b'\n# Planted.\n"""And explained."""\n'


def test_a_copy_of_the_code_has_the_hashes_of_the_code(copy):
    assert copy[1] == digests(ROOT)
    for key, code in stale_tables.declared().items():
        assert [name for name, digest in code.parts().items() if digest == "absent"] == [], key


@pytest.mark.parametrize("name", EDITS)
def test_an_edit_makes_those_tables_stale_whose_numbers_it_can_change(copy, name):
    assert changed_by(copy, name, in_functions if "tests" in name else at_end) == EDITS[name]
    if name.endswith(".py"):
        assert changed_by(copy, name, with_words) == set()


def expected(graph, module):
    """Tables that reach a module, by a graph of imports that is read in another way."""
    found = set()
    for key, code in stale_tables.declared().items():
        own = stale_tables.declared().get(code.data, code)
        tools = Tools(ROOT)
        tools.used(own)
        without = tuple(f"{name}." for name in own.without)
        kept = {a: {b for b in to if not outside(b, without)} for a, to in graph.items()}
        named = (one.removeprefix("eventsweep.") for one in (*own.modules, *tools.modules))
        roots = {one if one in graph else f"eventsweep.{one}" for one in named}
        if any(module in reachable(kept, root) for root in roots if not outside(root, without)):
            found.add(key)
    return found


def outside(name, without):
    return f"eventsweep.{name}.".startswith(without)


@pytest.mark.slow
def test_edits_drawn_by_a_seed_make_stale_what_reaches_them(copy):
    modules = read_modules(ROOT)
    graph, rng = import_graph(modules), random.Random(SEED)
    for name in rng.sample(sorted(modules), DRAWN):
        path = modules[name].path.relative_to(ROOT).as_posix()
        assert changed_by(copy, path, with_words) == set(), path
        assert changed_by(copy, path, at_end) == expected(graph, name), path


PAGE = "<!-- figures: begin -->\nold\n<!-- figures: end -->\n"


def checkout(folder):
    """A checkout with one page and an empty list."""
    (folder / "docs").mkdir()
    (folder / "docs" / "measured.toml").write_text("")
    page = folder / "docs" / "page.md"
    page.write_text(PAGE)
    return page


def test_what_writes_a_table_notes_its_code_and_what_declares_none_is_refused(tmp_path):
    page = checkout(tmp_path)
    assert stale_tables.blocks(tmp_path) == ["docs/page.md#figures"]
    assert "declare its code" in line_of(record, page, "figures", dict)
    record(page, "figures", lambda: {"docs/page.md#figures": Code(files=("docs/page.md",))})
    (made,) = entries(tmp_path).values()
    assert (len(made["code"]), made["commit"]) == (16, "unknown")  # in no repository
    record(page, "figures", lambda: {"docs/page.md#figures": Code()})
    assert entries(tmp_path) == {"docs/page.md#figures": {"code": EXACT}}


def test_a_table_of_data_is_as_old_as_the_data(tmp_path):
    page, data = checkout(tmp_path), tmp_path / "data.json"

    def noted(text, code):
        data.write_text(text)
        (tmp_path / "code").write_text(code)
        own = Code(files=("code",), data="data.json")
        record(page, "figures", lambda: {"docs/page.md#figures": own})
        return entries(tmp_path)["docs/page.md#figures"]["code"]

    first = noted("1", "a")
    assert noted("1", "b") == first
    assert noted("2", "b") != first


def test_a_table_of_another_table_is_as_old_as_that(tmp_path):
    page = checkout(tmp_path)
    first = {"docs/page.md#figures": Code(files=("docs/page.md",))}
    record(page, "figures", lambda: first)
    record(page, "again", lambda: {"docs/page.md#again": Code(data="docs/page.md#figures")})
    one, other = entries(tmp_path).values()
    assert one == other


def test_every_measured_table_has_its_part_but_for_data_real_recordings_and_gpus():
    parts = [table for part in measurements.PARTS for table in part.tables]
    others = REAL | SLID | COMMITTED | {"plugins/cuda/cuda.md#gpu"}
    made = {key for key, one in stale_tables.declared().items() if one.digest() != EXACT}
    assert sorted([*parts, *others]) == sorted(made | {"README.md#real"})


def test_what_is_of_todays_code_is_not_measured_and_a_failure_ends_the_row(monkeypatch, capsys):
    first, second = measurements.PARTS[:2]
    old = {first.tables[0]: "x", second.tables[0]: "x"}
    monkeypatch.setattr(measurements, "stale", lambda: old)
    assert list(measurements.due()) == [first, second]
    assert measurements.main(["--plan"]) == 0
    assert capsys.readouterr().out.count("\n") == 2
    failing = measurements.Part(first.tables, "exit 3")
    monkeypatch.setattr(measurements, "PARTS", (failing, second))
    assert measurements.main([]) == 2
    said = capsys.readouterr()
    assert "exit code 3" in said.err
    assert second.tables[0] not in said.out
