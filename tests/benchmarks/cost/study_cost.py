"""The measurements of `docs/performance.md`: `python tests/benchmarks study_cost --help`.

Times on one thread are processor times, and the best of several rounds counts: on a machine that
others use too, everything else measures the neighbours.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
from collections.abc import Sequence
from pathlib import Path

from cost_growth import SERIES, Growth, Load, growth
from cost_limits import Figure, LimitsEffort, limits
from eventsweep.eval.cli.exit_codes import exit_code
from markdown_blocks import into_page


def limit_table(figures: Sequence[Figure]) -> str:
    """Markdown: every figure beside its limit."""
    lines = ["| What | measured | limit | met |", "|---|--:|--:|---|"]
    for one in figures:
        sign = {"lower": "≤", "higher": "≥"}[one.better]
        limit = "–" if one.limit is None else f"{sign} {one.limit:g} {one.unit}"
        held = {None: "–", True: "yes", False: "**no**"}[one.is_held]
        lines.append(f"| {one.what} | {_number(one.value)} {one.unit} | {limit} | {held} |")
    return "\n".join(lines) + "\n"


def growth_table(grown: Sequence[Growth]) -> str:
    """Markdown: every series with the exponent that fits it."""
    lines = ["| Grows | from … to | processor time, s | exponent | of the last two |",
             "|---|---|---|--:|--:|"]  # fmt: skip
    for one in grown:
        seconds = ", ".join(f"{value:.2f}" for value in one.seconds)
        amounts = f"{one.amounts[0]:,} … {one.amounts[-1]:,}".replace(",", " ")
        lines.append(
            f"| {one.quantity} | {amounts} | {seconds} | {one.exponent:.2f} "
            f"| {one.last_exponent:.2f} |"
        )
    return "\n".join(lines) + "\n"


def _number(value: float) -> str:
    return f"{value:.2f}" if value < 10 else f"{value:.0f}"


def main(arguments: list[str] | None = None) -> int:
    """Measures, prints the tables, writes page and picture as asked; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description="Measure what the mapper costs.")
    parser.add_argument("--only", choices=["limits", "growth"], help="measure this part only")
    parser.add_argument("--rounds", type=int, default=5, help="of so many rounds the best counts")
    parser.add_argument("--page", type=Path, help="page whose marked parts get the tables")
    parser.add_argument("--picture", type=Path, help="PNG of the growth")
    chosen = parser.parse_args(arguments)
    with exit_code() as code:
        texts: dict[str, str] = {}
        if chosen.only != "growth":
            about = machine()
            figures = limits(LimitsEffort(rounds=chosen.rounds))
            texts["limits"] = f"{about}\n\n{limit_table(figures)}"
        if chosen.only != "limits":
            grown = growth(Load(), SERIES, max(1, chosen.rounds // 2))
            texts["growth"] = growth_table(grown)
            if chosen.picture is not None:
                _draw(grown, chosen.picture)
        sys.stdout.write("\n".join(texts.values()))
        for name, text in texts.items() if chosen.page is not None else ():
            into_page(chosen.page, name, text)
    return code.value


def _draw(grown: list[Growth], path: Path) -> None:
    from cost_picture import draw

    draw(grown, Load(), path)


def machine() -> str:
    """The processors as Linux tells them, and how busy they are with other work."""
    text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    names = [line.partition(":")[2].strip() for line in text.splitlines() if "model name" in line]
    load = os.getloadavg()[0]
    what = f"{os.cpu_count()} × {names[0] if names else platform.machine()}"
    state = "quiet" if load < 0.5 else "busy with other work"
    return f"{what}; load average {load:.1f} before the measurement: {state}."


if __name__ == "__main__":
    sys.exit(main())
