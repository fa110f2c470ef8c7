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
from eventsweep.plugins.paper.verb import PAGE
from markdown_blocks import into_page

MARK = "paper"


def main() -> int:
    """Writes the page's part; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="what `eventsweep paper --out` wrote")
    parser.add_argument("page", type=Path, help="docs/paper.md")
    asked = parser.parse_args()
    with exit_code() as code:
        write(asked.folder, asked.page)
    return code.value


def write(folder: Path, page: Path) -> None:
    """Writes the text into the page and the figures beside it.

    Raises:
        InputError: no such folder, or a page without the marks.
    """
    if not (folder / PAGE).is_file():
        raise InputError(f"{folder}: no {PAGE}; `eventsweep paper --out {folder}` writes it")
    text = (folder / PAGE).read_text("utf-8").replace(f"]({PICTURES_FOLDER}/", "](images/")
    into_page(page, MARK, text)
    for picture in sorted((folder / PICTURES_FOLDER).glob("*.webp")):
        shutil.copyfile(picture, page.parent / "images" / picture.name)


if __name__ == "__main__":
    raise SystemExit(main())
