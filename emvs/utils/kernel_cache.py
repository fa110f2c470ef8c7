"""Where compiled kernels are kept: a folder for each version of all the code they are made from.

Numba asks only whether a kernel's own file changed. A kernel holds the machine code of what it
calls in other files, too, and the values of their constants; after an edit there it would go on as
before. So the folder is named by a hash over every file with compiled functions.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

import llvmlite
import numba

from eventsweep.emvs.errors import InputError

_ROOT = Path(__file__).parents[2]
_PACKAGES = ("emvs", "sim", "eval")
_CUDA = _ROOT / "emvs" / "dsi" / "cuda"
_OURS = re.compile(r"eventsweep-[0-9a-f]{16}|\.eventsweep-[0-9a-f]{16}\.[0-9]+\.old")
_MARK = "last-used"
_KEEP = 8  # a version takes 10 MB
_BUSY_S, _OLD_S = 86_400, 30 * 86_400


def use_kernel_cache() -> Path:
    """Tells numba where kernels lie; to be called before the first of them is decorated.

    It is a folder below `NUMBA_CACHE_DIR`, or the user's cache folder, or, where that cannot be
    written to, one of the user's own among the temporary files.

    Raises:
        InputError: none of them can be written to.
    """
    name = f"eventsweep-{kernel_version()}"
    chosen = Path(numba.config.CACHE_DIR) if numba.config.CACHE_DIR else None  # type: ignore[attr-defined]
    for home in _homes(chosen):
        folder = home / name
        is_new = not folder.exists()
        if _claim(folder, trusted=home == chosen):
            numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
            if is_new:
                _remove_old(home, folder)
            return folder
    raise InputError(
        "compiled kernels: no folder can be written to; set NUMBA_CACHE_DIR to one that can"
    )


def kernel_version() -> str:
    """16 hexadecimal digits over the files of compiled functions and over who compiles them."""
    parts = [platform.python_implementation(), platform.python_version()]
    parts += [numba.__version__, llvmlite.__version__]
    parts += digests(kernel_files(), _ROOT)
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:16]


def digests(paths: Iterable[Path], root: Path) -> list[str]:
    """One line for each file, sorted: its path below `root`, and the sha256 of its bytes."""
    return sorted(
        f"{path.relative_to(root).as_posix()} {hashlib.sha256(path.read_bytes()).hexdigest()}"
        for path in paths
    )


def kernel_files() -> list[Path]:
    """Every file with compiled functions, or with what they take from elsewhere."""
    found = []
    for package in _PACKAGES:
        for folder, inner, names in os.walk(_ROOT / package):
            inner[:] = [name for name in inner if name.isidentifier() and name != "__pycache__"]
            whole = Path(folder) == _CUDA
            found += [
                Path(folder, name)
                for name in names
                if name.endswith("_kernels.py") or (whole and name.endswith(".py"))
            ]
    return sorted(found)


def _homes(chosen: Path | None) -> Iterator[Path]:
    if chosen is not None:
        yield chosen
    with suppress(RuntimeError):  # nobody's home
        xdg = os.environ.get("XDG_CACHE_HOME")
        yield (Path(xdg) if xdg else Path.home() / ".cache") / "eventsweep-kernels"
    with suppress(OSError):  # no temporary files either
        yield Path(tempfile.gettempdir()) / f"eventsweep-kernels-{os.getuid()}"


def _claim(folder: Path, *, trusted: bool) -> bool:
    """Makes the folder and says that it is in use; False where that does not work.

    Compiled code is run as it is found: from a folder that nobody else could have filled, unless
    the user chose it.
    """
    try:
        for each in (folder.parent, folder):
            each.mkdir(mode=0o700, parents=True, exist_ok=True)
            if not trusted and not _is_private(each):
                return False
        (folder / _MARK).touch()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return True


def _is_private(folder: Path) -> bool:
    seen = folder.lstat()
    return seen.st_uid == os.getuid() and not folder.is_symlink() and not seen.st_mode & 0o022


def _remove_old(home: Path, present: Path) -> None:
    """Removes versions that nobody has used for a month, and of the others all but a few.

    What was used within a day stays: a process may be writing there.
    """
    ages = sorted((age, path) for path, age in _versions(home) if path != present)
    for place, (age_s, path) in enumerate(ages, start=1):
        if age_s > _OLD_S or (place >= _KEEP and age_s > _BUSY_S):
            _remove(path)


def _versions(home: Path) -> Iterator[tuple[Path, float]]:
    """Folders of versions, and the leavings of a removal that was killed; seconds since use."""
    now = time.time()
    for path in home.iterdir():
        if _OURS.fullmatch(path.name) and path.is_dir() and not path.is_symlink():
            is_leaving = path.name.startswith(".")
            with suppress(OSError):  # not marked: not ours, or being removed by someone else
                mark = path if is_leaving else path / _MARK
                yield path, now - mark.stat().st_mtime


def _remove(path: Path) -> None:
    away = path.with_name(f".{path.name.lstrip('.').split('.')[0]}.{os.getpid()}.old")
    with suppress(OSError):
        path.rename(away)  # at once, so that nobody finds half a version
        shutil.rmtree(away, ignore_errors=True)
