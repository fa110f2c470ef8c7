"""PNG images of data sets: every pixel exact, and no damage that is not refused in one line."""

import struct
import zlib

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from eventsweep.emvs.formats.depth import read_grey, read_png
from refusals import refused

SIZES = arrays.array_shapes(min_dims=2, max_dims=2, max_side=40)
SIGNATURE = b"\x89PNG\r\n\x1a\n"
GRID = np.arange(35, dtype=np.uint16).reshape(5, 7) * 1800


def encoded(image):
    return cv2.imencode(".png", image)[1].tobytes()


def chunk(kind, content=b""):
    return struct.pack(">I", len(content)) + (kind + content) + struct.pack(
        ">I", zlib.crc32(kind + content)
    )  # fmt: skip


def made(width, height, *more, bits=8, colour=0, pixels=b""):
    """A PNG of these chunks, all check sums right."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, bits, colour, 0, 0, 0))
    return SIGNATURE + header + b"".join(more) + chunk(b"IDAT", pixels) + chunk(b"IEND")


def not_png(path, data, words="not a complete PNG image", read=read_png):
    path.write_bytes(data)
    said = refused(words, read, path)
    assert said.startswith(f"{path}: ")
    assert len(said) < len(str(path)) + 300


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("png")


@settings(max_examples=40)
@given(st.sampled_from(["uint8", "uint16"]).flatmap(lambda kind: arrays.arrays(kind, SIZES)))
def test_grey_levels_come_back_exactly(folder, image):
    path = folder / "a.png"
    path.write_bytes(encoded(image))
    found = read_png(path)
    assert found.dtype == image.dtype
    np.testing.assert_array_equal(found, image)
    grey = read_grey(path)
    assert grey.dtype == np.uint8
    np.testing.assert_array_equal(grey, cv2.imread(str(path), cv2.IMREAD_GRAYSCALE))


@pytest.mark.parametrize("bits", [1, 2, 4])
def test_few_bits_fill_the_range(tmp_path, bits):
    levels, count = 2**bits, 8 // bits
    stored = [k % levels for k in range(count)]
    packed = sum(value << (8 - bits * (k + 1)) for k, value in enumerate(stored))
    path = tmp_path / "a.png"
    path.write_bytes(made(count, 1, bits=bits, pixels=zlib.compress(bytes([0, packed]))))
    expected = [[value * 255 // (levels - 1) for value in stored]]
    np.testing.assert_array_equal(read_png(path), expected)
    np.testing.assert_array_equal(read_grey(path), expected)


def test_colours_are_three_numbers_and_grey_where_they_are_equal(tmp_path):
    path = tmp_path / "a.png"
    even = np.repeat(np.arange(0, 250, 10, dtype=np.uint8).reshape(5, 5, 1), 3, axis=2)
    path.write_bytes(encoded(even))
    np.testing.assert_array_equal(read_png(path), even)
    np.testing.assert_array_equal(read_grey(path), even[..., 0])


def test_what_follows_the_end_does_not_matter(tmp_path):
    (tmp_path / "a.png").write_bytes(encoded(GRID) + b"more")
    np.testing.assert_array_equal(read_png(tmp_path / "a.png"), GRID)


def test_every_cut_and_every_changed_byte_is_refused(tmp_path):
    whole = encoded(GRID)
    for at in range(len(whole)):
        not_png(tmp_path / "a.png", whole[:at])
        not_png(tmp_path / "a.png", whole[:at] + bytes([whole[at] ^ 0x10]) + whole[at + 1 :])


SIZES_PX = [(1 << 14, (1 << 12) + 1), (40_000, 40_000), (2**31 - 1, 2**31 - 1)]
BOMB = zlib.compress(bytes(1 << 24))
HOSTILE = [
    chunk(b"iCCP", b"p\0\0" + BOMB), chunk(b"zTXt", b"k\0\0" + BOMB), chunk(b"acTL", bytes(8)),
    chunk(b"IHDR", bytes(13)), chunk(b"IHDR", b""), b"\xff\xff\xff\xffIDAT",
]  # fmt: skip


@pytest.mark.parametrize("size_px", SIZES_PX)
@pytest.mark.filterwarnings("error")
def test_declared_sizes_are_bounded_before_anything_is_unpacked(tmp_path, size_px):
    data = made(*size_px, pixels=zlib.compress(b""))
    not_png(tmp_path / "a.png", data, "a.png: declares {}x{} pixels; at most 2".format(*size_px))


@pytest.mark.parametrize("data", [
    *(made(4, 4, more, pixels=zlib.compress(bytes(20))) for more in HOSTILE),
    *(b"", b"\x89PNG", b"GIF89a" + bytes(50), SIGNATURE),
])  # fmt: skip
@pytest.mark.filterwarnings("default")
def test_hostile_chunks_and_other_files_are_refused_and_nothing_else_is_said(
    tmp_path, data, recwarn
):
    not_png(tmp_path / "a.png", data)
    assert not recwarn.list


@pytest.mark.parametrize(("width", "height", "pixels"), [
    (0, 5, b""), (5, 0, b""), (4, 4, b""), (4, 4, b"no zlib"),
    (4, 4, zlib.compress(bytes(7))), (4, 4, zlib.compress(bytes(20))[:-6]),
])  # fmt: skip
@pytest.mark.parametrize("read", [read_png, read_grey])
def test_too_few_pixels_are_refused(tmp_path, width, height, pixels, read):
    not_png(tmp_path / "a.png", made(width, height, pixels=pixels), read=read)


def test_a_missing_file_and_a_huge_one_are_refused(tmp_path):
    refused("cannot be read", read_png, tmp_path / "none.png")
    with (tmp_path / "big.png").open("wb") as file:
        file.truncate((1 << 28) + 1)
    refused("at most 268435456 are read", read_png, tmp_path / "big.png")
