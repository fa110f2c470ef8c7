"""What the documentation counts is as many as the code has; flags that it names are taken."""

import json
import re

import pytest

from eventsweep.emvs.dsi.fusion import MEANS
from eventsweep.emvs.formats import FORMATS
from eventsweep.eval.cli.main import app
from eventsweep.eval.learning.sequences import sequences
from eventsweep.eval.suite.definition import load
from eventsweep.scenes import summaries
from places import ROOT, TOOLS
from program import COMMANDS, command
from study_samples import DEVELOPMENT, FURTHER, UNSEEN

DOCS = ROOT / "docs"
PAGES = [
    *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SUPPORT.md")), *DOCS.glob("*.md")
]  # fmt: skip
PRODUCT = ("emvs", "sim", "scenes", "eval", "eventsweep")
WORDS = [
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen",
    "nineteen", "twenty",
]  # fmt: skip
# Of programs that are not ours, which pages explain beside it: Dask's; v2e's have underscores.
OTHERS = {"--nthreads", "--tls-ca-file"}
CALL = re.compile(r"eventsweep ([a-z]+)((?: [^`\n|;&#]*)?)")
FLAG = re.compile(r"(?<![\w-])--[a-z][\w-]*(?:\.[\w-]+)*")


def trained(part, what):
    return len({getattr(one, what) for one in sequences(part)})


def left_in_training():
    return {one.scene for one in sequences("training")} - {one.case for one in UNSEEN}


COUNTS = {
    "formats": ("datasets.md", r"\[(\w+)\s+formats\]", lambda: [len(FORMATS)]),
    "fusions": ("mapper.md", r"with\s+all\s+(\w+)\s+fusion\s+functions", lambda: [len(MEANS)]),
    "suite-v3": ("ranking.md", r"on the (\w+) cases\s+and (\w+) seeds of `suite-v3`",
     lambda: [len(load("suite-v3")[0].cases), len(load("suite-v3")[0].seeds)]),
    "hard cases": ("twins.md", r"^(\w+) scenes that violate",
     lambda: [sum(text.startswith("hard:") for text in summaries().values())]),
    "training": ("learned.md",
     r"simulates (\w+) sequences to learn from and (\w+) to calibrate with",
     lambda: [len(sequences("training")), len(sequences("calibration"))]),
    "rigs": ("learned.md", r"(\w+) rigs, forward", lambda: [trained("training", "rig")]),
    "scenes never seen": ("learned.md",
     r"without the (\w+)\s+scenes\s+of\s+these\s+samples\s.*with\s+the\s+(\w+)\s+others",
     lambda: [len({one.case for one in UNSEEN}), len(left_in_training())]),
    "what DERD-Net learns from": ("baselines.md",
     r"(\w+) simulated sequences, (\w+) scenes, (\w+) rigs",
     lambda: [len(sequences("training")), *(trained("training", w) for w in ("scene", "rig"))]),
    "samples": ("extraction.md", r"lists: (\w+) scenes.*together\s+with\s+(\w+)\s+\*further\*",
     lambda: [len({one.case for one in DEVELOPMENT}), len(FURTHER)]),
}  # fmt: skip


MOST_WORDS, MOST_PAGES = 55_000, 36


def words_of(text):
    """Words as a reader counts them: rules and bars of tables are none."""
    return sum(bool(re.search(r"\w", one)) for one in text.split())


def prose_of(notebook):
    """The text between the code of a notebook."""
    cells = json.loads(notebook.read_text("utf-8"))["cells"]
    return "\n".join("".join(one["source"]) for one in cells if one["cell_type"] == "markdown")


def test_the_documentation_is_short():
    """All pages below `docs`, tables that tools write included, and the words of notebooks."""
    pages = {path: words_of(path.read_text("utf-8")) for path in DOCS.rglob("*.md")}
    notebooks = sum(words_of(prose_of(path)) for path in DOCS.rglob("*.ipynb"))
    assert len(pages) <= MOST_PAGES, "merge pages: what is said twice helps nobody"
    longest = {path.name: count for path, count in sorted(pages.items(), key=lambda x: -x[1])[:5]}
    total = sum(pages.values()) + notebooks
    assert total <= MOST_WORDS, f"shorten pages; the longest are {longest}"


def number(word):
    return int(word) if word.isdecimal() else WORDS.index(word.lower())


@pytest.mark.parametrize("what", COUNTS)
def test_what_a_page_counts_is_as_many(what):
    page, pattern, counted = COUNTS[what]
    found = re.search(pattern, (DOCS / page).read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert found, f"{page} counts it no more: drop the entry"
    assert [number(word) for word in found.groups()] == counted()


def test_the_readme_has_every_verb_in_its_table():
    table = (ROOT / "README.md").read_text("utf-8").split("| Command | What it does |")[1]
    cells = [line.split("|")[1] for line in table.split("\n\n")[0].splitlines()[2:]]
    listed = [name for cell in cells for name in re.findall(r"`(\w+)`", cell)]
    assert sorted(listed) == sorted(name for name in app if not name.startswith("-"))


def taken():
    """Command -> the flags that it takes."""
    return {
        name: {flag for one in command(name).assemble_argument_collection() for flag in one.names}
        | {"--help", "--help-all"}
        for name in COMMANDS
    }


def calls(text, known):
    """(command, flags) wherever a text calls one, in prose and in code."""
    for verb, rest in CALL.findall(text.replace("\\\n", " ")):
        name = verb if verb in known else " ".join([verb, *rest.split()[:1]])
        if name in known:
            yield name, FLAG.findall(rest)


def test_every_flag_in_prose_or_of_a_command_that_is_named_is_taken():
    known = taken()
    files = [*PAGES, ROOT / "Makefile", *(ROOT / ".github").rglob("*.yml")]
    files += [path for name in PRODUCT for path in (ROOT / name).rglob("*.py")]
    found = [
        (path.name, name, flag)
        for path in files
        for name, flags in calls(path.read_text("utf-8"), known)
        for flag in flags
    ]
    assert len(found) > 200
    assert [one for one in found if one[2] not in known[one[1]]] == []
    # Settings (`--map.`, `--sim.`, `--score.`) must be a command's; `NAME` stands for any.
    tools = "\n".join(path.read_text("utf-8") for path in TOOLS.rglob("*.py"))
    options = set(FLAG.findall(tools + (ROOT / "tests" / "conftest.py").read_text("utf-8")))
    every = set().union(*taken().values(), OTHERS, {"--version"})
    assert [
        (page.name, flag)
        for page in PAGES
        for flag in re.findall(rf"`({FLAG.pattern})", page.read_text("utf-8"))
        if flag not in every and ("." in flag or flag not in options)
        and "_" not in flag and "NAME" not in flag
    ] == []  # fmt: skip
