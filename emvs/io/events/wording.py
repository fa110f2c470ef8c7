"""Foreign words in errors: printable, on one line, of bounded length."""

from __future__ import annotations


def said(error: BaseException, most: int = 200) -> str:
    """What a library says of damage, in one line of bounded length; it may quote the file."""
    line = (" ".join(str(error).split()) or type(error).__name__)[:most]
    return line if line.isprintable() else ascii(line)


def quoted(*words: object) -> str:
    """Words of a file as an error may show them: printable, the first few, of bounded length."""
    shown = [word if len(word) < 48 else f"{word[:40]}..." for word in map(str, words[:8])]
    more = [f"and {len(words) - 8} more"] if len(words) > 8 else []
    return ", ".join([word if word.isprintable() else ascii(word) for word in shown] + more)
