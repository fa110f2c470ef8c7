"""Addresses come from one place, and lead to pages that exist."""

import ast
import importlib.metadata
import re

from eventsweep.emvs.utils import release
from places import ROOT

SOURCES = [
    path for name in ("emvs", "sim", "scenes", "eval", "eventsweep")
    for path in (ROOT / name).rglob("*.py")
]  # fmt: skip
# Help is made of these modules' docstrings.
SHOWN = ("eval/cli/", "/config.py")


def anchors(page):
    """Of a page's headings, as the site makes them."""
    heads = re.findall(r"^#+ (.*)", (ROOT / "docs" / f"{page}.md").read_text("utf-8"), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in heads}


def pages_named_by_calls():
    """What the code gives to `release.page`."""
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") == "page":
                yield tuple(ast.literal_eval(argument) for argument in node.args)


def strings(tree):
    """All that may reach a user: strings but docstrings."""
    told = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in told:
            yield node.value


def test_errors_name_pages_and_sections_that_exist():
    found = list(pages_named_by_calls())
    assert len(found) >= 2
    for name, *section in found:
        assert set(section) <= anchors(name), name


def shown_strings(path):
    """What a module may show to a user: of those that help is made of, docstrings too."""
    tree = ast.parse(path.read_text("utf-8"))
    if not any(part in path.as_posix() for part in SHOWN):
        return list(strings(tree))
    texts = [node.value for node in ast.walk(tree) if isinstance(node, ast.Constant)]
    module = ast.get_docstring(tree, clean=False) if path.name == "config.py" else None
    return [text for text in texts if isinstance(text, str) and text != module]


def test_no_message_names_a_file_that_the_wheel_does_not_hold():
    named = [
        f"{path.relative_to(ROOT)}: {text}"
        for path in SOURCES for text in shown_strings(path) if re.search(r"\bdocs/\w+\.md", text)
    ]  # fmt: skip
    assert len(SOURCES) > 300
    assert named == []


def test_pages_that_help_mentions_exist():
    texts = [path.read_text("utf-8") for path in SOURCES]
    named = {name for text in texts for name in re.findall(r"the page\s+`(\w+)`", text)}
    assert len(named) > 3
    assert [name for name in named if not (ROOT / "docs" / f"{name}.md").exists()] == []


def test_commands_change_with_the_one_place(monkeypatch):
    monkeypatch.setattr(release, "REPOSITORY", "https://elsewhere/es")
    assert release.install() == "pip install 'eventsweep @ git+https://elsewhere/es'"
    assert release.install_extra("mesh") == release.install("mesh")
    monkeypatch.setattr(release, "ON_INDEX", True)
    assert release.install() == "pip install eventsweep"
    assert release.install("mesh") == "pip install 'eventsweep[mesh]'"
    monkeypatch.setattr(release, "DOCUMENTATION", "https://elsewhere")
    assert release.page("gate", "tolerances") == "https://elsewhere/gate.html#tolerances"


def test_without_any_address_commands_work_from_a_checkout_or_beside_a_wheel(monkeypatch):
    for name in ("REPOSITORY", "DOCUMENTATION"):
        monkeypatch.setattr(release, name, "")
    monkeypatch.setattr(release, "ON_INDEX", False)
    assert (release.install(), release.install("mesh")) == (
        "pip install .",
        "pip install '.[mesh]'",
    )
    assert release.page("gate", "tolerances") == "the page `gate` of the documentation"
    needs = [
        "numpy>=2",
        "torch>=2.5; extra == 'train'",
        "a>=1; sys_platform == 'no' and extra == 'x'",
    ]
    monkeypatch.setattr(importlib.metadata, "requires", lambda _: needs)
    assert release.install_extra("train") == "pip install 'torch>=2.5'"
    assert release.install_extra("x") == "pip install '.[x]'"

    def missing(_):
        raise importlib.metadata.PackageNotFoundError

    monkeypatch.setattr(importlib.metadata, "requires", missing)
    assert release.install_extra("train") == "pip install '.[train]'"
