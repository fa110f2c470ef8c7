"""The Event Camera Dataset's text: a miniature, damage, and the real recording."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.formats.tables import text
from refusals import refused

CALIBRATION = "335.4 335.3 129.9 99.2 -0.14 0.09 -0.0003 0.0002 0.0\n"
POSES = "0.0 0 0 0 0 0 0 1\n1.0 0.5 0 0 0 0 0 1\n"


def miniature(
    path: Path, *, events: str | None = None, calib: str = CALIBRATION, poses: str = POSES
) -> Path:
    path.mkdir(exist_ok=True)
    lines = "".join(f"{k * 1e-5:.9f} {k % 240} {k % 180} {k % 2}\n" for k in range(5000))
    (path / "events.txt").write_text(lines if events is None else events)
    (path / "calib.txt").write_text(calib)
    (path / "groundtruth.txt").write_text(poses)
    return path


@pytest.mark.parametrize("block_bytes", [1, 100, 5000, 1 << 23])
def test_every_block_size_reads_the_same(tmp_path, monkeypatch, block_bytes):
    monkeypatch.setattr(text, "_BLOCK_BYTES", block_bytes)
    count = 300 if block_bytes == 1 else 5000
    lines = "".join(f"{k * 1e-5:.9f} {k % 240} {k % 180} {k % 2}\n" for k in range(count))
    recording = open_recording(miniature(tmp_path / "m", events=lines))
    events = recording.events(0, 100, 2000)
    k = np.arange(10, min(200, count))
    assert np.array_equal(events.t_us, k * 10)
    assert np.array_equal(events.x, k % 240)
    assert np.array_equal(events.y, k % 180)
    assert np.array_equal(events.p, k % 2)
    assert recording.event_span_us(0) == (0, (count - 1) * 10)
    assert recording.event_count(0) == count


@pytest.mark.parametrize("block_bytes", [1, 20, 1 << 22])
@pytest.mark.parametrize(("fourth", "message"), [
    ("0.4 1 2\n", r"line 4: '0\.4 1 2' is not an event"),
    ("0.2 1 2 0\n", "event.* at 200000 µs comes after one at 300000 µs"),
    ("0.4 240 2 0\n", r"at pixel \(240, 2\) lies outside the 240x180 sensor"),
])  # fmt: skip
def test_damage_is_named_by_its_line_whatever_the_block(
    tmp_path, monkeypatch, fourth, message, block_bytes
):
    """And whatever is asked for: an interval before the damage is refused, too."""
    monkeypatch.setattr(text, "_BLOCK_BYTES", block_bytes)
    lines = "0.1 1 2 1\n0.2 1 2 1\n0.3 1 2 1\n" + fourth + "0.5 1 2 1\n"
    recording = open_recording(miniature(tmp_path / "m", events=lines))
    said = refused(message, recording.events, 0, 0, 150_000)
    # Of events it is the block's first line that is named, and which event of it is meant
    names = ("line 4",) if block_bytes <= 20 else ("line 4", "from line 1 on: event 3 at")
    assert any(name in said for name in names)


def test_whole_times_are_seconds_as_well(tmp_path):
    recording = open_recording(miniature(tmp_path / "m", events="1 1 2 1\n2 3 4 0\n2.5 5 6 1\n"))
    assert recording.events(0, 0, 10**7).t_us.tolist() == [10**6, 2 * 10**6, 2_500_000]


@pytest.mark.parametrize(("part", "text", "words"), [
    *(("events", text, "line 2") for text in (
        "0.1 1 2 1\n0.2 1 2\n", "0.1 1 2 1\n0.2 1 x 0\n", "0.1 1 2 1\n0.2 -1 2 0\n",
        "0.1 1 2 1\n0.2 1.5 2 0\n", "0.1 1 2 1\n0.2 70000 2 0\n")),
    ("events", "", "no events"), ("events", "nan 1 2 1\n", "line 1"),
    ("events", "\x00\xff", "line 1"), ("events", "0.2 1 2 1\n0.1 1 2 0\n", "sort the events"),
    ("events", "0.1 240 2 1\n", "outside the 240x180 sensor"), ("calib", "", "0 numbers"),
    ("calib", "1 2 3", "3 numbers"), ("calib", "a " * 9, "calibration"),
    ("calib", "0 " * 9, "above 0"),
])  # fmt: skip
def test_damaged_events_and_calibration_are_refused(tmp_path, part, text, words):
    folder = miniature(tmp_path / "m", **{part: text})
    refused(words, lambda: open_recording(folder).events(0, 0, 10**7))


def test_unknown_folders_are_named(tmp_path):
    refused("no such folder", open_recording, tmp_path / "nowhere")
    refused("not recognised as a recording", open_recording, tmp_path)
    (tmp_path / "events.txt").write_text("")
    refused(r"lacks calib\.txt", open_recording, tmp_path)
    refused("is a file", open_recording, tmp_path / "events.txt")


def test_the_real_recording_is_read(shared_data):
    recording = open_recording(shared_data / "slider_depth")
    events = recording.events(0, 0, 10**7)
    assert len(events) == 1_078_541
    assert (recording.rig.cameras[0].width_px, recording.rig.cameras[0].height_px) == (240, 180)
    early = len(recording.events(0, 0, recording.trajectory.span_us[0]))
    late = len(recording.events(0, recording.trajectory.span_us[1] + 1, 10**7))
    assert early + late == 3_486
    assert np.linalg.norm(np.diff(recording.trajectory.positions_m[[0, -1]], axis=0)) > 0.97


def test_the_frame_nearest_in_time_is_shown(tmp_path):
    folder = miniature(tmp_path / "m")
    assert open_recording(folder).frame(0, 0) is None
    (folder / "images").mkdir()
    for k in range(3):
        cv2.imwrite(str(folder / "images" / f"{k}.png"), np.full((180, 240), 50 * k, np.uint8))
    (folder / "images.txt").write_text("0.0 images/0.png\n0.1 images/1.png\n\n0.2 images/2.png\n")
    recording = open_recording(folder)
    assert [recording.frame(0, t_us)[0, 0] for t_us in (-5, 120_000, 160_000)] == [0, 50, 100]
    (folder / "images" / "1.png").unlink()
    refused(r"1\.png: cannot be read", recording.frame, 0, 100_000)
    (folder / "images.txt").write_text("0.0\n")
    refused("t_s file", lambda: open_recording(folder).frame(0, 0))
