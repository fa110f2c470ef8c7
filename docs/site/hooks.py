"""What the documentation site gets from elsewhere, when mkdocs builds it.

- The front page and the pages on the project are the files at the top of the repository.
- Pages of plug-ins lie beside their code, and on the site with the others.
- Links that leave `docs/` lead to such a page, or else into the repository.
- The reference lists every public name with its docstring, and the example of it that `docs/api.md`
  has and the tests run.
- A page can name how to install, which depends on where a release is: `install.md` has it.
- Notebooks become pages, with what they show.
- A picture leads to itself at full size: on a phone a page shows four panels in 9 cm.
"""

from __future__ import annotations

import ast
import posixpath
import re
import runpy
from pathlib import Path
from typing import TYPE_CHECKING

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files
    from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[2]
RELEASE = runpy.run_path(str(ROOT / "emvs" / "utils" / "release.py"))
# Files at the top of the repository -> pages of the site.
TOP = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "SECURITY.md": "security.md",
    "SUPPORT.md": "support.md",
}
PLUG_INS = {
    path.relative_to(ROOT).as_posix(): path.name
    for pattern in ("*.md", "*.yml")
    for path in sorted(ROOT.glob(f"plugins/*/{pattern}"))
}
"""Pages of plug-ins and files that they link to -> pages and files of the site."""
LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|mailto:|#)([^)\s]+)\)")
ON_SITE = {".html", ".ipynb", ".json", ".md", ".png", ".svg", ".webp", ".yml"}
FENCE = re.compile(r"^(```.*?^```)", re.MULTILINE | re.DOTALL)
BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
NOTEBOOKS = ROOT / "docs" / "notebooks"
HERE = "<!-- reference -->"
PICTURE = re.compile(r'(<img [^>]*src="([^"]+)"[^>]*>)')


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Addresses, from the one place that has them."""
    if RELEASE["DOCUMENTATION"]:
        config.site_url = RELEASE["DOCUMENTATION"] + "/"
    if RELEASE["REPOSITORY"]:
        config.repo_url = RELEASE["REPOSITORY"]
        config.repo_name = "Repository"
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that lie outside of `docs/`."""
    for name, page in TOP.items():
        text = with_site_links((ROOT / name).read_text("utf-8"), "")
        if page == "changelog.md":  # it names everything, and would come before the pages on it
            text = f"---\nsearch:\n  exclude: true\n---\n\n{text}"
        files.append(File.generated(config, page, content=text))
    for name, page in PLUG_INS.items():
        text = with_site_links((ROOT / name).read_text("utf-8"), posixpath.dirname(name), "docs")
        files.append(File.generated(config, page, content=text))
    for path in sorted(NOTEBOOKS.glob("*.ipynb")):
        for file in pages_of_notebook(path, config):
            files.append(file)
    return files


def pages_of_notebook(path: Path, config: MkDocsConfig) -> Iterator[File]:
    """A notebook as a page, and its pictures as files beside it."""
    from nbconvert import MarkdownExporter

    text, resources = MarkdownExporter().from_filename(path, {"unique_key": path.stem})
    title, _, rest = text.partition("\n")
    link = f'\n<a href="{path.name}" download>Download the notebook</a>\n'
    folder = NOTEBOOKS.name
    yield File.generated(config, f"{folder}/{path.stem}.md", content=f"{title}\n{link}{rest}")
    for name, picture in resources["outputs"].items():
        yield File.generated(config, f"{folder}/{name}", content=picture)


def on_page_markdown(markdown: str, page: Page, **_: object) -> str:
    """Turns links that leave `docs/` into the site's, and fills in the reference."""
    if page.file.src_uri in (*TOP.values(), *PLUG_INS.values()):
        return markdown
    if HERE in markdown:
        # Hundreds of names begin with what people ask: "is", "no". They come after the pages.
        page.meta["search"] = {"boost": 0.05}
        api = (ROOT / "docs" / "api.md").read_text("utf-8")
        markdown = markdown.replace(HERE, reference(api))
    return with_site_links(markdown, posixpath.join("docs", posixpath.dirname(page.file.src_uri)))


def on_page_content(html: str, **_: object) -> str:
    """Links every picture to its file."""
    return PICTURE.sub(r'<a href="\2">\1</a>', html)


def with_site_links(text: str, folder: str, shown: str = "") -> str:
    """A page's text with links that work on the site; code is left alone.

    Links into the repository become their words while it has no address.

    Args:
        text: Markdown.
        folder: where its file is, from the top of the repository.
        shown: the folder that it would have to be in to lie where the site has it.
    """

    def moved(found: re.Match[str]) -> str:
        path, mark, section = found[3].partition("#")
        target = address(posixpath.normpath(posixpath.join(folder, path)))
        if target and not target.startswith("http"):
            target = posixpath.relpath(target, posixpath.relpath(shown or folder or "docs", "docs"))
        return f"{found[1]}[{found[2]}]({target}{mark}{section})" if target else found[2]

    pieces = FENCE.split(text)
    return "".join(one if one.startswith("```") else LINK.sub(moved, one) for one in pieces)


def address(target: str) -> str:
    """Where a path of the repository is found on the site; empty if nowhere."""
    if target in TOP or target in PLUG_INS:
        return (TOP | PLUG_INS)[target]
    inside = target.removeprefix("docs/")
    if inside != target and Path(inside).suffix in ON_SITE:
        return re.sub(r"\.ipynb$", ".md", inside)
    return f"{RELEASE['REPOSITORY']}/blob/main/{target}" if RELEASE["REPOSITORY"] else ""


def reference(api: str) -> str:
    """Every public name under the heading that `docs/api.md` has for it.

    Raises:
        PluginError: a name has no example there.
    """
    places = public_names()
    sections = re.split(r"^## ", api, flags=re.MULTILINE)[1:]
    written: list[str] = []
    for section in sections:
        title, _, body = section.partition("\n")
        rows = re.findall(r"^\| (`.*?) \|", body, re.MULTILINE)
        named = dict.fromkeys(name for row in rows for name in re.findall(r"`(\w+)", row))
        if listed := [name for name in named if name in places]:
            written.append(f"## {title}\n")
            written += [entry(name, places.pop(name), body + api) for name in listed]
    missing = sorted(places)
    if missing:
        raise PluginError(f"docs/api.md has no row and example for {', '.join(missing)}")
    return "\n".join(written)


def entry(name: str, place: str, body: str) -> str:
    """A name's docstring, and the first example of it in a text."""
    examples = [block for block in BLOCK.findall(body) if re.search(rf"\bes\.{name}\b", block)]
    if not examples:
        raise PluginError(f"docs/api.md has no example of {name}")
    example = f'??? example "Example"\n\n    ```python\n{indented(examples[0])}    ```\n'
    options = f"    options:\n      heading: es.{name}\n      toc_label: {name}\n"
    return f"::: {place}\n{options}\n{example}"


def indented(code: str) -> str:
    """Code inside a block of Markdown."""
    return "".join(f"    {line}" if line.strip() else line for line in code.splitlines(True))


def public_names() -> dict[str, str]:
    """The names for users of the library, and where each is defined: without importing it."""
    stub = ast.parse((ROOT / "eventsweep" / "__init__.pyi").read_text("utf-8"))
    return {
        alias.name: ".".join(filter(None, ("eventsweep", node.module, alias.name)))
        for node in stub.body
        if isinstance(node, ast.ImportFrom)
        for alias in node.names
        if alias.name != "__version__"
    }
