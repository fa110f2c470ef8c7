"""Whether an HDF5 data set can be read at all: its filters, and bytes behind the rows it declares.

HDF5 reads zeros where chunks are missing, and a filter whose parameters were damaged can end the
whole process; so both are looked at before the first value is read.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np

from emvs.errors import InputError

ECF = 0x8ECF
"""The filter of Prophesee's codec."""
_MOST_CHUNK = 1 << 28
# What the plug-ins themselves store for each data set, and read without counting.
_LEAST_PARAMETERS = {32001: 4, 32008: 3, 32026: 4}


def check_dataset(path: Path, data: Any) -> int:
    """Number of rows of a data set.

    Raises:
        InputError: no data set, a filter that is not installed or damaged, chunks beyond 2^28
            bytes, or fewer bytes than it declares.
    """
    if not isinstance(data, h5py.Dataset) or not data.shape:
        raise InputError(f"{path}: a group or single value where a data set should be; damaged")
    where = f"{path}, data set {data.name}"
    _check_filters(where, data)
    _check_storage(where, data)
    return int(data.shape[0])


def _check_filters(where: str, data: h5py.Dataset) -> None:
    plist = data.id.get_create_plist()
    for k in range(plist.get_nfilters()):
        code, _, parameters, *_ = plist.get_filter(k)
        if not h5py.h5z.filter_avail(code):
            cure = "install Prophesee's ECF plug-in" if code == ECF else "install its plug-in"
            raise InputError(
                f"{where}: compressed by filter {code:#x}, which is not installed; {cure} and name "
                "its folder in HDF5_PLUGIN_PATH"
            )
        if len(parameters) < _LEAST_PARAMETERS.get(code, 0):
            raise InputError(
                f"{where}: filter {code} with {len(parameters)} parameters, needs "
                f"{_LEAST_PARAMETERS[code]}; the file is damaged, fetch it again"
            )


def _check_storage(where: str, data: h5py.Dataset) -> None:
    """Refuses counts that the file does not back with bytes: HDF5 would read zeros there."""
    if data.chunks is None:
        stored, needed = data.id.get_storage_size(), data.nbytes
    else:
        stored = data.id.get_num_chunks()
        size = int(np.prod(data.chunks)) * data.dtype.itemsize
        if size > _MOST_CHUNK:
            raise InputError(
                f"{where}: chunks of {size} bytes, at most {_MOST_CHUNK} are read; the file is "
                "damaged, or rewrite it in smaller chunks"
            )
        needed = int(np.prod([-(-n // c) for n, c in zip(data.shape, data.chunks, strict=True)]))
    if stored < needed:
        unit = "bytes" if data.chunks is None else "chunks"
        raise InputError(
            f"{where}: {data.shape[0]} rows need {needed} {unit}, {stored} are there; the file "
            "is not whole, fetch it again"
        )
