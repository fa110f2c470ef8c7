"""What the paper's page measures: `python tests/benchmarks paper_page FOLDER PAGE`.

FOLDER is what `eventsweep paper --out` wrote. Its text goes between the page's marks, its figures
into the page's `images`.
"""

from __future__ import annotations

import argparse
import shutil
from pathlib import Path

from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.results.results import PICTURES_FOLDER
from eventsweep.eval.suite.definition import load
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.plugins.paper.verb import PAGE, SUITE
from markdown_blocks import into_page
from table_code import Code, of_jobs

MARK = "paper"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    suite, _ = load(str(SUITE))
    page = Code(modules=("eventsweep.plugins.paper.page",), files=("plugins/paper/paper-v1.toml",))
    return {f"docs/paper.md#{MARK}": page + of_jobs(suite_jobs(suite, tuple(suite.cases), (0,)))}


def main() -> int:
    """Writes the page's part; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what `eventsweep paper --out` wrote")
    parser.add_argument("page", type=Path, help="docs/paper.md")
    asked = parser.parse_args()
    with exit_code() as ended:
        write(asked.folder, asked.page)
    return ended.value


def write(folder: Path, page: Path) -> None:
    """Writes the text into the page and the figures beside it.

    Raises:
        InputError: no such folder, or a page without the marks.
    """
    if not (folder / PAGE).is_file():
        raise InputError(f"{folder}: no {PAGE}; `eventsweep paper --out {folder}` writes it")
    text = (folder / PAGE).read_text("utf-8").replace(f"]({PICTURES_FOLDER}/", "](images/")
    into_page(page, MARK, text, code)
    for picture in sorted((folder / PICTURES_FOLDER).glob("*.webp")):
        shutil.copyfile(picture, page.parent / "images" / picture.name)


if __name__ == "__main__":
    raise SystemExit(main())
