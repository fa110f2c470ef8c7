"""Draws docs/images/architecture.png: the parts of the product and who imports whom.

Run: python docs/figures/draw_layers.py [ROOT] [--out PICTURE]

Everything comes from the imports in the code. A box is a subpackage, with the number of its
modules, `__init__` included; a module directly in `emvs`, `sim` or `eval` is a box by itself, its
kernels with it, unless there are too many of them; the scenes share a box. A box stands one row
above the highest one that it imports, so that every arrow points down; an arrow that follows from
others is left out. Boxes that import each other in a circle, which the architecture forbids, are
drawn as one.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch
from matplotlib.path import Path as Curve

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "tests" / "benchmarks" / "checkout"))

from import_graph import (
    Graph,
    components,
    floors,
    import_graph,
    reachable,
    read_modules,
    subpackage,
)

PICTURE = ROOT / "docs" / "images" / "architecture.png"
COLOURS = {
    "emvs": "#0072b2",
    "sim": "#009e73",
    "scenes": "#b8860b",
    "eval": "#cc4c02",
    "eventsweep": "#7a5195",
    "plugins": "#666666",
}
LANES = {
    "emvs": -0.5,
    "sim": 0.35,
    "scenes": 0.45,
    "eval": 0.75,
    "eventsweep": 0.75,
    "plugins": 0.0,
}
KERNELS = "_kernels"
MANY = 16  # more modules than this directly in a package share a box
WIDTH_IN, DPI = 18.0, 100
LETTER_IN, LINE_IN, ROW_GAP_IN, BOX_GAP_IN, BEND_GAP_IN = 0.083, 0.17, 0.34, 0.13, 0.11
ROUNDS = 300

Point = tuple[str, str, int] | str  # a box, or where the arrow between two boxes passes a row


def boxes(names: Iterable[str]) -> dict[str, str]:
    """Module name -> the box that it belongs to; a package's own `__init__` belongs to none."""
    names = sorted(names)
    folders = {name.rpartition(".")[0] for name in names}
    single = Counter(name.split(".")[0] for name in names if _is_single(name, folders))
    found = {}
    for name in names:
        package = name.split(".")[0]
        crowded = _is_single(name, folders) and single[package] > MANY
        whole = package in ("scenes", "eventsweep") or crowded
        if whole or "." in name:
            found[name] = package if whole else subpackage(name.removesuffix(KERNELS))
    return found


def _is_single(name: str, folders: set[str]) -> bool:
    """Whether a module lies directly in a top-level package and is no folder itself."""
    return name.count(".") == 1 and name not in folders


def layers(graph: Graph) -> tuple[Graph, dict[str, int]]:
    """The graph of boxes without circles and without arrows that follow from others; box sizes."""
    home = boxes(graph)
    joined: Graph = {box: set() for box in home.values()}
    for name, targets in graph.items():
        if name in home:
            joined[home[name]] |= {home[one] for one in targets if one in home} - {home[name]}
    label = {box: "\n".join(members) for members in components(joined) for box in members}
    merged: Graph = {name: set() for name in label.values()}
    for box, targets in joined.items():
        merged[label[box]] |= {label[one] for one in targets} - {label[box]}
    counted = [box for name, box in home.items() if name != box + KERNELS]
    return reduced(merged), Counter(label[box] for box in counted)


def reduced(graph: Graph) -> Graph:
    """A graph without circles, less every arrow that a longer way replaces."""
    below = {name: reachable(graph, name) - {name} for name in graph}
    return {
        name: {one for one in targets if not any(one in below[other] for other in targets)}
        for name, targets in graph.items()
    }


def placed(graph: Graph, row: Mapping[str, int], widths: Mapping[str, float]) -> dict[Point, float]:
    """Where every box and every bend of an arrow lies from left to right, inches.

    Each point goes where its neighbours are and, if it is a box, towards its package's lane;
    points of one row keep their distance. Repeated until nothing moves much.
    """
    links, rows = _links(graph, row)
    x = {point: _lane(point) + 0.01 * k for line in rows for k, point in enumerate(line)}
    for k in range(ROUNDS):
        for line in rows if k % 2 else rows[::-1]:
            wanted = {point: _wanted(point, links[point], x) for point in line}
            if k < ROUNDS // 2:
                line.sort(key=wanted.__getitem__)
            x.update(zip(line, _spread(line, wanted, widths), strict=True))
    return x


def _links(
    graph: Graph, row: Mapping[str, int]
) -> tuple[dict[Point, list[Point]], list[list[Point]]]:
    """Neighbours of every point, and the points of each row."""
    rows: list[list[Point]] = [[] for _ in range(max(row.values()))]
    for name in sorted(graph):
        rows[row[name] - 1].append(name)
    links: dict[Point, list[Point]] = {name: [] for name in graph}
    for name, target in _arrows(graph):
        way = course(name, target, row)
        for bend in way[1:-1]:
            rows[int(bend[2]) - 1].append(bend)
        for one, other in pairwise(way):
            links.setdefault(one, []).append(other)
            links.setdefault(other, []).append(one)
    return links, rows


def _arrows(graph: Graph) -> list[tuple[str, str]]:
    return [(name, target) for name in sorted(graph) for target in sorted(graph[name])]


def course(name: str, target: str, row: Mapping[str, int]) -> list[Point]:
    """The points through which an arrow goes, from the top down."""
    return [name, *((name, target, k) for k in range(row[name] - 1, row[target], -1)), target]


def _lane(point: Point) -> float:
    ends = [point] if isinstance(point, str) else point[:2]
    return WIDTH_IN / 2 * sum(LANES[one.split(".")[0].split("\n")[0]] for one in ends) / len(ends)


def _wanted(point: Point, links: Sequence[Point], x: Mapping[Point, float]) -> float:
    near = float(np.mean([x[one] for one in links])) if links else _lane(point)
    return 0.5 * near + 0.5 * _lane(point) if isinstance(point, str) else near


def _spread(
    line: Sequence[Point], wanted: Mapping[Point, float], widths: Mapping[str, float]
) -> list[float]:
    """Places as near to the wanted ones as the widths allow, in order and within the picture."""
    half = [widths[one] / 2 if isinstance(one, str) else 0.0 for one in line]
    gaps = [a + b + (BOX_GAP_IN if a or b else BEND_GAP_IN) for a, b in pairwise(half)]
    apart = np.cumsum([0.0, *gaps])[: len(line)]
    blocks: list[list[float]] = []  # means and sizes: pool what would overlap
    for point, offset in zip(line, apart, strict=True):
        blocks.append([wanted[point] - offset, 1.0])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (m, n), (p, q) = blocks[-2:]
            blocks[-2:] = [[(m * n + p * q) / (n + q), n + q]]
    even = np.repeat([mean for mean, _ in blocks], [int(size) for _, size in blocks])
    edge = WIDTH_IN / 2 - 0.1
    low, high = half[0] - edge if half else 0.0, edge - (apart[-1] + half[-1]) if half else 0.0
    return list(apart + np.clip(even, min(low, high), max(low, high)))


def draw(graph: Graph, sizes: Mapping[str, int], out: Path) -> None:
    """Draws the boxes and arrows into a picture."""
    row = floors(graph)
    x = placed(graph, row, {name: _width(name) for name in graph})
    spans = row_spans(row)
    height_in = spans[-1][1] + ROW_GAP_IN
    figure = plt.figure(figsize=(WIDTH_IN, height_in), dpi=DPI)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(-WIDTH_IN / 2, WIDTH_IN / 2), ylim=(0, height_in))
    axes.axis("off")
    for name, target in _arrows(graph):
        way = [(x[one], *spans[_row(one, row)]) for one in course(name, target, row)]
        _draw_arrow(axes, way, name)
    for name in graph:
        _draw_box(axes, name, sizes[name], x[name], spans[row[name] - 1])
    _draw_legend(axes, graph, height_in)
    figure.savefig(out)
    plt.close(figure)


def row_spans(row: Mapping[str, int]) -> list[tuple[float, float]]:
    """Lower and upper edge of the boxes of every row, from the lowest up, inches."""
    spans: list[tuple[float, float]] = []
    for k in range(1, max(row.values()) + 1):
        lines = max(_title(name).count("\n") + 2 for name in row if row[name] == k)
        low = spans[-1][1] + ROW_GAP_IN if spans else 0.1
        spans.append((low, low + LINE_IN * lines + 0.16))
    return spans


def _row(point: Point, row: Mapping[str, int]) -> int:
    return (row[point] if isinstance(point, str) else point[2]) - 1


def _width(name: str) -> float:
    return 0.25 + LETTER_IN * max(len(line) for line in [*_title(name).split("\n"), "99 modules"])


def _title(name: str) -> str:
    """What a box is called; of a circle, the first members and how many more."""
    members = name.split("\n")
    rest = f"\n… {len(members) - 3} more" if len(members) > 4 else ""
    return "\n".join(members[:3] if rest else members) + rest


def _colour(name: str) -> str:
    return COLOURS[name.split("\n")[0].split(".")[0]]


def _draw_box(axes: Axes, name: str, size: int, x: float, span: tuple[float, float]) -> None:
    low, high = span
    folder, colour, width = size > 1, _colour(name), _width(name)
    box = FancyBboxPatch(
        (x - width / 2, low), width, high - low, boxstyle="round,pad=0,rounding_size=0.06",
        facecolor=colour if folder else "white", edgecolor=colour, lw=1.3, zorder=3,
    )  # fmt: skip
    axes.add_patch(box)
    text = _title(name) + (f"\n{size} modules" if folder else "")
    ink = "white" if folder else colour
    middle = (low + high) / 2
    axes.text(x, middle, text, ha="center", va="center", color=ink, fontsize=10, zorder=4)


def _draw_arrow(axes: Axes, way: Sequence[tuple[float, float, float]], name: str) -> None:
    """A line that bends between two rows and goes straight down past the boxes of a row.

    Args:
        axes: where to draw.
        way: x, lower and upper edge of the row, for both boxes and every row between them.
        name: the box where the arrow begins, which gives the colour.
    """
    vertices, codes = [(way[0][0], way[0][1])], [Curve.MOVETO]
    for (xa, low, _), (xb, below, high) in pairwise(way):
        middle = (low + high) / 2
        vertices += [(xa, middle), (xb, middle), (xb, high)]
        codes += [Curve.CURVE4] * 3
        if (xb, below, high) != way[-1]:
            vertices.append((xb, below))
            codes.append(Curve.LINETO)
    arrow = FancyArrowPatch(
        path=Curve(vertices, codes), arrowstyle="-|>,head_width=2.5,head_length=5",
        color=_colour(name), alpha=0.75, lw=1.1, zorder=2,
    )  # fmt: skip
    axes.add_patch(arrow)


def _draw_legend(axes: Axes, graph: Graph, height_in: float) -> None:
    present = {_colour(name) for name in graph}
    lines = [(one, colour) for one, colour in COLOURS.items() if colour in present]
    lines += [("filled: a folder; outlined: one module", "#555"), ("A → B: A imports B", "#555")]
    for k, (text, colour) in enumerate(lines):
        place = -WIDTH_IN / 2 + 0.2, height_in - 0.35 - 0.22 * k
        axes.text(*place, text, color=colour, fontsize=10.5, weight="bold")


def main() -> None:
    """Draws the checkout named on the command line; by default the one this file is in."""
    parser = argparse.ArgumentParser(description="Draws the layers of the product.")
    parser.add_argument("root", type=Path, nargs="?", default=ROOT)
    parser.add_argument("--out", type=Path, default=PICTURE)
    asked = parser.parse_args()
    draw(*layers(import_graph(read_modules(asked.root))), asked.out)


if __name__ == "__main__":
    main()
