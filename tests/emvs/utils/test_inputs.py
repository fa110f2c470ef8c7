"""Small files of others: an npz that would fill the memory, and byte order marks of texts."""

import struct
from pathlib import Path

import numpy as np
import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats.depth import read_depth
from eventsweep.emvs.maps.folder import read_npz
from eventsweep.emvs.utils.inputs import NPZ_BYTES, opened_npz, read_text
from eventsweep.eval.scoring.depth_files import read_confidence, read_stored
from refusals import refused

SHAPE = (4, 6)
_UNPACKED_AT = 24  # in an entry of the archive's directory


def npz(path: Path, claimed: int | None = None) -> Path:
    """A depth map; its directory says that each array unpacks to `claimed` bytes."""
    arrays = {name: np.ones(SHAPE) for name in ("depth_m", "confidence")}
    np.savez_compressed(path, mask=np.ones(SHAPE, bool), **arrays)
    content = bytearray(path.read_bytes())
    at = content.find(b"PK\x01\x02")
    while claimed is not None and at >= 0:
        struct.pack_into("<I", content, at + _UNPACKED_AT, claimed)
        at = content.find(b"PK\x01\x02", at + 4)
    path.write_bytes(content)
    return path


READERS = {
    "depth": read_depth,
    "map": lambda path: read_npz(path, ["depth_m"]),
    "prediction": lambda path: read_stored(path, *SHAPE),
    "confidence": lambda path: read_confidence(path, *SHAPE),
}


@pytest.mark.parametrize("reader", READERS.values(), ids=READERS)
def test_whoever_reads_one(reader, tmp_path):
    reader(npz(tmp_path / "right.npz"))
    with pytest.raises(InputError, match=f"unpacks to {3 * 2**30} bytes, at most {NPZ_BYTES}"):
        reader(npz(tmp_path / "large.npz", 2**30))


def test_no_pipe_and_no_more_than_is_asked_for(tmp_path):
    with opened_npz(npz(tmp_path / "right.npz")) as arrays:
        assert arrays["depth_m"].shape == SHAPE
    refused("at most 10 are read", opened_npz, tmp_path / "right.npz", 10)
    refused("is a folder", opened_npz, tmp_path)


def test_a_byte_order_mark_is_no_part_of_a_text(tmp_path):
    path = tmp_path / "t"
    for encoding in ("utf-8", "utf-8-sig"):
        path.write_bytes("a µ\r\nb\r".encode(encoding))
        assert read_text(path, 99) == "a µ\nb\n"
    for encoding in ("utf-16", "utf-32"):
        path.write_bytes("{}".encode(encoding))
        refused("UTF-16 or UTF-32; save it as UTF-8", read_text, path, 99)
