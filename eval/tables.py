"""Tables as files: CSV for programs, LaTeX with booktabs for papers, Markdown for pages."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass
from pathlib import Path

from emvs.utils.files import atomic_path
from eval.ranking import RankingTable
from eval.scoring.results import is_undefined

FORMATS = ("csv", "tex", "md")
_TEX = {
    "\\": r"\textbackslash{}", "&": r"\&", "%": r"\%", "$": r"\$", "#": r"\#", "_": r"\_",
    "{": r"\{", "}": r"\}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}",
    "<": r"$<$", ">": r"$>$", "|": r"$|$", "\u202f": r"\,", "–": "--", "−": "$-$",
    "δ": r"$\delta$", "×": r"$\times$", "↓": r"$\downarrow$", "↑": r"$\uparrow$", "Δ": r"$\Delta$",
    "·": r"$\cdot$", "±": r"$\pm$",
}  # fmt: skip
_ARROWS = {"lower": "↓", "higher": "↑"}


@dataclass(frozen=True, slots=True)
class TextCell:
    """A cell: as read, as a program wants it, and whether it stands out."""

    text: str
    value: float | str
    bold: bool = False


@dataclass(frozen=True, slots=True)
class TextTable:
    """A table that is only text: its first column names, the others are numbers.

    Attributes:
        caption: what it shows, in a sentence.
        columns: headings, with units.
        lines: as many cells as headings each.
    """

    caption: str
    columns: tuple[str, ...]
    lines: tuple[tuple[TextCell, ...], ...]


def ranking_table(ranking: RankingTable, caption: str) -> TextTable:
    """A ranking as text: units and directions in the headings, the best bold."""
    heads = ("method", *(_heading(c.title, c.unit, c.better) for c in ranking.columns))
    lines = []
    for line in ranking.lines:
        cells = (
            TextCell(cell.text, in_unit(cell.value, head.unit), cell.best)
            for cell, head in zip(line.cells, ranking.columns, strict=True)
        )
        lines.append((TextCell(line.method, line.method), *cells))
    return TextTable(caption, heads, tuple(lines))


def in_unit(value: float, unit: str) -> float:
    """A stored value in the unit that tables show it in: metres become centimetres."""
    return float(f"{100 * value:.9g}") if unit == "cm" else value


def _heading(title: str, unit: str, better: str) -> str:
    return " ".join(part for part in (title, f"[{unit}]", _ARROWS.get(better, "")) if part)


def write_tables(folder: Path, tables: dict[str, TextTable]) -> list[Path]:
    """Writes NAME.csv, NAME.tex and NAME.md of each table, and returns their paths."""
    writers = {"csv": as_csv, "tex": as_latex, "md": as_markdown}
    paths = []
    for name, one in tables.items():
        for suffix in FORMATS:
            path = folder / f"{file_name(name)}.{suffix}"
            with atomic_path(path) as partial:
                partial.write_text(writers[suffix](one), encoding="utf-8")
            paths.append(path)
    return paths


def file_name(name: str) -> str:
    """A name as a file's: letters, digits, dots and dashes, never hidden and never a folder."""
    return re.sub(r"[^\w.-]+", "-", name).lstrip(".-") or "table"


def as_csv(table: TextTable) -> str:
    """Nine digits or more, in the unit of the heading; undefined numbers are empty."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table.columns)
    for line in table.lines:
        writer.writerow("" if is_undefined(cell.value) else cell.value for cell in line)
    return stream.getvalue()


def as_markdown(table: TextTable) -> str:
    """A table as GitHub and most other renderers read it."""
    rule = ["---", *("--:" for _ in table.columns[1:])]
    lines = [[_md_cell(cell) for cell in line] for line in table.lines]
    rows = [[_md(text) for text in table.columns], rule, *lines]
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def as_latex(table: TextTable) -> str:
    """A `table` environment that needs the package booktabs and nothing else."""
    body = [" & ".join(_tex_cell(cell) for cell in line) + r" \\" for line in table.lines]
    parts = [
        r"\begin{table}", r"\centering", rf"\caption{{{_tex(table.caption)}}}",
        rf"\begin{{tabular}}{{l{'r' * (len(table.columns) - 1)}}}", r"\toprule",
        " & ".join(_tex(text) for text in table.columns) + r" \\", r"\midrule",
        *body, r"\bottomrule", r"\end{tabular}", r"\end{table}",
    ]  # fmt: skip
    return "\n".join(parts) + "\n"


def _md_cell(cell: TextCell) -> str:
    return f"**{_md(cell.text)}**" if cell.bold else _md(cell.text)


def _md(text: str) -> str:
    flat = " ".join(text.split("\n"))
    escaped = re.sub(r"([\\`*_|\[\]])", r"\\\1", flat)
    return escaped.replace("<", "&lt;")


def _tex_cell(cell: TextCell) -> str:
    return rf"\textbf{{{_tex(cell.text)}}}" if cell.bold else _tex(cell.text)


def _tex(text: str) -> str:
    return "".join(_TEX.get(letter, letter) for letter in " ".join(text.split("\n")))
