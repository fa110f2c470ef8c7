"""What the mapping stage leaves for the scoring stage: one window's folder and its entry."""

from __future__ import annotations

from pathlib import Path

from emvs.output import StoredWindow, WindowInfo

_INFO = "window.json"


def write(out: Path, info: WindowInfo) -> None:
    """Writes the entry of the window whose folder lies in `out`."""
    (out / _INFO).write_text(info.model_dump_json(indent=1), encoding="utf-8")


def read(out: Path) -> StoredWindow:
    """Opens the window."""
    info = WindowInfo.model_validate_json((out / _INFO).read_text(encoding="utf-8"))
    return StoredWindow(out / info.name, info)
