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
from eventsweep.eval.scoring.results import read_results

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


def map_into(out, sequence, *flags):
    return main(["map", str(sequence), "--out", str(out), "--method", "Alg1/H", *SLIDING, *flags])


def test_every_window_is_a_window_of_the_map(mapped):
    stored = read_map(mapped)
    assert [w.info.t0_us for w in stored.windows] == [0, 20_000, 40_000, 60_000]
    assert [w.info.t_ref_us for w in stored.windows] == [20_000, 40_000, 60_000, 80_000]
    assert (mapped / "report.html").is_file()
    assert (mapped / "w003" / "Alg1-H" / "cloud.ply").is_file()


def test_the_same_command_again_changes_nothing_and_says_what_there_is(mapped, sequence, capsys):
    before = {path: path.stat().st_mtime_ns for path in mapped.glob("w*/**/*.npz")}
    assert map_into(mapped, sequence, "--json") == 0
    facts = json.loads(capsys.readouterr().out)
    assert (len(facts["windows"]), facts["skipped"], facts["complete"]) == (4, [], True)
    assert {path: path.stat().st_mtime_ns for path in mapped.glob("w*/**/*.npz")} == before


def test_other_settings_are_one_line_and_exit_code_2(mapped, sequence, capsys):
    assert map_into(mapped, sequence, "--quiet", "--map.median-px", "3") == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_bad_windows_are_told_at_the_end_and_are_no_success(mapped, sequence, tmp_path, capsys):
    counts = [
        min(camera["voting"] for camera in window.counts.values())
        for window in read_map(mapped).info.windows
    ]
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
    assert map_into(tmp_path / "none", sequence, "--map.min-events", "99999999", "--quiet") == 2
    assert "none of 4 windows could be mapped" in capsys.readouterr().err


def test_windows_without_truth_are_left_out_and_counted(mapped, capsys):
    assert main(["score", str(mapped)]) == 0
    told = " ".join(capsys.readouterr().out.split())
    assert "2 of 4 windows scored: 2 have no ground truth" in told
    results = read_results(mapped)
    assert set(results.rows["window"]) == {"w001", "w003", "all", "mean"}
    assert results.configuration["planes"]["windows"] == {"scored": 2, "without_truth": 2}


def test_no_window_with_truth_is_an_error(sequence, tmp_path, capsys):
    assert map_into(tmp_path / "map", sequence, "--quiet", "--map.start-s", "0.001") == 0
    assert main(["score", str(tmp_path / "map"), "--quiet"]) == 2
    error = capsys.readouterr().err
    assert "21000" in error
    assert error.count("\n") == 1


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
    assert main(["fuse", str(mapped), "--min-windows", "9", "--quiet"]) == 2
    assert "lower min_windows" in capsys.readouterr().err


def test_a_camera_without_calibration_is_refused_in_one_line(sequence, tmp_path):
    values = json.loads((sequence / "rig.json").read_text())
    del values["cameras"][1]["fx_px"]
    with pytest.raises(InputError, match="fx_px") as error:
        Rig.from_json(values)
    assert "\n" not in str(error.value)
    for name in ("events.txt", "groundtruth.txt"):
        (tmp_path / name).write_text("")
    with pytest.raises(InputError, match=r"lacks calib\.txt"):
        open_recording(tmp_path)


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


def test_a_map_without_a_window_yet_cannot_be_scored_or_reported(mapped, tmp_path, capsys):
    (tmp_path / "map").mkdir()
    index = json.loads((mapped / "map.json").read_text()) | {"windows": [], "complete": False}
    (tmp_path / "map" / "map.json").write_text(json.dumps(index))
    for verb in ("score", "report", "fuse"):
        assert main([verb, str(tmp_path / "map"), "--quiet"]) == 2
        assert "holds no window yet" in capsys.readouterr().err


@pytest.mark.slow
def test_twice_as_many_windows_leave_the_report_as_large(sequence, tmp_path):
    """From as many as its film shows."""
    sizes = []
    for stride_s, least in (("0.0036", 25), ("0.0018", 50)):
        out = tmp_path / stride_s
        flags = (
            "--quiet",
            "--map.planes",
            "10",
            "--map.window-s",
            "0.01",
            "--map.stride-s",
            stride_s,
        )
        assert main(["map", str(sequence), "--out", str(out), "--method", "Alg1/H", *flags]) == 0
        assert len(read_map(out).windows) >= least
        sizes.append((out / "report.html").stat().st_size)
    assert sizes[1] < 1.1 * sizes[0]
