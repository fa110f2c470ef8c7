"""Addresses such as `s3://bucket/run/sequence`, and the folder here that stands for each.

An address has a *mirror*: a folder in the cache whose path says which address it stands for, so
that every process finds the other from either. What reads and writes paths works there as in any
folder. `emvs.utils.mirror` fills mirrors and sends back what changed; of large files only blocks
are fetched, when they are read (`emvs.utils.blocks`).
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from eventsweep.emvs.errors import InputError, heed_interrupt, said
from eventsweep.emvs.utils.files import default_cache
from eventsweep.emvs.utils.release import install_extra

# What a name must begin with to be an address: others, such as `C:`, stay paths.
_SCHEMES = "s3|gs|gcs|az|abfs|https?|memory"
# A `Path` makes one slash of two.
_ADDRESS = re.compile(rf"({_SCHEMES}):/+([^/].*)", re.DOTALL)
_TRIES, _PAUSE_S = 4, 0.5
_FINAL = (InputError, FileNotFoundError, PermissionError, NotImplementedError)
Value = TypeVar("Value")


class Store(NamedTuple):
    """Where an address leads: a file system of `fsspec`, and the path in it."""

    files: Any
    path: str


def address_of(path: str | Path) -> str | None:
    """The address that a path is, or that a mirror stands for; None for any other path.

    What exists here by that name is a path.
    """
    text, start = str(path), f"{mirrors()}/"
    if text.startswith(start):
        scheme, _, rest = text.removeprefix(start).partition("/")
        return f"{scheme}://{rest}"
    found = _ADDRESS.fullmatch(text)
    if found is None or Path(text).exists():
        return None
    return f"{found[1]}://{found[2].rstrip('/')}"


def is_address(path: str | Path) -> bool:
    """Whether a path is an address, and not a mirror's."""
    return not Path(path).is_absolute() and address_of(path) is not None


def mirror_of(address: str | Path) -> Path:
    """The folder that stands for an address; a path that is none stays.

    Raises:
        InputError: an address without a place in it, or with a part that leads elsewhere.
    """
    text = address_of(address)
    if text is None:
        return Path(address)
    scheme, _, rest = text.partition("://")
    parts = rest.split("/")
    if len(parts) < 2 or set(parts) & {"", ".", ".."} or "\0" in rest:
        raise InputError(f"{text}: needs {scheme}://PLACE/NAME, without empty parts, `.` or `..`")
    return mirrors().joinpath(scheme, *parts)


def named(text: str) -> str:
    """A text with addresses in the place of their mirrors."""
    return re.sub(rf"{re.escape(str(mirrors()))}/({_SCHEMES})/", r"\1://", text)


def store_of(address: str) -> Store:
    """Opens what an address leads to; nothing is read yet.

    Raises:
        InputError: a library that is not installed.
    """
    try:
        from fsspec.core import url_to_fs

        return Store(*url_to_fs(address, use_listings_cache=False))
    except ImportError as error:
        heed_interrupt(error)
        scheme = address.partition(":")[0]
        library = "" if scheme in ("s3", "memory") else f" and fsspec's library for {scheme}://"
        raise InputError(
            f"{address}: needs libraries ({said(error)}): {install_extra('remote')}{library}"
        ) from error


@contextmanager
def reached(address: str, does: str = "read") -> Iterator[None]:
    """Says in one line what kept an address from being read or written."""
    try:
        yield
    except InputError:
        raise
    except FileNotFoundError as error:
        raise InputError(f"{address}: nothing is there; correct the address") from error
    except Exception as error:  # each library of a store has its own
        heed_interrupt(error)
        raise InputError(
            f"{address}: cannot be {does} ({said(error)}): check the network and your "
            "credentials for it, then repeat"
        ) from error


def retried(call: Callable[[], Value]) -> Value:
    """What a call returns, tried again if a connection is cut; what no try changes is not."""
    for k in range(_TRIES):
        try:
            return call()
        except _FINAL:
            raise
        except Exception:  # of a cut connection, each library has its own
            if k == _TRIES - 1:
                raise
            time.sleep(_PAUSE_S * 2**k)
    raise AssertionError


def mirrors() -> Path:
    """The folder of all mirrors."""
    return default_cache().resolve() / "remote"
