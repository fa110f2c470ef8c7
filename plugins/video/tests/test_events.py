"""`eventsweep events`: what it takes, what it prints, what it refuses in one line."""

import json

import numpy as np
import pytest

from eventsweep.eval.cli.main import main
from refusals import command_refused, untouched
from video_files import drifting, events_of, rows, write_folder, write_video

SECONDS = [f"{k / 20:.2f}" for k in range(6)]


@pytest.fixture
def here(tmp_path, monkeypatch):
    """A folder with a video, images with times, and much that is wrong."""
    monkeypatch.chdir(tmp_path)
    frames, colour = drifting(6), drifting(6, 64, 48, colour=True)
    for name, stamps in {"images": SECONDS, "timeless": None, "whole": range(6)}.items():
        write_folder(tmp_path / name, frames, stamps)
    write_folder(tmp_path / "empty", [np.zeros((0, 4), np.uint8)] * 6, SECONDS, ".npy")
    (tmp_path / "void").mkdir()
    write_video(tmp_path / "v.avi", colour)
    (tmp_path / "broken.mp4").write_bytes(b"\0\0\0\x18ftypmp42" + bytes(300))
    (tmp_path / "stream.mjpeg").write_bytes(b"\xff\xd8\xff\xe0" + bytes(100))
    (tmp_path / "poses.txt").write_text("0 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n")
    return tmp_path


REFUSED = [
    ("timeless", "no times; add timestamps.txt"), ("timeless", "add --rate-hz"),
    ("whole", "say --unit s, ms, us or ns"), ("void --rate-hz 30", "0 images"),
    ("empty", "4x0 pixels"), ("broken.mp4", "no codec"),
    ("stream.mjpeg", "no time base in its video stream; add --rate-hz"),
    ("images --encoding rec709", "rec709"), ("images --encoding log", "cannot hold logarithms"),
    ("images --upsample nothing", "MODULE:FUNCTION"),
    ("images --poses poses.txt", "but no calibration"), ("images --calibration v.avi", "v.avi"),
    ("images --to dat", "cannot be written"), ("images --seed -1", "seed -1"),
    ("images --sim.sensor.preset gen5", "gen5"),
    ("images --sim.supersample 2", "--sim.supersample"), ("images --workers 2", "--workers"),
]  # fmt: skip


@pytest.mark.parametrize(("words", "message"), REFUSED)
def test_bad_input_is_one_line_and_code_2(here, capfd, words, message):
    with untouched(here):
        said = command_refused(capfd, "events", *words.split(), "--out", "o", errno=True)
    assert message in said


def test_the_summary_says_what_was_taken_for_granted_or_is_for_programs(here, capsys):
    assert main(["events", "v.avi", "--out", "o"]) == 0
    out = capsys.readouterr().out.splitlines()
    count = len(events_of(here / "o"))
    assert out[0] == f"{count:,} events of 6 frames, 64x48 px, in 0.2 s, o"
    assert out[1].startswith("times: the file's own, 25 Hz on average; values: srgb; ")
    assert out[1].endswith("% fewer events at half the frame rate")
    words = ["events", "images", "--out", "o.npz", "--json", "--encoding", "gamma", "--gamma", "2"]
    assert main(words) == 0
    out, err = capsys.readouterr()
    facts = json.loads(out)
    assert (facts["format"], facts["encoding"]) == ("npz", "gamma 2")
    assert facts["events"] == len(events_of(here / "o.npz"))
    assert (facts["span_us"], err) == ([0, 250_000], "")


def test_notes_are_told_however_quiet(here, capsys):
    write_folder(here / "fast", drifting(16, step_px=9), np.arange(16) + 0.5)
    (here / "fast" / "readme.md").write_text("x")
    assert main(["events", "fast", "--out", "o", "--quiet"]) == 0
    out, err = capsys.readouterr()
    assert out == ""
    first, second = err.splitlines()
    assert first == "note: fast: no images, left out: readme.md"
    assert second.startswith("note: fast: without every second frame ")


def test_sensor_flags_files_and_seeds_are_heeded(here):
    """As of `simulate`: a flag beats the file, and a preset sets thresholds not given."""
    (here / "s.toml").write_text("[sim]\ncontrast_threshold_pos = 0.3\n[sim.sensor]\npreset='gen4'")
    made = {}
    for name, words in {
        "file": ["--config", "s.toml"],
        "flags": ["--sim.contrast-threshold-pos", "0.3", "--sim.sensor.preset", "gen4"],
        "both": ["--config", "s.toml", "--sim.contrast-threshold-pos", "0.15"],
        "seed": ["--config", "s.toml", "--seed", "7"],
    }.items():
        assert main(["events", "images", "--out", name, "--quiet", *words]) == 0
        made[name] = rows(events_of(here / name))
    assert made["file"] == made["flags"]
    assert len(made["both"]) > len(made["file"])
    assert made["seed"] != made["file"]
    manifest = json.loads((here / "both" / "manifest.json").read_text())
    assert manifest["configuration"]["contrast_threshold_pos"] == 0.15
    assert manifest["configuration"]["refractory_period_us"] == 100


def test_an_interpolator_of_ones_own(here, capsys):
    (here / "mine.py").write_text(
        "def middle(a, b, t0_us, t1_us):\n    yield (t0_us + t1_us) // 2, a // 2 + b // 2\n"
    )
    words = ["events", "v.avi", "--out", "o", "--upsample", "mine.py:middle", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == 11
