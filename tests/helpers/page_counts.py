"""What pages count, as numbers."""

from __future__ import annotations

import re
from pathlib import Path

WORDS = [
    "zero", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten",
    "eleven", "twelve", "thirteen", "fourteen", "fifteen", "sixteen", "seventeen", "eighteen",
    "nineteen", "twenty",
]  # fmt: skip


def numbers_in(page: Path, pattern: str) -> list[int]:
    """The numbers, in digits or words, that the groups of a pattern find on a page."""
    found = re.search(pattern, page.read_text("utf-8"), re.MULTILINE | re.DOTALL)
    assert found, f"{page.name} counts it no more: drop the test"
    return [int(word) if word.isdecimal() else WORDS.index(word.lower()) for word in found.groups()]
