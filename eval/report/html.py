"""Pages of tables as text: what stands in them, and the templates that they are made of."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Literal

import jinja2
from markupsafe import Markup

from eventsweep.emvs.utils.outputs import files_together
from eventsweep.eval.figures.images import data_uri

Kind = Literal["", "better", "worse", "other", "best"]
REPORT_NAME = "report.html"
_OWN, _FOLDER = "eventsweep.eval.report", "templates"
# The colours of `report.css`, which does not reach into an image.
INK_STYLE = (
    "<style>svg { color: #1d2328 } "
    "@media (prefers-color-scheme: dark) { svg { color: #e4e7e9 } }</style>"
)


@dataclass(frozen=True, slots=True)
class Head:
    """A column's heading; `direction` says the end that sorts to the top, `text` that it is text.

    With `arrow`, the heading shows which direction is better, too.
    """

    title: str
    unit: str = ""
    direction: str = "lower"
    text: bool = False
    arrow: bool = False


@dataclass(frozen=True, slots=True)
class GridCell:
    """One cell: as read, as sorted, how it stands out, and the page beside that it leads to."""

    text: str
    value: float = math.nan
    kind: Kind = ""
    colour: str = ""
    link: str = ""


@dataclass(frozen=True, slots=True)
class Grid:
    """A sortable table, and above it what its numbers are."""

    heads: tuple[Head, ...]
    lines: tuple[tuple[GridCell, ...], ...]
    about: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture beside others: its heading, an address that holds it, and what it shows."""

    title: str
    address: str
    about: str


@dataclass(frozen=True, slots=True)
class Moving:
    """Marks that a slider moves over a section's figure.

    Attributes:
        names: of the slider's steps.
        dots: per mark, its place at each step, as shares of the figure's width and height.
        line: an upright line's place at each step, as a share of the width; empty for none.
        line_span: its upper and lower end, as shares of the height.
    """

    names: tuple[str, ...]
    dots: tuple[tuple[tuple[float, float], ...], ...] = ()
    line: tuple[float, ...] = ()
    line_span: tuple[float, float] = (0.0, 1.0)

    def as_json(self) -> Markup:
        """What the page's script reads."""
        lines = [[[x, 0] for x in self.line]] if self.line else []
        text = json.dumps({"names": self.names, "marks": [*self.dots, *lines]})
        return Markup(text.replace("<", "\\u003c"))


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page: one table per metric, of which one is shown at a time.

    Attributes:
        names: of the tables, on the buttons.
        figure: a picture, as an address that holds it.
        failures: (what, why) pairs.
        choice: what the buttons choose.
    """

    id: str
    title: str
    names: tuple[str, ...]
    tables: tuple[Grid, ...]
    text: str = ""
    figure: str = ""
    figure_about: str = "curves per method"
    failures: tuple[tuple[str, str], ...] = ()
    choice: str = "Metric"
    chosen: int = 0
    pictures: tuple[Picture, ...] = ()
    moving: Moving | None = None


@dataclass(frozen=True, slots=True)
class Page:
    """A whole page; `files` lie beside it and are linked.

    It begins with a sentence, `lead`, and pictures, before all numbers.
    """

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    provenance: Grid
    overview: Grid | None = None
    findings: tuple[str, ...] = ()
    note: str = ""
    version: str = ""
    files: tuple[str, ...] = ()
    lead: str = ""
    pictures: tuple[Picture, ...] = ()
    links: tuple[tuple[str, str], ...] = ()


def page_text(page: Page) -> str:
    """The page as HTML."""
    content = {name: getattr(page, name) for name in Page.__slots__}
    most = max((len(section.names) for section in page.sections), default=0)
    player_js = inline("player.js")
    return render("tables.html.j2", "tables", "player", most=most, player_js=player_js, **content)


def render(template: str, *styles: str, package: str = _OWN, **content: Any) -> str:
    """A page as HTML; names from files are escaped, and nothing is loaded from elsewhere.

    `styles` name style sheets beside that of all pages; a plug-in's `package` has a template, and
    style sheets, in its folder `templates`.
    """
    css = Markup("").join(inline(f"{name}.css", package) for name in ("report", *styles))
    page = environment(package).get_template(template)
    return page.render(content, css=css, js=inline("report.js"))


def write_page(folder: Path, text: str) -> Path:
    """Writes `report.html` into the folder of an output, and returns its path."""
    with files_together(folder, (REPORT_NAME,)) as staged:
        (staged / REPORT_NAME).write_text(text, encoding="utf-8")
    return folder / REPORT_NAME


def versions_grid(names: Sequence[str], versions: Sequence[Mapping[str, str]]) -> Grid:
    """Versions side by side; a line where they differ stands out."""
    lines = []
    for library in sorted(set().union(*versions)):
        texts = [installed.get(library, "absent") for installed in versions]
        kind: Kind = "worse" if len(set(texts)) > 1 else ""
        lines.append((GridCell(library), *(GridCell(text, kind=kind) for text in texts)))
    return Grid((Head("version of"), *(Head(name) for name in names)), tuple(lines))


def command_grid(command: str) -> Grid:
    """The command that made a page."""
    return Grid((Head("command", text=True),), ((GridCell(command or "Python"),),))


def files_in(folder: Path, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the names that are files in a folder: what a page beside them can link to."""
    return tuple(name for name in names if (folder / name).is_file())


def plural(count: int, noun: str) -> str:
    """A count and what is counted: 1 window, 2 windows."""
    return f"{count} {noun}{'s' * (count != 1)}"


def svg_uri(drawing: str) -> str:
    """A drawing of `svg` as an address that holds it; its text follows light and dark."""
    opening, rest = drawing.split(">", 1)
    return data_uri("image/svg+xml", f"{opening}>{INK_STYLE}{rest}".encode())


@cache
def environment(package: str = _OWN) -> jinja2.Environment:
    """Templates, of a package before ours, that escape everything that is not marked as safe."""
    places = dict.fromkeys((package, _OWN))
    return jinja2.Environment(
        loader=jinja2.ChoiceLoader([jinja2.PackageLoader(each, _FOLDER) for each in places]),
        autoescape=True,
        trim_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


def inline(name: str, package: str = _OWN) -> Markup:
    """A file beside the templates of a package, or else of ours, as it stands."""
    file = resources.files(package).joinpath(_FOLDER, name)
    if not file.is_file():
        file = resources.files(_OWN).joinpath(_FOLDER, name)
    return Markup(file.read_text(encoding="utf-8"))
