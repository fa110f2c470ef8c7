"""Pictures and arrays that declare more than memory holds are refused by what they declare."""

import os
import struct
import tracemalloc

import cv2
import h5py
import numpy as np
import pytest

from eventsweep.emvs.data.hdf5 import check_dataset, read_whole
from eventsweep.emvs.formats.depth import decoded, read_depth, read_exr
from eventsweep.eval.scoring.depth_files import SUFFIXES, read_stored
from eventsweep.plugins.video.images import READERS, read_image
from refusals import refused

LARGE = 40_000


def tiff(order, big, tags):
    """A TIFF of nothing but a list of tags."""
    head = struct.pack(order + "HHHQ", 43, 8, 0, 16) if big else struct.pack(order + "HI", 42, 8)
    entry, count = ("HHQQ", "Q") if big else ("HHII", "H")
    rows = b"".join(
        struct.pack(order + entry, tag, 16 if big else 4, 1, value) for tag, value in tags.items()
    )
    mark = b"II" if order == "<" else b"MM"
    return mark + head + struct.pack(order + count, len(tags)) + rows + bytes(8)


def exr(width, height, channels=1):
    """An EXR of nothing but a head."""

    def attribute(name, kind, value):
        return f"{name}\0{kind}\0".encode() + struct.pack("<I", len(value)) + value

    listed = b"".join(f"c{k}".encode() + b"\0" + bytes(16) for k in range(channels)) + b"\0"
    window = struct.pack("<4i", 0, 0, width - 1, height - 1)
    head = attribute("channels", "chlist", listed) + attribute("dataWindow", "box2i", window)
    return b"\x76\x2f\x31\x01\x02\0\0\0" + head + b"\0" + bytes(64)


CLAIMS = {
    **{f"{order}{big}.tif": tiff(order, big, {256: LARGE, 257: LARGE})
       for order in "<>" for big in (False, True)},
    "tile.tiff": tiff("<", False, {256: 10, 257: 10, 322: LARGE, 323: LARGE}),
    "one.exr": exr(LARGE, LARGE), "many.exr": exr(4000, 4000, 50),
}  # fmt: skip


@pytest.mark.parametrize("name", CLAIMS)
def test_what_declares_too_many_pixels_is_refused_before_it_is_decoded(tmp_path, name):
    path = tmp_path / name
    path.write_bytes(CLAIMS[name])
    tracemalloc.start()
    for read in (read_image, lambda path: read_stored(path, 4, 6)):
        refused(r"declares \d+x\d+ pixels; at most 2\^26 are read", read, path)
    assert tracemalloc.get_traced_memory()[1] < 1 << 24
    tracemalloc.stop()


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize("colours", [(), (3,)])
def test_tiffs_as_opencv_writes_them_are_decoded(tmp_path, kind, colours):
    image = (np.random.default_rng(0).random((30, 40, *colours)) * 250).astype(kind)
    cv2.imwrite(str(tmp_path / "a.tif"), image)
    np.testing.assert_array_equal(decoded(tmp_path / "a.tif"), image)


@pytest.mark.parametrize("content", [b"", b"II", b"MM\0*\0\0\xff\xff", b"II*\0\x08\0\0\0\x05\0"])
def test_damage_is_one_line(tmp_path, content):
    (tmp_path / "a.tif").write_bytes(content)
    refused("a.tif: not a complete TIFF image", decoded, tmp_path / "a.tif")
    (tmp_path / "a.exr").write_bytes(content)
    refused("a.exr: not a complete EXR", read_exr, tmp_path / "a.exr")


@pytest.mark.parametrize("plant", [os.mkfifo, lambda path: path.symlink_to("/dev/zero")])
@pytest.mark.parametrize("suffix", sorted({*READERS, *SUFFIXES}))
def test_only_regular_files_are_read(tmp_path, plant, suffix):
    path = tmp_path / f"a{suffix}"
    plant(path)
    for suffixes, read in (
        (READERS, read_image), (SUFFIXES, lambda path: read_stored(path, 4, 6)),
        ((".npy", ".npz"), read_depth),
    ):  # fmt: skip
        if suffix in suffixes:
            refused("is a (pipe|device); needs a regular file", read, path)


def test_data_sets_of_a_thousand_times_their_file(tmp_path):
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("t", (1 << 26,), np.int64, chunks=(1 << 24,), compression="gzip")
        file["t"][...] = 0
        file.create_dataset("rows", (1, LARGE, LARGE), np.float32, chunks=(1, LARGE, 1000))
    assert path.stat().st_size < 1 << 20
    with h5py.File(path) as file:
        refused("536870912 bytes, at most 268435456 are read", read_whole, path, file["t"])
        refused("rows need|rows of 6400000000 bytes", check_dataset, path, file["rows"])
