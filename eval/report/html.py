"""Pages as text: tables, and what the page's cursor and point clouds read."""

from __future__ import annotations

import base64
import json
import math
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any, Literal

import jinja2
import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from eval.figures.colormaps import BLANK, Scale
from eval.report.run_data import MethodView, WindowView

Kind = Literal["", "better", "worse", "other", "best"]
MOST_POINTS = 30_000
"""Points of one cloud that the page draws; more are thinned out evenly."""
_LARGEST_HALF = 65_504.0


@dataclass(frozen=True, slots=True)
class Head:
    """A column's heading; `better` says which end sorts to the top first, `text` that it is text.

    With `arrow`, the heading shows which direction is better, too.
    """

    title: str
    unit: str = ""
    better: str = "lower"
    text: bool = False
    arrow: bool = False


@dataclass(frozen=True, slots=True)
class GridCell:
    """One cell: as read, as sorted, and how it stands out."""

    text: str
    value: float = math.nan
    kind: Kind = ""
    colour: str = ""


@dataclass(frozen=True, slots=True)
class Grid:
    """A sortable table, and above it what its numbers are."""

    heads: tuple[Head, ...]
    lines: tuple[tuple[GridCell, ...], ...]
    about: str = ""


@dataclass(frozen=True, slots=True)
class Section:
    """A part of a page: one table per metric, of which one is shown at a time.

    Attributes:
        id: unique in the page.
        title: heading.
        names: of the tables, on the buttons.
        tables: as many as names.
        text: below the heading.
        figure: a picture, as an address that holds it.
        failures: (what, why) pairs.
        choice: what the buttons choose.
        chosen: which table is shown first.
    """

    id: str
    title: str
    names: tuple[str, ...]
    tables: tuple[Grid, ...]
    text: str = ""
    figure: str = ""
    failures: tuple[tuple[str, str], ...] = ()
    choice: str = "Metric"
    chosen: int = 0


@dataclass(frozen=True, slots=True)
class Page:
    """A whole page."""

    title: str
    subtitle: str
    sections: tuple[Section, ...]
    provenance: Grid
    overview: Grid | None = None
    findings: tuple[str, ...] = ()
    note: str = ""
    version: str = ""


def page_text(page: Page) -> str:
    """The page as HTML; names from files are escaped, and nothing is loaded from elsewhere."""
    return environment().get_template("tables.html.j2").render(
        title=page.title, subtitle=page.subtitle, sections=page.sections, note=page.note,
        provenance=page.provenance, overview=page.overview, findings=page.findings,
        version=page.version, most=max((len(s.names) for s in page.sections), default=0),
        css=inline("report.css"), tables_css=inline("tables.css"), js=inline("report.js"),
    )  # fmt: skip


def versions_grid(names: Sequence[str], versions: Sequence[Mapping[str, str]]) -> Grid:
    """Versions side by side; a line where they differ stands out."""
    libraries = sorted({name for one in versions for name in one})
    lines = []
    for library in libraries:
        found = [one.get(library, "absent") for one in versions]
        kind: Kind = "worse" if len(set(found)) > 1 else ""
        lines.append((GridCell(library), *(GridCell(text, kind=kind) for text in found)))
    return Grid((Head("version of"), *(Head(name) for name in names)), tuple(lines))


def plural(count: int, noun: str) -> str:
    """A count and what is counted: 1 window, 2 windows."""
    return f"{count} {noun}{'s' * (count != 1)}"


@cache
def environment() -> jinja2.Environment:
    """Templates that escape everything that is not marked as safe."""
    return jinja2.Environment(
        loader=jinja2.PackageLoader("eval.report", "templates"),
        autoescape=True,
        trim_blocks=True,
        undefined=jinja2.StrictUndefined,
    )


def inline(name: str) -> Markup:
    """A file beside the templates, as it stands."""
    text = resources.files("eval.report").joinpath("templates", name).read_text(encoding="utf-8")
    return Markup(text)


def packed(values: NDArray[np.generic]) -> str:
    """The bytes of an array, compressed, as text that is safe in a page."""
    return base64.b64encode(zlib.compress(values.tobytes(), 9)).decode("ascii")


def half(values: NDArray[np.floating]) -> NDArray[np.float16]:
    """Half precision, little-endian: 0.05 % of the value, finer than any error that is shown."""
    found: NDArray[np.float16] = np.clip(values, -_LARGEST_HALF, _LARGEST_HALF).astype("<f2")
    return found


def window_data(window: WindowView, methods: Sequence[str], error: Scale, depth: Scale) -> Markup:
    """A window as JSON for the page's script; numbers and base64 only, so nothing to escape.

    Depth in m, confidence in the method's own unit, each at the pixels of the method's mask in
    reading order; true depth in m, 0 where it is unknown; intrinsics in px.

    Args:
        window: the window.
        methods: of the case, in the order of its buttons.
        error: colours of an error, cm.
        depth: colours of a depth.
    """
    height_px, width_px = window.methods[0].depth_m.shape
    camera = window.camera
    data: dict[str, Any] = {
        "w": width_px,
        "h": height_px,
        "range_m": window.depth_range_m,
        "most": MOST_POINTS,
        "cap_cm": error.high,
        "depth_colours": _colours(depth),
        "error_colours": _colours(error),
        "methods": [_method(method, methods.index(method.name)) for method in window.methods],
    }
    if camera is not None:
        data["camera"] = [camera.fx_px, camera.fy_px, camera.cx_px, camera.cy_px]
    if window.frame is not None and window.frame.shape == (height_px, width_px):
        data["frame"] = packed(window.frame)
    if window.truth is not None:
        known = np.where(window.truth.scored, window.truth.depth_m, 0.0)
        data["truth"] = packed(half(known))
    return Markup(json.dumps(data, separators=(",", ":")))


def _colours(scale: Scale) -> list[str]:
    rows = np.linspace(0, BLANK - 1, 64).round().astype(int)
    return ["#{:02x}{:02x}{:02x}".format(*scale.palette[row, :3]) for row in rows]


def _method(method: MethodView, position: int) -> dict[str, Any]:
    return {
        "position": position,
        "mask": packed(np.packbits(method.mask.ravel(), bitorder="little")),
        "depth": packed(half(method.depth_m[method.mask])),
        "votes": packed(half(np.nan_to_num(method.confidence[method.mask]))),
    }
