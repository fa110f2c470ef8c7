"""What the documentation counts is as many as the code has; flags that it names are taken."""

import json
import re

import pytest

from eventsweep.emvs.dsi.fusion import MEANS
from eventsweep.emvs.formats import FORMATS
from eventsweep.eval.cli.main import app
from eventsweep.scenes import summaries
from places import PAGES as DOCUMENTATION
from places import ROOT, TOOLS, needs_plugins, numbers_in, of_absent_plug_ins, page
from programs import COMMANDS, command

DOCS = ROOT / "docs"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SUPPORT.md")), *DOCUMENTATION
]  # fmt: skip
PRODUCT = ("emvs", "sim", "scenes", "eval", "eventsweep", "plugins")
# Of programs that are not ours, which pages explain beside it: Dask's; v2e's have underscores.
OTHERS = {"--nthreads", "--tls-ca-file"}
CALL = re.compile(r"eventsweep ([a-z]+)((?: [^`\n|;&#]*)?)")
FLAG = re.compile(r"(?<![\w-])--[a-z][\w-]*(?:\.[\w-]+)*")


COUNTS = {
    "formats": ("datasets.md", r"\[(\w+)\s+formats\]", lambda: [len(FORMATS)]),
    "fusions": ("mapper.md", r"with\s+all\s+(\w+)\s+fusion\s+functions", lambda: [len(MEANS)]),
    "hard cases": (
        "scenes.md", r"^(\w+) scenes that violate",
        lambda: [sum(text.startswith("hard:") for text in summaries().values())],
    ),
}  # fmt: skip


CORE_WORDS, CORE_PAGES = 30_000, 20
MOST_WORDS, MOST_PAGES = 42_000, 29


def words_of(text):
    """Words as a reader counts them: rules and bars of tables are none."""
    return sum(bool(re.search(r"\w", word)) for word in text.split())


def prose_of(notebook):
    """The text between the code of a notebook."""
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    return "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")


def test_the_documentation_is_short():
    """All pages below `docs`, tables that tools write included, and the words of notebooks."""
    pages = {
        path: words_of(path.read_text("utf-8")) for path in {*DOCS.rglob("*.md"), *DOCUMENTATION}
    }
    notebooks = sum(words_of(prose_of(path)) for path in DOCS.rglob("*.ipynb"))
    assert len(pages) <= MOST_PAGES, "merge pages: what is said twice helps nobody"
    core = {path: count for path, count in pages.items() if path.parent == DOCS}
    assert len(core) <= CORE_PAGES
    assert sum(core.values()) <= CORE_WORDS, "shorten the core's pages, or link to a plug-in's"
    longest = {path.name: count for path, count in sorted(pages.items(), key=lambda x: -x[1])[:5]}
    total = sum(pages.values()) + notebooks
    assert total <= MOST_WORDS, f"shorten pages; the longest are {longest}"


@pytest.mark.parametrize("what", COUNTS)
def test_what_a_page_counts_is_as_many(what):
    name, pattern, counted = COUNTS[what]
    assert numbers_in(page(name), pattern) == counted()


def test_the_readme_has_every_verb_in_its_table():
    table = (ROOT / "README.md").read_text("utf-8").split("| Command | What it does |")[1]
    cells = [line.split("|")[1] for line in table.split("\n\n")[0].splitlines()[2:]]
    listed = [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]
    there = set(listed) - of_absent_plug_ins()[0]
    assert sorted(there) == sorted(name for name in app if not name.startswith("-"))


def taken():
    """Command -> the flags that it takes."""
    return {
        name: {
            flag for taken in command(name).assemble_argument_collection() for flag in taken.names
        }
        | {"--help", "--help-all"}
        for name in COMMANDS
    }


def calls(text, known):
    """(command, flags) wherever a text calls one, in prose and in code."""
    for verb, rest in CALL.findall(text.replace("\\\n", " ")):
        name = verb if verb in known else " ".join([verb, *rest.split()[:1]])
        if name in known:
            yield name, FLAG.findall(rest)


@needs_plugins
def test_every_flag_in_prose_or_of_a_command_that_is_named_is_taken():
    known = taken()
    files = [*PAGES, ROOT / "Makefile", *(ROOT / ".github").rglob("*.yml")]
    files += [path for name in PRODUCT for path in (ROOT / name).rglob("*.py")]
    flags_named = [
        (path.name, name, flag)
        for path in files
        for name, flags in calls(path.read_text("utf-8"), known)
        for flag in flags
    ]
    assert len(flags_named) > 200
    assert [named for named in flags_named if named[2] not in known[named[1]]] == []
    # Settings (`--map.`, `--sim.`, `--score.`) must be a command's; `NAME` stands for any.
    tools = "\n".join(path.read_text("utf-8") for path in TOOLS.rglob("*.py"))
    options = set(FLAG.findall(tools + (ROOT / "conftest.py").read_text("utf-8")))
    every = set().union(*taken().values(), OTHERS, {"--version"})
    assert [
        (page.name, flag)
        for page in PAGES
        for flag in re.findall(rf"`({FLAG.pattern})", page.read_text("utf-8"))
        if flag not in every and ("." in flag or flag not in options)
        and "_" not in flag and "NAME" not in flag
    ] == []  # fmt: skip
