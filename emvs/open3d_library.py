"""Loads open3d where it is needed: it takes two seconds and 200 MB."""

from __future__ import annotations

from typing import Any

from emvs.errors import InputError


def open3d() -> Any:
    """The library.

    Raises:
        InputError: it cannot be loaded.
    """
    try:
        import open3d as library
    except (ImportError, OSError) as error:
        raise InputError(
            f"open3d cannot be loaded ({error}): install its system libraries "
            "(Debian: libgl1 libegl1 libx11-6 libusb-1.0-0 libgomp1)"
        ) from error
    return library
