"""Drawn textures, kept for the next run and the next process.

Drawing a scene's textures takes longer than anything else before the first picture. They depend on
nothing but this package and the libraries that it draws with, so they are kept under a hash of
both: after an edit of any file here, or an update, they are drawn anew. A kept texture is read only
where its hash agrees; where nothing can be kept, textures are drawn as if there were no cache.
"""

from __future__ import annotations

import platform
from collections.abc import Callable, Mapping
from functools import cache, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any
from zipfile import BadZipFile

import numpy as np

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, CacheEntry, default_cache, key_of
from eventsweep.emvs.utils.kernel_cache import digests
from eventsweep.emvs.utils.runtime import versions

if TYPE_CHECKING:
    from eventsweep.scenes.textures.noise import Image

_PACKAGE = Path(__file__).parents[1]
_FILE = "textures.npz"
# The textures of all scenes take 0.3 GB.
_KEEP_BYTES = 1_000_000_000
Draw = Callable[[], Mapping[str, "Image"]]


def kept(draw: Draw) -> Draw:
    """Makes a function of this package that draws textures keep what it drew.

    Args:
        draw: at the top of a module; its result must depend on this package's code alone.

    Returns:
        A function that returns the same bytes, from `textures` in the cache's folder (see
        `emvs.utils.cache.default_cache`) where they are there. Two processes that want them at
        once draw them once; a folder that is damaged, full, read-only or gone only costs time.
    """

    @wraps(draw)
    def textures() -> Mapping[str, Image]:
        drawn: dict[str, Image] = {}

        def fill(folder: Path) -> None:
            drawn.update(draw())
            # One file, for of several some could be deleted before the entry lists them.
            np.savez(folder / _FILE, **drawn)  # type: ignore[arg-type]  # of names, not options

        try:
            entry = _entry({"of": f"{draw.__module__}.{draw.__qualname__}", **_makers()}, fill)
            return drawn or _loaded(entry.path / _FILE)
        except (OSError, ValueError, InputError, BadZipFile):
            return drawn or draw()

    return textures


def _loaded(path: Path) -> Mapping[str, Image]:
    with np.load(path) as stored:
        return dict(stored)


def _entry(facts: Any, fill: Callable[[Path], None]) -> CacheEntry:
    store, key = Cache(default_cache() / "textures"), key_of(facts)
    # Without the lock first: it cannot be had in a folder that may only be read.
    entry = store.find(key) or store.get(key, facts, fill)
    if not entry.found:
        store.prune(_KEEP_BYTES)
    return entry


@cache
def _makers() -> dict[str, Any]:
    """All code that draws: this package, the libraries, and what of the machine they ask for."""
    return {
        "files": digests(_PACKAGE.rglob("*.py"), _PACKAGE),
        "versions": versions(),
        "libc": platform.libc_ver(),
        # Other vector units may round otherwise, and machines may share a folder.
        "units": [platform.machine(), np.show_config(mode="dicts").get("SIMD Extensions")],
    }
