"""The documentation names what there is: modules, settings, fields, and who draws each picture."""

from __future__ import annotations

import importlib.util
import os
import pkgutil
import re
import runpy
import subprocess
import sys
import tomllib
from fnmatch import fnmatchcase
from pathlib import PurePosixPath

import pytest

from eventsweep.emvs.depth.inpainting import Dense
from eventsweep.emvs.maps.folder import (
    HotPixelInfo,
    MapInfo,
    RecordingInfo,
    SkippedWindow,
    WindowInfo,
)
from eventsweep.emvs.maps.merge import FusedInfo
from eventsweep.emvs.utils import plugins
from eventsweep.eval.results.results import Results, write_results
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.plan import extent, suite_jobs
from places import HAS_PLUGINS, ROOT, TOOLS, needs_plugins

DOCS = ROOT / "docs"
MOST_MODULES = 15  # in one folder
PACKAGES = ("emvs", "sim", "scenes", "eval", "eventsweep", "plugins")
# Commands that have left, by the commit that still has them: a paragraph that names one names it.
FORMER = "77cd9c78"
# Pictures that commands of that commit drew.
FORMER_PICTURES = {"cost.png", "extraction.png", "inpaint.png"}
COMMAND = re.compile(
    r"-m ((?:emvs|sim|scenes|eval)[\w.]*)|(docs/figures/\w+\.py)|tests/benchmarks (\w+)"
)
# A file of the checkout by its path, which may hold `*`.
FILE = re.compile(
    r"(?<![\w/.~-])(?:tests|docs|reports|\.ci|\.github|emvs|sim|scenes|eval|eventsweep|plugins)/"
    r"[\w/*.-]*\w\.(?:py|sh|cpp|yml|md|xml|json|toml|png|webp)\b"
)
TO_MAKE = re.compile(r"/(?:NAME|attic)\.")  # what a page tells its reader to write
TARGET = re.compile(r"(?:`|^)make ([a-z][\w-]*)", re.MULTILINE)
DOTTED = re.compile(r"`((?:emvs|sim|scenes|eval|eventsweep|plugins)(?:\.\w+)+)[`(]")
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SUPPORT.md", "SECURITY.md")),
    *sorted(DOCS.rglob("*.md")), *sorted(ROOT.glob("plugins/*/*.md")),
]  # fmt: skip
MENTIONS = [
    *PAGES, ROOT / "Makefile", ROOT / "pyproject.toml", *sorted(DOCS.rglob("*.py")),
    *sorted((ROOT / ".github").rglob("*.yml")),
    *sorted(
        path for path in TOOLS.rglob("*")
        if path.suffix in (".py", ".sh") and not path.name.startswith("test_")
    ),
    *sorted(path for name in PACKAGES for path in (ROOT / name).rglob("*.py")),
]  # fmt: skip


def text_of(*pages):
    return "\n".join(page.read_text(encoding="utf-8") for page in pages)


def folders():
    """Dotted names of the folders that hold modules, and the tables of suites."""
    files = (path for package in PACKAGES for path in (ROOT / package).rglob("*.*"))
    modules = {path.parent for path in files if path.suffix in (".py", ".toml")}
    names = {".".join(folder.relative_to(ROOT).parts) for folder in modules}
    return {name for name in names if "tests" not in name.split(".")}


def test_the_architecture_names_every_folder_and_no_other():
    table = text_of(DOCS / "architecture.md").split("| Folder | Holds |")[1].split("\n\n")[0]
    firsts = (row.split("|")[1] for row in table.splitlines() if row.startswith("|"))
    named = [name for cell in firsts for name in re.findall(r"`([\w.]+)`", cell)]
    named = {name for name in named if HAS_PLUGINS or not name.startswith("plugins")}
    assert {name for name in named if name.split(".")[0] in PACKAGES} == folders()


@pytest.mark.parametrize(
    "model", [MapInfo, WindowInfo, SkippedWindow, HotPixelInfo, RecordingInfo, FusedInfo, Dense]
)
def test_every_field_of_a_map_folder_is_described(model):
    fields = getattr(model, "model_fields", None) or model.__annotations__
    page = text_of(DOCS / "formats.md")
    assert [name for name in fields if f"`{name}`" not in page] == []


def test_the_columns_of_results_are_those_that_the_pages_list(tmp_path):
    write_results(tmp_path, Results(()))
    (head,) = (tmp_path / "results.csv").read_text().splitlines()
    for page in ("formats.md", "scores.md"):
        text = " ".join(text_of(DOCS / page).split())
        listed = re.findall(r"`(case, ?seed, ?window,[^`]*)`", text)
        assert [columns.replace(" ", "") for columns in listed] == [head], page


def makefile():
    """Its lines, continued ones joined."""
    return text_of(ROOT / "Makefile").replace("\\\n", " ").splitlines()


def makers(picture):
    """Lines of the Makefile that draw a picture, which they name beside the command."""
    for line in makefile():
        names = re.findall(r"docs/images/([\w*.-]+\.(?:png|webp))", line)
        if line.startswith("\t") and any(fnmatchcase(picture, name) for name in names):
            yield line


@needs_plugins
def test_every_picture_is_shown_and_drawn_by_a_command():
    pictures = sorted(path.name for path in (DOCS / "images").iterdir())
    pages = text_of(*PAGES)
    assert set(pictures) >= FORMER_PICTURES
    assert [name for name in pictures if f"images/{name})" not in pages] == []
    drawn_by = {name: next(makers(name), "") for name in pictures if name not in FORMER_PICTURES}
    strange = {
        name: line for name, line in drawn_by.items()
        if not COMMAND.search(line) and not line.strip().startswith("cp out/")
    }  # fmt: skip
    assert strange == {}, "name the command that draws it in the Makefile"


def test_commands_of_the_makefile_exist():
    named = [match for line in makefile() for match in COMMAND.findall(line)]
    assert len(named) > 10
    for module, script, tool in named:
        assert not module or importlib.util.find_spec(module)
        assert not script or (ROOT / script).is_file()
        assert not tool or tool in known_tools()


def known_tools():
    """Name -> file of what `python tests/benchmarks NAME` runs."""
    return runpy.run_path(str(TOOLS / "__main__.py"))["tools"]()


def former_tools():
    """Names of the tools of the commit that still has those that have left."""
    done = subprocess.run(
        ["git", "ls-tree", "-r", "--name-only", FORMER, "tests/benchmarks/"], cwd=ROOT,
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    if done.returncode:
        pytest.skip("needs the history of the checkout")
    return {PurePosixPath(line).stem for line in done.stdout.splitlines()}


def tools_named():
    """Those that a paragraph without the former commit names, and those beside it."""
    now, former = set(), set()
    for paragraph in re.split(r"\n\s*\n", text_of(*MENTIONS)):
        named = re.findall(r"python tests/benchmarks (\w+)", paragraph)
        (former if f"commit {FORMER}" in paragraph else now).update(named)
    return now - {"NAME"}, former


def test_commands_that_have_left_were_there_at_the_commit_that_is_named():
    _, former = tools_named()
    assert len(former) > 10
    assert former - known_tools().keys() - former_tools() == set()


def test_commands_and_files_that_are_named_exist():
    """In the documentation, and in what the code says of itself."""
    text = text_of(*MENTIONS)
    now, _ = tools_named()
    assert len(now) > 10
    assert now - known_tools().keys() == set()
    files = {name for name in FILE.findall(text) if not TO_MAKE.search(name)}
    assert len(files) > 150
    files = {name for name in files if HAS_PLUGINS or not name.startswith("plugins/")}
    assert [name for name in sorted(files) if not list(ROOT.glob(name))] == []
    targets = set(TARGET.findall(text_of(*PAGES)))
    assert len(targets) > 10
    assert (
        targets - set(re.findall(r"^([\w-]+):", text_of(ROOT / "Makefile"), re.MULTILINE)) == set()
    )


def test_modules_and_what_is_in_them_that_pages_name_exist():
    entry_points = {*plugins.GROUPS, "eventsweep.scenes", "eventsweep.upsamplers"}
    names = set(DOTTED.findall(text_of(*PAGES))) - entry_points
    names = {name for name in names if HAS_PLUGINS or not name.startswith("plugins")}
    assert len(names) > 60
    assert [name for name in sorted(names) if not exists(name)] == []


def exists(name):
    """Whether a dotted name is that of a module, or of something in one."""
    try:
        pkgutil.resolve_name(f"eventsweep.{name.removeprefix('eventsweep.')}")
    except (ImportError, AttributeError):
        return False
    return True


def test_each_folder_of_tools_is_found_and_shows_its_parts_at_a_glance():
    folders = sorted(path for path in TOOLS.iterdir() if list(path.glob("*.py")))
    assert len(folders) > 5
    assert [path for path in TOOLS.glob("*.py") if path.name != "__main__.py"] == []
    sizes = {path.name: len(list(path.glob("*.py"))) for path in folders}
    assert {name: size for name, size in sizes.items() if size > MOST_MODULES} == {}
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]
    for listed in (settings["pytest"]["ini_options"]["pythonpath"], settings["mypy"]["mypy_path"]):
        missing = {path.relative_to(ROOT).as_posix() for path in folders} - set(listed)
        assert missing == set(), "name the folder in pyproject.toml"


@pytest.mark.parametrize("name", ["simulate_stages", "structure", "settings_table"])
def test_a_tool_runs_by_its_name(name):
    """With what it imports from other folders of tools."""
    done = subprocess.run(
        [sys.executable, str(TOOLS), name, "--help"], cwd=ROOT, capture_output=True, text=True,
        check=False, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert "usage" in done.stdout + done.stderr, done.stderr


def test_the_list_of_tools_says_what_each_does():
    done = subprocess.run(
        [sys.executable, str(TOOLS), "no_such"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 2
    lines = done.stderr.splitlines()
    assert lines[0].startswith("no tool 'no_such'")
    assert len(lines) - 1 == len(known_tools()) > 12
    assert all(len(line.split()) > 3 for line in lines[1:])


@needs_plugins
@pytest.mark.parametrize("name", ["quick", "suite-v5", "suite-v3"])
def test_the_page_on_suites_counts_their_seeds_and_jobs(name):
    suite, subset = load(name)
    cases, seeds = extent(suite, subset, None, None)
    waiting, names = suite_jobs(suite, cases, seeds), set()
    while waiting:
        job = waiting.pop()
        names.add(job.name)
        waiting += job.needs
    line = re.search(rf"^\| `{name}` \|.*$", text_of(DOCS / "suite.md"), re.MULTILINE)
    assert [cell.strip() for cell in line[0].strip("|").split("|")][-2:] == [
        str(len(seeds)), str(len(names)),
    ]  # fmt: skip
