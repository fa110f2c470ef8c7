"""Folders as data sets have them, videos as cameras write them, and all that is wrong with both."""

import os
import struct
import time

import cv2
import numpy as np
import pytest

from eventsweep.plugins.video import frames as frames_module
from eventsweep.plugins.video.frames import checked, open_frames
from eventsweep.sim.config import VideoConfig
from refusals import refused
from video_files import decoded, drifting, write_folder, write_image, write_video

FRAMES = drifting(12)
SECONDS = [f"{k / 10:.1f}" for k in range(12)]


def read(path, **values):
    """Times and images of a source, checked, and what is noted of it."""
    frames = open_frames(path, VideoConfig(**values))
    found = list(checked(frames, frames.path))
    assert frames.share == 1 or not path.is_dir()
    return [frame.t_us for frame in found], np.array([frame.image for frame in found]), frames


def same(found, frames, step_us=100_000):
    times_us, images, _ = found
    np.testing.assert_array_equal(images, frames)
    return times_us == [k * step_us for k in range(len(frames))]


def test_images_are_taken_by_their_numbers(tmp_path):
    """`9.png` before `10.png`."""
    assert same(read(write_folder(tmp_path / "in", FRAMES, SECONDS)), FRAMES)
    assert same(read(tmp_path / "in", stamps=tmp_path / "in" / "timestamps.txt"), FRAMES)


def test_a_rate_beats_the_folders_times_and_says_so(tmp_path):
    folder = write_folder(tmp_path / "in", FRAMES, SECONDS)
    found = read(folder, rate_hz=50)
    assert same(found, FRAMES, 20_000)
    assert found[2].time_base == "50 Hz as stated"
    assert read(folder)[2].time_base == "timestamps.txt in s"


def test_vid2es_layout(tmp_path):
    """Images in `imgs`, times above them."""
    write_folder(tmp_path / "seq" / "imgs", FRAMES)
    (tmp_path / "seq" / "timestamps.txt").write_text("\n".join(SECONDS))
    assert same(read(tmp_path / "seq"), FRAMES)


def test_the_event_camera_datasets_layout(tmp_path):
    write_folder(tmp_path / "images", FRAMES)
    lines = [f"{t} images/{k}.png\n" for k, t in enumerate(SECONDS)]
    (tmp_path / "images.txt").write_text("".join(lines))
    (tmp_path / "calib.txt").write_text("1 1 1 1 0 0 0 0 0")
    found = read(tmp_path)
    assert same(found, FRAMES)
    assert found[2].notes() == [f"{tmp_path}: no images, left out: calib.txt"]


def test_esims_layout_and_images_that_no_line_names(tmp_path):
    folder = write_folder(tmp_path / "in", FRAMES)
    chosen = [f"{k * 10**8},{k}.png\n" for k in range(0, 12, 2)]
    (folder / "images.csv").write_text("".join(["timestamp_ns,filename\n", *chosen]))
    found = read(folder)
    assert same(found, FRAMES[::2], 200_000)
    assert found[2].notes() == [f"{folder}: 6 images left out, which images.csv does not name"]


def test_hidden_files_are_passed_over_and_foreign_ones_named(tmp_path):
    folder = write_folder(tmp_path / "in", FRAMES, SECONDS)
    for name in (".DS_Store", "._0.png", "notes.md", "Thumbs.db"):
        (folder / name).write_bytes(b"x")
    found = read(folder)
    assert same(found, FRAMES)
    assert found[2].notes() == [f"{folder}: no images, left out: Thumbs.db, notes.md"]


def outside(folder):
    write_folder(folder / "in", FRAMES)
    (folder / "in" / "images.txt").write_text("0.0 ../0.png\n0.1 1.png\n")
    write_image(folder / "0.png", FRAMES[0])


@pytest.mark.parametrize(("make", "message"), [
    (lambda f: write_folder(f, FRAMES), r"no times; add timestamps\.txt .*set rate_hz"),
    (lambda f: write_folder(f, FRAMES[:11], SECONDS), "12 times for 11 images"),
    (lambda f: write_folder(f, FRAMES, SECONDS[:11]), "11 times for 12 images"),
    (lambda f: write_folder(f, FRAMES[:1], SECONDS[:1]), "1 images; events need two or more"),
    (lambda f: write_folder(f, [], SECONDS), "12 times for 0 images|0 images"),
    (lambda f: write_image(write_folder(f, FRAMES, SECONDS) / "12.jpg", FRAMES[0]),
     r"several kinds, \.jpg, \.png"),
    (lambda f: write_folder(f, FRAMES, [*SECONDS[:10], "0.5", "0.6"]),
     r"10\.png is at 500000 µs and 9\.png at 900000 µs: times must increase"),
    (lambda f: write_folder(f, FRAMES, [*SECONDS[:10], "0.9", "1.0"]),
     r"10\.png is at 900000 µs and 9\.png at 900000 µs"),
    (lambda f: write_image(write_folder(f, FRAMES, SECONDS) / "7.png", FRAMES[0][:-1]),
     r"7\.png is 40x29 grey uint8 and 6\.png 40x30 grey uint8"),
    (lambda f: write_image(write_folder(f, FRAMES, SECONDS) / "7.png", np.uint16(FRAMES[0])),
     r"7\.png is 40x30 grey uint16"),
    (lambda f: os.truncate(write_folder(f, FRAMES, SECONDS) / "7.png", 300),
     r"7\.png: not a complete PNG"), (outside, "no times|not an image in this folder"),
    (lambda f: (write_folder(f, FRAMES) / "images.txt").write_text("0.0 0.png\n0.1 nope.png\n"),
     r"nope\.png is not an image in this folder"),
])  # fmt: skip
def test_folders_that_cannot_be_used_are_refused_in_one_line(tmp_path, make, message):
    make(tmp_path / "in")
    refused(message, read, tmp_path / "in")


def test_a_list_never_leads_out_of_its_folder(tmp_path):
    outside(tmp_path)
    refused(r"\.\./0\.png is not an image in this folder", read, tmp_path / "in")


@pytest.mark.parametrize(("values", "message"), [
    ({"slow_motion": 2}, "slow_motion is for video files"),
    ({"stamps": "gone.txt"}, "gone.txt: cannot be read"),
])  # fmt: skip
def test_settings_that_say_nothing_of_a_folder_are_refused(tmp_path, values, message):
    refused(message, read, write_folder(tmp_path / "in", FRAMES, SECONDS), **values)


COLOUR = drifting(20, 64, 48, colour=True)


@pytest.mark.parametrize(
    ("name", "codec"), [("v.avi", "MJPG"), ("v.mp4", "mp4v"), ("v.mkv", "FFV1"), ("v.mov", "mp4v")]
)
def test_a_video_is_its_decoded_frames_at_its_own_times(tmp_path, name, codec):
    path = write_video(tmp_path / name, COLOUR, 25.0, codec)
    times_us, images, frames = read(path)
    np.testing.assert_array_equal(images, decoded(path))
    assert times_us == [40_000 * k for k in range(20)]
    assert frames.time_base == "the file's own, 25 Hz on average"
    assert frames.notes() == []
    if codec == "FFV1":  # nothing is lost, and red comes first
        np.testing.assert_allclose(images.astype(int), COLOUR, atol=4)


def test_a_video_whose_end_is_missing_is_read_and_told_of(tmp_path):
    path = write_video(tmp_path / "v.avi", COLOUR)
    os.truncate(path, path.stat().st_size * 2 // 3)
    times_us, _, frames = read(path)
    assert 2 < len(times_us) < 20
    assert frames.notes() == [
        f"{path}: {len(times_us)} of 20 declared frames could be read; its end may be missing"
    ]


def test_a_stream_without_container_has_no_time_base(tmp_path):
    stream = b"".join(cv2.imencode(".jpg", frame)[1].tobytes() for frame in COLOUR)
    (tmp_path / "v.mjpeg").write_bytes(stream)
    refused("no time base in its video stream; set rate_hz", read, tmp_path / "v.mjpeg")
    times_us, images, _ = read(tmp_path / "v.mjpeg", rate_hz=1000)
    assert times_us == [1000 * k for k in range(20)]
    assert images.shape == (20, 48, 64, 3)


def test_h264_start_codes_are_no_time_base_either(tmp_path):
    for head in (b"\0\0\0\1\x67", b"\0\0\1\xb3\x14"):
        (tmp_path / "v.264").write_bytes(head + bytes(100))
        refused("no time base", open_frames, tmp_path / "v.264", VideoConfig())


def half(path):
    os.truncate(write_video(path, COLOUR, codec="mp4v"), path.stat().st_size // 2)


@pytest.mark.parametrize(("make", "name"), [
    (lambda path: path.write_bytes(b""), "v.mp4"), (half, "v.mp4"),
    (lambda path: path.write_text("cannot be opened as a video"), "v.avi"),
])  # fmt: skip
def test_files_that_are_no_video_are_refused_in_one_line(tmp_path, capfd, make, name):
    make(tmp_path / name)
    refused(rf"{name}: (cannot be opened as a video|no frame)", read, tmp_path / name)
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("name", ["v.mp4", "v.m3u8"])
@pytest.mark.parametrize(
    "text", ["#EXTM3U\n#EXTINF:1,\nother.ts\n", "\n#extm3u\n", "ffconcat version 1.0\nfile o.mp4\n"]
)
def test_a_list_of_other_videos_is_refused_unread(tmp_path, name, text):
    write_video(tmp_path / "other.avi", COLOUR)
    (tmp_path / name).write_text(text.replace("other.ts", "other.avi"))
    refused(rf"{name}: is a playlist, not a video", read, tmp_path / name)


def claimed(side_px):
    """A GIF of a hundred bytes: five frames of one pixel, on a canvas of `side_px` squared."""
    canvas = b"GIF89a" + struct.pack("<HHBBB", side_px, side_px, 0x80, 0, 0) + bytes(6)
    delay, place = b"\x21\xf9\4\0\x0a\0\0\0", b"\x2c" + struct.pack("<HHHHB", 0, 0, 1, 1, 0)
    return canvas + 5 * (delay + place + b"\2\2\x44\1\0") + b"\x3b"


@pytest.mark.parametrize(("side_px", "words"), [
    (4000, "takes more than 32 MB of memory"), (16_000, "declares 16000x16000 pixels"),
    (30_000, "no frame can be decoded"),
])  # fmt: skip
def test_a_few_bytes_that_claim_large_frames(tmp_path, monkeypatch, side_px, words):
    path = tmp_path / "v.gif"
    path.write_bytes(claimed(100))
    assert read(path)[1].shape == (5, 100, 100, 3)
    monkeypatch.setattr(frames_module, "_BEGIN_BYTES", 1 << 25)
    path.write_bytes(claimed(side_px))
    began = time.monotonic()
    refused(words, read, path)
    assert time.monotonic() - began < 5


def test_a_video_of_one_frame_is_refused(tmp_path):
    refused("1 frame; events need two", read, write_video(tmp_path / "v.avi", COLOUR[:1]))


@pytest.mark.parametrize(
    ("values", "message"),
    [({"unit": "us"}, "for a video set rate_hz"), ({"stamps": "t.txt"}, "for a video set rate_hz")],
)
def test_settings_that_say_nothing_of_a_video_are_refused(tmp_path, values, message):
    refused(message, read, write_video(tmp_path / "v.avi", COLOUR), **values)


def test_what_is_neither_is_refused(tmp_path):
    write_image(tmp_path / "a.png", FRAMES[0])
    refused("is a single image", open_frames, tmp_path / "a.png", VideoConfig())
    refused("no such file or folder", open_frames, tmp_path / "gone", VideoConfig())
    os.mkfifo(tmp_path / "pipe.avi")
    refused("pipe", open_frames, tmp_path / "pipe.avi", VideoConfig())
