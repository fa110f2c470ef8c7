"""Small files of others: an npz that would fill the memory, and byte order marks of texts."""

import re
import struct
from pathlib import Path

import numpy as np
import pytest

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.calibration import read_rig
from eventsweep.emvs.formats.depth import read_depth
from eventsweep.emvs.maps.folder import read_npz
from eventsweep.emvs.utils.inputs import NPZ_BYTES, opened_npz, read_text
from eventsweep.eval.gate.baseline import read_baseline
from eventsweep.eval.results.results import read_results
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


LFS = "version https://git-lfs.github.com/spec/v1\noid sha256:" + "a" * 64 + "\nsize 12345\n"
PAGE = "<!DOCTYPE html>\n<html><head><title>Not found</title></head></html>\n"
STAND_INS = {
    LFS: "Git LFS pointer.*`git lfs pull`", PAGE: "is a web page.*download the file itself",
    "\ufeff \n<HTML>": "is a web page",
}  # fmt: skip
DOORS = {
    "events.csv": open_events, "events.raw": open_events, "events.h5": open_events,
    "events.npz": open_events, "events.aedat4": open_events, "events.bag": open_events,
    "poses.txt": read_poses, "kalibr.yaml": read_rig, "rig.json": read_rig,
    "baseline.json": read_baseline, "results.json": read_results, "depth.npz": read_depth,
    "events.mat": open_events,
}  # fmt: skip


@pytest.mark.parametrize("content", STAND_INS, ids=["lfs", "page", "marked page"])
@pytest.mark.parametrize("name", DOORS)
def test_what_stands_for_a_file_is_named_by_every_reader(tmp_path, name, content):
    """A pointer was called a damaged file, to be made again: whoever does that loses the file."""
    (tmp_path / name).write_text(content)
    line = refused(STAND_INS[content], DOORS[name], tmp_path / name)
    assert str(tmp_path / name) in line
    assert not re.search("again|anew|update", line)
