"""The documentation site: its pages, links and addresses; and, slowly, the site itself."""

import ast
import importlib.util
import json
import re
import runpy
import sys
import tomllib
import types
from html.parser import HTMLParser

import pytest
import yaml

import eventsweep as es
from eventsweep.emvs.utils import release
from places import PAGES as DOCUMENTATION
from places import ROOT, needs_plugins
from programs import python

DOCS = ROOT / "docs"
FENCE = re.compile(r"^( *)```.*?^\1```", re.MULTILINE | re.DOTALL)
PAGES = [*(ROOT / name for name in ("README.md", "CONTRIBUTING.md")), *DOCUMENTATION]
# Texts that people read, and may copy a command from.
TEXTS = [
    *ROOT.glob("*.md"), *ROOT.glob("*.toml"), *ROOT.glob("*.cff"), ROOT / "Makefile",
    *DOCUMENTATION, *DOCS.glob("*.yml"), *(ROOT / ".github").rglob("*.yml"),
    *(path for name in ("emvs", "sim", "scenes", "eval", "eventsweep", "plugins", "tests")
      for path in (ROOT / name).rglob("*.py")),
]  # fmt: skip


def prose(page):
    """A page's text without its code."""
    return FENCE.sub("", page.read_text(encoding="utf-8"))


def anchors(page):
    """Of all headings, as GitHub and the site make them."""
    heads = re.findall(r"^#+ (.*)", prose(page), re.MULTILINE)
    plain = (re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", head) for head in heads)
    return {re.sub(r"[^\w\- ]", "", head).strip().lower().replace(" ", "-") for head in plain}


def settings():
    """mkdocs.yml, but for what only mkdocs can construct."""
    text = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    return yaml.safe_load(re.sub(r"!!python/\S+ \{.*\}", "none", text))


def listed(entry):
    """The pages of a part of the navigation."""
    if isinstance(entry, str):
        return [entry]
    parts = entry.values() if isinstance(entry, dict) else entry
    return [page for part in parts for page in listed(part)]


def links_with_anchors(page):
    """(file, anchor) of a page's links to headings here."""
    for path, anchor in re.findall(r"\]\(([^)\s#]*)#([^)\s]+)\)", prose(page)):
        if not path.startswith("http"):
            yield (page.parent / path if path else page), anchor


@needs_plugins
def test_every_page_is_in_the_navigation_once_and_links_lead_to_headings():
    links = [(page, *link) for page in PAGES for link in links_with_anchors(page)]
    headings = {path: anchors(path) for _, path, _ in links}
    assert len(links) > 50
    dead = [f"{page.name}: {to.name}#{a}" for page, to, a in links if a not in headings[to]]
    assert dead == []
    listed_pages = listed(settings()["nav"])
    pages = {path.name for path in DOCUMENTATION}
    pages |= {f"notebooks/{path.stem}.md" for path in (DOCS / "notebooks").glob("*.ipynb")}
    top = {"index.md", "contributing.md", "changelog.md", "security.md", "support.md"}
    assert sorted(listed_pages) == sorted(pages | top)


@needs_plugins
def test_every_public_name_has_its_row_and_every_error_is_one_of_the_product():
    """The reference is made of the tables in api.md and of the stub's imports."""
    rows = re.findall(r"^\| (`.*?) \|", (DOCS / "api.md").read_text("utf-8"), re.MULTILINE)
    named = {name for row in rows for name in re.findall(r"`(\w+)", row)}
    assert set(es.__all__) <= named
    lines = re.findall(r"^### `(.*)`", (DOCS / "faq.md").read_text("utf-8"), re.M)
    assert len(lines) > 20
    said = "\n".join(product_strings())
    pieces = {piece.strip() for line in lines for piece in line.split("…")}
    assert sorted(piece for piece in pieces if piece not in said) == []


def product_strings():
    """All strings in the product's code, pieces of f-strings included."""
    for package in ("emvs", "sim", "scenes", "eval", "eventsweep", "plugins"):
        for path in (ROOT / package).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text("utf-8"))):
                if isinstance(node, ast.Constant) and isinstance(node.value, str):
                    yield node.value


def test_nothing_says_that_an_index_has_it_while_none_does():
    """Where one has it, `release.ON_INDEX` changes every command; no text has one of its own."""
    wrong = re.compile(r"pip install '?eventsweep(?!\S* @)")
    here = {ROOT / "tests" / "emvs" / "utils" / "test_release.py"}
    wrong_in = [
        path for path in TEXTS if path not in here and wrong.search(path.read_text("utf-8"))
    ]
    assert release.ON_INDEX or wrong_in == []


def test_the_page_on_installing_and_the_citation_are_of_this_release():
    page = (DOCS / "install.md").read_text(encoding="utf-8")
    assert release.install() in page, "python tests/benchmarks install_page --commands-only"
    assert release.install("mesh") in page
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = set(project["optional-dependencies"]) - {"dev", "docs"}
    assert set(re.findall(r"^\| `(\w+)` \|", page, re.MULTILINE)) == extras
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text("utf-8"))
    assert cited["version"] == project["version"]
    assert cited.get("repository-code", "") == release.REPOSITORY
    assert cited["license"] == project["license"]


@pytest.fixture
def build_hook(monkeypatch):
    """What `hatch_build.py` defines, without hatchling."""
    interface = types.SimpleNamespace(MetadataHookInterface=object)
    monkeypatch.setitem(sys.modules, "hatchling.metadata.plugin.interface", interface)
    for name in ("hatchling", "hatchling.metadata", "hatchling.metadata.plugin"):
        monkeypatch.setitem(sys.modules, name, types.ModuleType(name))
    return runpy.run_path(str(ROOT / "hatch_build.py"))


def test_the_long_description_and_metadata_have_whole_addresses_that_there_are(build_hook):
    """Pictures of a package index cannot be relative."""
    readme = (ROOT / "README.md").read_text("utf-8")
    text = build_hook["with_whole_addresses"](readme, "https://example.org/es")
    targets = re.findall(r"\]\(([^)]+)\)", text)
    assert len(targets) > 20
    assert [target for target in targets if not target.startswith("https://")] == []
    assert "https://example.org/es/raw/main/docs/images/demo.webp" in targets
    metadata: dict[str, object] = {}
    build_hook["ReleaseMetadata"]().update(metadata)
    targets = re.findall(r"\]\(([^)]+)\)", metadata["readme"]["text"])
    assert [target for target in targets if not target.startswith("https://")] == []
    assert metadata["urls"].get("Repository", "") == release.REPOSITORY
    assert metadata["urls"].get("Documentation", "") == release.DOCUMENTATION
    assert all(metadata["urls"].values())


def test_no_placeholder_reaches_a_reader():
    """Nothing that people read, installs or runs stands for an address that is not known yet."""
    placeholder, tests = re.compile(r"\bOWNER\b|\bHOST\b"), ROOT / "tests"
    below = [path for ending in ("md", "yml", "html") for path in DOCS.rglob(f"*.{ending}")]
    texts = {*(path for path in TEXTS if tests not in path.parents), *below}
    assert len(texts) > 300
    assert [path for path in texts if placeholder.search(path.read_text("utf-8"))] == []


class Loaded(HTMLParser):
    """What a page loads by itself."""

    def __init__(self):
        super().__init__()
        self.addresses = []

    def handle_starttag(self, tag, attributes):
        named = dict(attributes)
        if tag in ("script", "img", "iframe", "source"):
            self.addresses.append(named.get("src") or "")
        if tag == "link" and named.get("rel") in ("stylesheet", "icon", "preload", "preconnect"):
            self.addresses.append(named.get("href") or "")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    if importlib.util.find_spec("mkdocs") is None:
        pytest.skip("mkdocs is not installed: make site installs it")
    folder = tmp_path_factory.mktemp("site")
    words = ["-m", "mkdocs", "build", "--strict", "--site-dir", folder]
    done = python(*words, cwd=ROOT, env={"NO_MKDOCS_2_WARNING": "1"}, timeout=None)
    assert done.returncode == 0, done.stderr
    return folder


@pytest.mark.slow
def test_the_site_is_whole_loads_nothing_from_elsewhere_and_has_what_errors_name(site, monkeypatch):
    pages = list(site.rglob("*.html"))
    assert len(pages) > 30
    for page in pages:
        loaded = Loaded()
        loaded.feed(page.read_text(encoding="utf-8"))
        away = [one for one in loaded.addresses if re.match(r"(https?:)?//", one)]
        assert away == [], page.name
    text = (site / "api.html").read_text(encoding="utf-8")
    names = set(es.__all__) - {"__version__"}
    assert [name for name in names if f"es.{name}" not in text] == []
    assert text.count("<summary>Example") == len(names)
    monkeypatch.setattr(release, "DOCUMENTATION", "https://example.org")
    for name in ("formats", "datasets", "gate"):
        address = release.page(name)
        assert (site / address.removeprefix("https://example.org/")).is_file()


@pytest.mark.slow
def test_search_finds_names_without_their_prefix_but_pages_before_names(site):
    """The reference has names that begin with "is" and "no", as do questions."""
    index = json.loads((site / "search" / "search_index.json").read_text("utf-8"))
    reference = [one for one in index["docs"] if one["location"].startswith("api.html#")]
    assert len(reference) > 100
    assert {one["boost"] for one in reference} == {0.05}
    (title,) = (one["title"] for one in reference if one["location"].endswith("MapperConfig"))
    assert "MapperConfig" in re.split(index["config"]["separator"], re.sub("<.*?>", "", title))
    assert not any(one["location"].startswith("changelog") for one in index["docs"])
    assert sum("boost" in one for one in index["docs"]) == len(reference) + 1  # and their page
