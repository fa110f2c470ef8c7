"""What the files of a folder hold."""

from pathlib import Path


def all_bytes(folder: Path) -> dict[str, bytes]:
    """The content of every file below a folder, by its path in it."""
    files = (path for path in sorted(folder.rglob("*")) if path.is_file())
    return {str(path.relative_to(folder)): path.read_bytes() for path in files}
