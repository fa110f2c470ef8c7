"""The short form of the public ranking in its page, from its committed data: nobody types a number.

`python tests/benchmarks ranking_table` writes it; with `--check` it only says whether it is stale.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.report.html import Grid, plural
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import DATA_NAME, read_data
from eventsweep.plugins.ranking.pages.sections import RankingPage, data, overview
from eventsweep.plugins.ranking.tracks import SEMI_DENSE
from markdown_blocks import refresh
from table_code import Code, of_suite

DATA = Path("docs/standings")
MARK = "ranking"
_LEFT_OUT = ("mean place", "error, hidden part", "note")


def ranking_block(folder: Path) -> str:
    """The table of semi-dense depth and the sentence below it, as Markdown.

    Args:
        folder: with the ranking's data.

    Raises:
        InputError: there is none, or damaged data.
    """
    entries = tuple(one for one in read_data(folder).entries if one.track == SEMI_DENSE)
    public, hidden = summary.parts(entries)
    page = RankingPage(entries, summary.ranked(public), hidden and summary.ranked(hidden), {})
    return f"{_markdown(overview(page))}\n{_sentence(page)}"


def _markdown(grid: Grid) -> str:
    kept = [k for k, head in enumerate(grid.heads) if head.title not in _LEFT_OUT]
    heads = [f"{h.title} \\[{h.unit}\\]" if h.unit else h.title for h in grid.heads]
    lines = [heads, ["---", *["--:"] * (len(heads) - 1)]]
    lines += [[f"**{c.text}**" if c.kind == "best" else c.text for c in row] for row in grid.lines]
    return "\n".join(f"| {' | '.join(line[k] for k in kept)} |" for line in lines) + "\n"


def _sentence(page: RankingPage) -> str:
    base, joined = page.joined.base, page.joined
    unseen = f"; {plural(len(page.hidden.joined.base.seeds), 'hidden seed')}" if page.hidden else ""
    return (
        f"`{base.suite}`, {plural(len(joined.cases), 'case')}, {plural(len(base.seeds), 'seed')}, "
        f"{data(base)}{unseen}; eventsweep {base.versions.get('eventsweep', '?')}. Equal ranks are "
        "ties over seeds; errors and coverage are means over cases.\n"
    )


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "plugins/ranking/ranking.md#ranking": of_suite("suite-v3")
        + Code(data=(DATA / DATA_NAME).as_posix())
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Writes or checks the table; 1 where a check finds it stale, 2 on bad input."""
    parser = argparse.ArgumentParser(
        prog="python tests/benchmarks ranking_table", description=__doc__
    )
    parser.add_argument("page", type=Path, nargs="?", default=Path("plugins/ranking/ranking.md"))
    parser.add_argument("--data", type=Path, default=DATA)
    parser.add_argument("--check", action="store_true", help="write nothing")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        command = "python tests/benchmarks ranking_table"
        block = ranking_block(asked.data)
        ended.value = refresh(asked.page, MARK, block, code, check=asked.check, command=command)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
