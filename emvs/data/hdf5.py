"""HDF5 as every store here uses it: one compression, and faults told in one line."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import hdf5plugin
import numpy as np

from emvs.errors import InputError

# LZ4 writes ten times as fast as zstd for 1.3 bytes more per event.
COMPRESSION = {
    np.dtype(kind): hdf5plugin.Blosc(cname="lz4", clevel=5, shuffle=shuffle)
    for kind, shuffle in (
        (np.uint8, hdf5plugin.Blosc.BITSHUFFLE),
        (np.uint16, hdf5plugin.Blosc.SHUFFLE),
        (np.int64, hdf5plugin.Blosc.SHUFFLE),
        (np.float32, hdf5plugin.Blosc.SHUFFLE),
    )
}


@contextmanager
def open_hdf5(path: Path) -> Iterator[h5py.File]:
    """Opens a file for reading.

    Raises:
        InputError: a missing or truncated file, or a data set that is missing or damaged.
    """
    try:
        file = h5py.File(path, "r")
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file") from error
    except OSError as error:
        raise InputError(f"{path}: not a whole HDF5 file ({error}); make it again") from error
    with file:
        try:
            yield file
        except (KeyError, OSError, RuntimeError, IndexError, TypeError, AttributeError) as error:
            raise InputError(f"{path}: damaged or of another layout ({error})") from error
