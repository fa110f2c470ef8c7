"""A whole sequence by the command line: sliding windows, scores, report, global cloud."""

import json
from contextlib import contextmanager

import pytest

from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.hot_pixels import find_hot_pixels
from eventsweep.emvs.maps.folder import read_map
from eventsweep.eval.cli.main import main
from eventsweep.eval.progress import MapBars
from eventsweep.eval.results.results import read_results
from refusals import command_refused, line_of

pytestmark = pytest.mark.usefixtures("blank_figures")

SLIDING = ("--map.window-s", "0.04", "--map.stride-s", "0.02", "--map.planes", "20")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    path = tmp_path_factory.mktemp("sequence") / "planes"
    arguments = ["simulate", "planes", "--out", str(path), "--seconds", "0.1", "--rig", "rpg"]
    assert main([*arguments, "--quiet", "--sim.truth-interval-s", "0.04"]) == 0
    return path


@pytest.fixture(scope="module")
def mapped(sequence):
    out = sequence.parent / "map"
    assert map_into(out, sequence, "--quiet") == 0
    return out


def mapping(out, sequence, *flags):
    words = ["map", sequence, "--out", out, "--method", "Alg1/H", *SLIDING, *flags]
    return [str(word) for word in words]


def map_into(*places):
    return main(mapping(*places))


def test_every_window_is_one_of_the_map_and_the_same_command_changes_nothing(
    mapped, sequence, capsys
):
    stored = read_map(mapped)
    assert [w.info.t0_us for w in stored.windows] == [0, 20_000, 40_000, 60_000]
    assert [w.info.t_ref_us for w in stored.windows] == [20_000, 40_000, 60_000, 80_000]
    assert (mapped / "report.html").is_file()
    assert (mapped / "w003" / "Alg1-H" / "cloud.ply").is_file()
    before = {path: path.stat().st_mtime_ns for path in mapped.glob("w*/**/*.npz")}
    assert map_into(mapped, sequence, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert (len(facts["windows"]), facts["skipped"], facts["complete"]) == (4, [], True)
    assert {path: path.stat().st_mtime_ns for path in mapped.glob("w*/**/*.npz")} == before


def test_other_settings_or_a_camera_without_calibration_are_one_line(
    mapped, sequence, capsys, tmp_path
):
    command_refused(capsys, *mapping(mapped, sequence, "--quiet", "--map.median-px", "3"))
    values = json.loads((sequence / "rig.json").read_text())
    del values["cameras"][1]["fx_px"]
    assert "fx_px" in line_of(Rig.from_json, values)
    for name in ("events.txt", "groundtruth.txt"):
        (tmp_path / name).write_text("")
    assert "lacks calib.txt" in line_of(open_recording, tmp_path)


@pytest.mark.slow
def test_bad_windows_are_told_at_the_end_and_are_no_success(mapped, sequence, tmp_path, capsys):
    windows = read_map(mapped).info.windows
    counts = [min(camera["voting"] for camera in one.counts.values()) for one in windows]
    least = str(sorted(counts)[2])
    assert map_into(tmp_path / "map", sequence, "--map.min-events", least) == 1
    told, errors = capsys.readouterr()
    line = errors.splitlines()[-1]  # below the bars
    assert line.startswith("eventsweep: 2 of 4 windows could not be mapped (w0")
    assert "--allow-skipped" in line
    again = ("--map.min-events", least, "--allow-skipped", "--quiet")
    assert map_into(tmp_path / "map", sequence, *again) == 0
    assert "2 of 4 windows could not be mapped" in told
    assert f"at least {least}" in " ".join(told.split())
    none = mapping(tmp_path / "none", sequence, "--map.min-events", "99999999", "--quiet")
    assert "none of 4 windows could be mapped" in command_refused(capsys, *none)


def test_windows_without_truth_are_left_out_and_counted_unless_none_has_any(
    mapped, capsys, sequence, tmp_path
):
    assert main(["score", str(mapped)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "2 of 4 windows scored: 2 have no ground truth" in told
    results = read_results(mapped)
    assert set(results.rows["window"]) == {"w001", "w003", "all", "mean"}
    assert results.configuration["planes"]["windows"] == {"scored": 2, "without_truth": 2}
    assert map_into(tmp_path / "map", sequence, "--quiet", "--map.start-s", "0.001") == 0
    assert "21000" in command_refused(capsys, "score", tmp_path / "map", "--quiet")


def test_no_pixel_of_a_clean_simulation_is_hot(sequence):
    recording = open_recording(sequence)
    t0_us, t1_us = recording.event_span_us(0)
    for span in ((t0_us, t1_us + 1), (t0_us, t0_us + 20_000)):
        assert [found.pixels for found in find_hot_pixels(recording, *span, 3.0)] == [0, 0]


def test_fuse_joins_the_windows(mapped, capsys):
    assert main(["fuse", str(mapped), "--voxel-m", "0.02", "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["windows"] == 4
    assert 0 < facts["points"] < facts["window_points"]
    assert (mapped / "global" / "Alg1-H" / "cloud.ply").is_file()
    said = command_refused(capsys, "fuse", mapped, "--min-windows", "9", "--quiet")
    assert "lower min_windows" in said


class Recorder:
    """Progress that writes down what it is shown."""

    def __init__(self):
        self.seen = []

    @contextmanager
    def stage(self, title, total):
        self.seen.append(f"begin {title}")
        yield lambda share, words: self.seen.append((round(share, 3), words))
        self.seen.append(f"end {title}")


def test_bars_of_sliding_windows_and_of_one():
    many, one = Recorder(), Recorder()
    with MapBars(many, "map x") as bars:
        for step in (("count", 0, 9), ("windows", 1, 4), ("sweep", 1, 2), ("write", 0, 1)):
            bars(*step)
        bars.close()
        assert many.seen[-1] == "end map x"
    words = "1 of 4 windows"
    assert many.seen == [
        "begin map x", (0.0, "count 0/9"), (0.25, words), (0.388, words), (0.5, words), "end map x",
    ]  # fmt: skip
    with MapBars(one, "map x") as bars:
        for step in (("hot pixels", 1, 2), ("rays", 1, 2), ("sweep", 1, 2), ("write", 0, 1)):
            bars(*step)
    assert one.seen == [
        "begin map x", (0.0, "hot pixels 1/2"), (0.05, "rays 1/2"), (0.55, "sweep 1/2"),
        "end map x", "begin write maps", "end write maps",
    ]  # fmt: skip
    with pytest.raises(InputError), MapBars(one, "map y"):
        raise InputError("no")
    assert one.seen[-1] == "begin map y"


@pytest.mark.parametrize("verb", ["score", "report", "fuse"])
def test_a_map_without_a_window_yet_cannot_be_scored_or_reported(mapped, tmp_path, capsys, verb):
    index = json.loads((mapped / "map.json").read_text()) | {"windows": [], "complete": False}
    (tmp_path / "map.json").write_text(json.dumps(index))
    assert "holds no window yet" in command_refused(capsys, verb, tmp_path, "--quiet")


@pytest.mark.slow
def test_twice_as_many_windows_leave_the_report_as_large(sequence, tmp_path):
    """From as many as its film shows."""
    sizes = []
    for stride_s, least in (("0.0036", 25), ("0.0018", 50)):
        out, flags = tmp_path / stride_s, ["--map.window-s", "0.01", "--map.planes", "10"]
        words = ["map", str(sequence), "--out", str(out), "--method", "Alg1/H", "--quiet", *flags]
        assert main([*words, "--map.stride-s", stride_s]) == 0
        assert len(read_map(out).windows) >= least
        sizes.append((out / "report.html").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]
