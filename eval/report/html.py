"""Pages: what stands in them, block by block, and the one template that they are made of."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import ClassVar, Literal

import jinja2
from markupsafe import Markup

from eventsweep.emvs.utils.outputs import files_together
from eventsweep.emvs.utils.runtime import versions as installed_versions
from eventsweep.eval.figures.colormaps import Scale

Kind = Literal["", "better", "worse", "other", "best"]
REPORT_NAME = "report.html"
_PACKAGE, _FOLDER = "eventsweep.eval.report", "templates"


@dataclass(frozen=True, slots=True)
class Head:
    """A column's heading; `direction` says the end that sorts to the top, `text` that it is text.

    With `arrow`, the heading shows which direction is better, too; the pointer over it, `about`.
    """

    title: str
    unit: str = ""
    direction: str = "lower"
    text: bool = False
    arrow: bool = False
    about: str = ""


@dataclass(frozen=True, slots=True)
class GridCell:
    """One cell: as read, as sorted, how it stands out, and the page beside that it leads to."""

    text: str
    value: float = math.nan
    kind: Kind = ""
    colour: str = ""
    link: str = ""
    about: str = ""


@dataclass(frozen=True, slots=True)
class Grid:
    """A sortable table, above it what its numbers are; `ordered_by` is the column of its order."""

    kind: ClassVar[str] = "grid"
    heads: tuple[Head, ...]
    lines: tuple[tuple[GridCell, ...], ...]
    about: str = ""
    ordered_by: int = -1


@dataclass(frozen=True, slots=True)
class Text:
    """A paragraph that begins with `head` in bold, a heading within a section, or a file."""

    kind: ClassVar[str] = "text"
    text: str
    style: Literal["", "lead", "note", "caption", "heading", "file"] = ""
    head: str = ""


@dataclass(frozen=True, slots=True)
class Sentences:
    """Sentences below each other; nothing where there are none."""

    kind: ClassVar[str] = "sentences"
    lines: tuple[str, ...]
    style: Literal["findings", "failures", "note"] = "findings"


@dataclass(frozen=True, slots=True)
class Facts:
    """(name, value) pairs."""

    kind: ClassVar[str] = "facts"
    pairs: tuple[tuple[str, str], ...]


@dataclass(frozen=True, slots=True)
class Moving:
    """Marks that a slider moves over a plot.

    Attributes:
        names: of the slider's steps.
        dots: per mark, its place at each step, as shares of the plot's width and height.
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
class Plot:
    """A plot as wide as the page: a drawing as markup, or an address that holds one."""

    kind: ClassVar[str] = "plot"
    drawing: str
    about: str
    moving: Moving | None = None


@dataclass(frozen=True, slots=True)
class Layer:
    """What a picture shows: always, or with option `of` of the choice that it is part of.

    Attributes:
        image: an address that holds it, or a drawing as markup; empty for none.
        about: whose it is or what it shows.
        scale: of its colours.
        legend: (colour, meaning) pairs.
        note: a sentence below it.
    """

    image: str
    about: str = ""
    of: int | None = None
    scale: Scale | None = None
    legend: tuple[tuple[str, str], ...] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture with its heading; `behind` shows faintly through it, `scale` is of all layers."""

    title: str
    layers: tuple[Layer, ...]
    scale: Scale | None = None
    behind: str = ""


@dataclass(frozen=True, slots=True)
class Pictures:
    """Pictures side by side, in as many columns as there is room for."""

    kind: ClassVar[str] = "pictures"
    pictures: tuple[Picture, ...]
    columns: int = 2


@dataclass(frozen=True, slots=True)
class Film:
    """Pictures of which a slider shows those of one step: (name, pictures) pairs."""

    kind: ClassVar[str] = "film"
    steps: tuple[tuple[str, Pictures], ...]


@dataclass(frozen=True, slots=True)
class Viewer:
    """Pictures of one view with a common cursor and, of a known camera, a point cloud.

    `data` is what `window_json` makes of the view.
    """

    kind: ClassVar[str] = "viewer"
    pictures: Pictures
    data: Markup
    has_cloud: bool
    has_truth: bool


@dataclass(frozen=True, slots=True)
class Of:
    """Blocks that are shown with one option of the choice around them."""

    kind: ClassVar[str] = "of"
    option: int
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Choice:
    """Buttons that choose what the blocks below them show; `label` says what is chosen."""

    kind: ClassVar[str] = "choice"
    id: str
    label: str
    names: tuple[str, ...]
    blocks: tuple[Block, ...]


@dataclass(frozen=True, slots=True)
class Details:
    """Blocks that are folded away below a summary."""

    kind: ClassVar[str] = "details"
    summary: str
    blocks: tuple[Block, ...]
    is_open: bool = False


@dataclass(frozen=True, slots=True)
class Columns:
    """Blocks side by side."""

    kind: ClassVar[str] = "columns"
    columns: tuple[tuple[Block, ...], ...]


Block = (
    Text | Sentences | Facts | Grid | Plot | Pictures | Film | Viewer | Of | Choice | Details
    | Columns
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page; with a verdict, such as good, doubtful or wrong, a card of its colour."""

    id: str
    title: str
    blocks: tuple[Block, ...]
    verdict: str = ""


@dataclass(frozen=True, slots=True)
class Page:
    """A whole page: what it comes to, then sections, and last what it was made with.

    Attributes:
        blocks: before all sections.
        version: of eventsweep that made what is shown; by default that which runs.
        files: those beside it, which are linked.
        links: (title, address) of other pages.
    """

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    blocks: tuple[Block, ...] = ()
    version: str = field(default_factory=lambda: installed_versions()["eventsweep"])
    files: tuple[str, ...] = ()
    links: tuple[tuple[str, str], ...] = ()
    verdict: str = ""


def page_text(page: Page) -> str:
    """The page as HTML; names from files are escaped, and nothing is loaded from elsewhere."""
    blocks = [*page.blocks, *(block for section in page.sections for block in section.blocks)]
    most = max((len(block.names) for block in blocks if isinstance(block, Choice)), default=0)
    return _environment().get_template("page.html.j2").render(page=page, most=most)


def write_page(folder: Path, text: str) -> Path:
    """Writes `report.html` into the folder of an output, and returns its path."""
    with files_together(folder, (REPORT_NAME,)) as staged:
        (staged / REPORT_NAME).write_text(text, encoding="utf-8")
    return folder / REPORT_NAME


def tables(
    name: str, names: Sequence[str], grids: Sequence[Grid], label: str = "Metric"
) -> tuple[Block, ...]:
    """Tables of which one is shown at a time; a single one without a choice."""
    if len(grids) < 2:
        return tuple(grids)
    options = tuple(Of(k, (grid,)) for k, grid in enumerate(grids))
    return (Choice(name, label, tuple(names), options),)


def provenance(*blocks: Block) -> Section:
    """The last section of a page."""
    return Section("provenance", "Provenance", blocks)


def made_here(command: str = "") -> Section:
    """Provenance of what was made just now: the command, if one is known, and the versions."""
    named = grid(("command",), ((command or "Python",),))
    return provenance(named, versions_grid(["this page"], [installed_versions()]))


def versions_grid(names: Sequence[str], versions: Sequence[Mapping[str, str]]) -> Grid:
    """Versions side by side; a line where they differ stands out."""
    lines = []
    for library in sorted(set().union(*versions)):
        texts = [installed.get(library, "absent") for installed in versions]
        kind: Kind = "worse" if len(set(texts)) > 1 else ""
        lines.append((library, *(GridCell(text, kind=kind) for text in texts)))
    return grid(map(Head, ("version of", *names)), lines)


def grid(heads: Iterable[object], lines: Iterable[Iterable[object]], about: str = "") -> Grid:
    """A table; what is no heading or cell yet becomes one of text, or of a whole number."""
    headings = (h if isinstance(h, Head) else Head(str(h), text=True) for h in heads)
    return Grid(tuple(headings), tuple(tuple(map(_cell, line)) for line in lines), about)


def _cell(content: object) -> GridCell:
    if isinstance(content, int):
        return GridCell(f"{content:,}", content)
    return content if isinstance(content, GridCell) else GridCell(str(content))


def files_in(folder: Path, names: Iterable[str]) -> tuple[str, ...]:
    """Those of the names that are files in a folder: what a page beside them can link to."""
    return tuple(name for name in names if (folder / name).is_file())


def plural(count: int, noun: str) -> str:
    """A count and what is counted: 1 window, 2 windows."""
    return f"{count} {noun}{'s' * (count != 1)}"


@cache
def _environment() -> jinja2.Environment:
    """Templates that escape everything that is not marked as safe."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader(_PACKAGE, _FOLDER),
        autoescape=True,
        trim_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.globals["inline"] = _inline
    return environment


def _inline(name: str) -> Markup:
    """A style sheet or script beside the templates, as it stands."""
    file = resources.files(_PACKAGE).joinpath(_FOLDER, name)
    return Markup(file.read_text(encoding="utf-8"))
