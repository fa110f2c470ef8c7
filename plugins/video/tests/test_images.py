"""Image files come back as they were written, become the right light, or are refused whole."""

import random
import warnings

import cv2
import numpy as np
import pytest
from PIL import Image as Pillow

from eventsweep.emvs.errors import InputError
from eventsweep.plugins.video.film import Light
from eventsweep.plugins.video.images import READERS, read_image
from eventsweep.sim.config import VideoConfig
from refusals import refused
from video_files import write_image

RNG = np.random.default_rng(0)
GREY8 = RNG.integers(0, 256, (9, 13), np.uint8)
RGB8 = RNG.integers(0, 256, (9, 13, 3), np.uint8)
GREY16 = RNG.integers(0, 65536, (9, 13), np.uint16)
RGB16 = RNG.integers(0, 65536, (9, 13, 3), np.uint16)
GREYF = RNG.random((9, 13), np.float32) * 3
RGBF = RNG.random((9, 13, 3), np.float32) * 3

KINDS = [
    *((".png", image) for image in (GREY8, RGB8, GREY16, RGB16)),
    *((suffix, image) for suffix in (".tif", ".tiff", ".npy")
      for image in (GREY8, RGB8, GREY16, RGB16, GREYF, RGBF)),
    (".exr", GREYF), (".exr", RGBF),
]  # fmt: skip


@pytest.mark.parametrize(("suffix", "image"), KINDS)
def test_what_was_written_is_read(tmp_path, suffix, image):
    write_image(tmp_path / f"a{suffix}", image)
    found = read_image(tmp_path / f"a{suffix}")
    assert found.dtype == image.dtype
    np.testing.assert_array_equal(found, image)


@pytest.mark.parametrize("image", [GREY8, RGB8])
def test_a_jpeg_is_what_pillow_decodes(tmp_path, image):
    Pillow.fromarray(image).save(tmp_path / "a.JPG")
    found = read_image(tmp_path / "a.JPG")
    np.testing.assert_array_equal(found, np.asarray(Pillow.open(tmp_path / "a.JPG")))


def test_other_forms_of_the_same_picture(tmp_path):
    np.save(tmp_path / "half.npy", GREYF.astype(np.float16))
    np.save(tmp_path / "double.npy", GREYF.astype(np.float64)[..., None])
    np.testing.assert_array_equal(read_image(tmp_path / "half.npy"), GREYF.astype(np.float16))
    np.testing.assert_array_equal(read_image(tmp_path / "double.npy"), GREYF)
    opaque = np.dstack([RGB8, np.full((9, 13), 255, np.uint8)])
    write_image(tmp_path / "rgba.png", opaque[..., [2, 1, 0, 3]][..., ::-1][..., [1, 2, 3, 0]])
    cv2.imwrite(str(tmp_path / "rgba.png"), opaque[..., [2, 1, 0, 3]])
    np.testing.assert_array_equal(read_image(tmp_path / "rgba.png"), RGB8)
    Pillow.fromarray(GREY8).convert("P").save(tmp_path / "palette.png")
    assert read_image(tmp_path / "palette.png").shape[:2] == GREY8.shape


@pytest.mark.parametrize("suffix", READERS)
@pytest.mark.parametrize("share", [0, 0.3, 0.9, 0.999])
def test_a_truncated_image_is_refused_and_named(tmp_path, capfd, suffix, share):
    path = tmp_path / f"a{suffix}"
    write_image(path, RGBF if suffix == ".exr" else RGB8)
    data = path.read_bytes()
    path.write_bytes(data[: min(int(len(data) * share), len(data) - 2)])
    refused(f"a{suffix}", read_image, path)
    said = capfd.readouterr()
    assert said.out == ""
    assert said.err == "" or suffix == ".exr"  # its library speaks for itself


@pytest.mark.parametrize(("name", "array", "message"), [
    ("a.npy", np.zeros((0, 5), np.uint8), "5x0 pixels"),
    ("a.npy", np.zeros((5,), np.uint8), "pixels"),
    ("a.npy", np.zeros((5, 4, 2), np.uint8), r"shape \(5, 4, 2\)"),
    ("a.npy", np.zeros((5, 4), np.int32), "values of int32"),
    ("a.npy", np.zeros((5, 4), np.complex64), "values of complex64"),
    ("a.npy", np.array([[None]]), "not a complete npy"),
    ("a.tiff", np.zeros((5, 4), np.int32), "values of int32"),
])  # fmt: skip
def test_arrays_that_are_no_image_are_refused(tmp_path, name, array, message):
    if name == "a.npy":
        np.save(tmp_path / name, array, allow_pickle=True)
    else:
        write_image(tmp_path / name, array)
    refused(message, read_image, tmp_path / name)


def test_transparent_unreadable_and_vast_images_are_refused(tmp_path):
    seen_through = np.dstack([RGB8, np.full((9, 13), 254, np.uint8)])
    cv2.imwrite(str(tmp_path / "a.png"), seen_through)
    refused("transparent", read_image, tmp_path / "a.png")
    shape = "{'descr': '|u1', 'fortran_order': False, 'shape': (1000000, 1000000), }"
    text = shape.ljust(117).encode() + b"\n"
    header = np.lib.format.magic(1, 0) + len(text).to_bytes(2, "little")
    (tmp_path / "a.npy").write_bytes(header + text)
    refused(r"a\.npy", read_image, tmp_path / "a.npy")  # before it is read
    (tmp_path / "b.png").mkdir()
    refused("is a folder", read_image, tmp_path / "b.png")
    refused("No such file", read_image, tmp_path / "c.png")


def mutated(data, random_):
    """Bytes with a few bits flipped, stretches cut out or doubled."""
    data = bytearray(data)
    for _ in range(random_.randint(1, 4)):
        at, kind = random_.randrange(len(data)), random_.randrange(3)
        if kind == 0:
            data[at] ^= 1 << random_.randrange(8)
        elif kind == 1:
            del data[at : at + random_.randint(1, min(40, len(data) - 1))]
        else:
            data[at:at] = data[at : at + 8]
    return bytes(data)


def refusal(path):
    """What is said of a file that is refused; empty where it is read."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            image = read_image(path)
    except InputError as error:
        return str(error)
    return "" if 0 < image.size <= 3 * 2**26 else f"size {image.size}"


@pytest.mark.parametrize("suffix", READERS)
def test_damaged_images_end_in_one_line_or_in_pixels(tmp_path, suffix):
    """120 mutants of each kind."""
    path, random_ = tmp_path / f"a{suffix}", random.Random(suffix)
    write_image(path, RGBF if suffix == ".exr" else RGB8)
    whole, said = path.read_bytes(), []
    for _ in range(120):
        path.write_bytes(mutated(whole, random_))
        said.append(refusal(path))
    refused = [line for line in said if line]
    assert len(refused) > 20
    assert all(str(path) in line and "\n" not in line for line in refused)


def srgb(value):
    return value / 12.92 if value <= 0.04045 else ((value + 0.055) / 1.055) ** 2.4


LAWS = {
    "srgb": (VideoConfig(), srgb),
    "linear": (VideoConfig(encoding="linear"), lambda value: value),
    "gamma": (VideoConfig(encoding="gamma"), lambda value: value**2.2),
    "gamma 1.8": (VideoConfig(encoding="gamma", gamma=1.8), lambda value: value**1.8),
}


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize(
    ("image", "full"), [(GREY8, 255), (RGB8, 255), (GREY16, 65535), (RGB16, 65535)]
)
def test_light_of_whole_numbers_pixel_by_pixel(name, image, full):
    video, law = LAWS[name]
    found = Light(image.dtype, video)(image)
    for y, x in ((0, 0), (3, 4), (8, 12)):
        values = [law(value / full) for value in np.atleast_1d(image[y, x]).tolist()]
        weights = [1] if len(values) == 1 else [0.2126, 0.7152, 0.0722]
        expected = sum(w * v for w, v in zip(weights, values, strict=True))
        assert found[y, x] == pytest.approx(expected, rel=1e-6)
    assert found.dtype == np.float32


def test_grey_in_three_channels_is_as_light_as_in_one():
    for image in (GREY8, GREY16, GREYF):
        light = Light(image.dtype, VideoConfig())
        np.testing.assert_allclose(light(np.dstack([image] * 3)), light(image), rtol=1e-6)


def test_light_of_floats_is_linear_unless_said_otherwise():
    assert Light(GREYF.dtype, VideoConfig()).encoding == "linear"
    np.testing.assert_array_equal(Light(GREYF.dtype, VideoConfig())(GREYF), GREYF)
    logs = Light(GREYF.dtype, VideoConfig(encoding="log"))
    np.testing.assert_allclose(logs(np.log(GREYF)), GREYF, rtol=1e-6)
    twelve = Light(GREY16.dtype, VideoConfig(encoding="linear", full_scale=4095))
    assert twelve(np.full((1, 1), 4095, np.uint16)) == 1


def test_logarithms_in_whole_numbers_are_refused():
    refused("cannot hold logarithms", Light, GREY8.dtype, VideoConfig(encoding="log"))


@pytest.mark.parametrize(("values", "message"), [
    ({"gamma": 2.0}, "has no effect unless encoding is gamma"),
    ({"encoding": "log", "full_scale": 2.0}, "has no effect on logarithms"),
    ({"encoding": "rec709"}, "encoding"),
    ({"rate_hz": 30, "unit": "s"}, "both set the times"),
    ({"rate_hz": 0}, "rate_hz"),
    ({"slow_motion": float("inf")}, "slow_motion"),
])  # fmt: skip
def test_settings_that_cannot_be_are_refused(values, message):
    refused(message, VideoConfig, **values)
