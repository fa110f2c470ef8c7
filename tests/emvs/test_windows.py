import dataclasses
import errno
import json
import os
import re
import signal
import subprocess
import sys
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import DerivedRecording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.maps.sliding import map_windows
from eventsweep.emvs.maps.store import MapStore, open_store
from eventsweep.emvs.preflight import check_view_fits, need_memory
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.utils.output_manifest import facts_of, listing
from eventsweep.emvs.windows import _every, check_poses, plan_windows
from made_events import events_at, part_of
from places import HELPER_FOLDERS
from point_world import Recorded, fronto_parallel, sideways, stereo_rig
from refusals import all_bytes, refused

ABOUT = RecordingInfo(name="points", path="somewhere/points")
CONFIG = MapperConfig(
    min_depth_m=0.5, max_depth_m=4, planes=20, methods=("Alg1/H",), window_s=0.1, stride_s=0.05,
)  # fmt: skip
WORLD = fronto_parallel(1.5)


def with_(**values):
    return MapperConfig.model_validate(CONFIG.model_dump() | values)


def run(out, config=CONFIG, world=WORLD, **options):
    return map_windows(world, out, config, ABOUT, clouds=False, **options)


# Which windows there are


@settings(max_examples=30)
@given(length=st.integers(1, 499), stride=st.integers(1, 300))
def test_windows_by_time_are_whole_and_evenly_spaced(length, stride):
    plan = plan_windows(WORLD, with_(window_s=length / 1000, stride_s=stride / 1000))
    stretch = plan.stretch
    assert plan.begins_us[0] == stretch.t0_us
    assert set(plan.ends_us - plan.begins_us) == {1000 * length}
    assert set(np.diff(plan.begins_us)) <= {1000 * stride}
    assert plan.ends_us[-1] <= stretch.t1_us < plan.ends_us[-1] + 1000 * stride


@settings(max_examples=30)
@given(length=st.integers(1, 3000), stride=st.integers(1, 2000))
def test_windows_by_count_hold_that_many_events(length, stride):
    world = distinct_times()
    config = with_(window_s=None, stride_s=None, window_events=length, stride_events=stride)
    if length > len(world.streams[0]):
        refused("choose a smaller one", plan_windows, world, config)
        return
    plan = plan_windows(world, config)
    t_us = world.streams[0].t_us
    assert len(plan) == (len(t_us) - length) // stride + 1
    np.testing.assert_array_equal(plan.begins_us, t_us[::stride][: len(plan)])
    for k in (0, len(plan) - 1):
        window = plan.window(k)
        assert len(world.events(0, window.t0_us, window.t1_us)) == length


def distinct_times(n=2500):
    """Two seconds and more, so that counting takes several steps; one event per microsecond."""
    rng = np.random.default_rng(0)
    stream = events_at(rng, np.sort(rng.choice(2_600_000, n, replace=False)), 96, 64)
    camera = Camera(96, 64, 80, 80, 47.5, 31.5)
    trajectory = sideways(duration_us=2_600_000, poses=27)
    return Recorded(stereo_rig(camera), trajectory, (stream, stream))


@given(
    n=st.integers(0, 60), first=st.integers(0, 20), stride=st.integers(1, 20),
    cuts=st.lists(st.integers(0, 60), max_size=4),
)  # fmt: skip
def test_every_nth_event_does_not_depend_on_how_a_stream_is_cut(n, first, stride, cuts):
    t_us = 3 * np.arange(n)
    edges = [0, *sorted(min(cut, n) for cut in cuts), n]
    pieces = [_every(t_us[i:j], i, first, stride) for i, j in pairwise(edges)]
    np.testing.assert_array_equal(np.concatenate(pieces), t_us[first::stride])


def test_each_window_has_a_reference_view_and_a_name_of_its_own():
    plan = plan_windows(WORLD, with_(window_s=0.01, stride_s=0.0003))
    names = [plan.name(k) for k in range(len(plan))]
    assert names == sorted(set(names))
    assert len(names) > 1000
    middle, end = plan_windows(WORLD, CONFIG), plan_windows(WORLD, with_(reference="end"))
    for k in range(len(middle)):
        window = middle.window(k)
        assert window.t_ref_us == (window.t0_us + window.t1_us) // 2
        assert end.window(k).t_ref_us == min(window.t1_us, WORLD.trajectory.span_us[1])


@pytest.mark.parametrize(("values", "words"), [
    ({"window_s": 2.0}, "choose a shorter one"), ({"stride_s": 1e-9}, "at least 1 µs"),
    ({"window_s": 1e-6, "stride_s": 1e-6, "duration_s": None}, "at most 100000"),
    ({"start_s": 9.0}, "choose an earlier start_s"),
    ({"start_s": 0.1, "duration_s": 5.0}, "choose duration_s of at most"),
    ({"window_s": None, "stride_s": None}, "no sliding windows"),
])  # fmt: skip
def test_impossible_windows_are_refused_in_one_line(values, words):
    refused(words, plan_windows, WORLD, with_(**values))


# The run


def test_a_window_of_a_run_is_the_window_mapped_alone(tmp_path):
    info = run(tmp_path / "map")
    for stored in read_map(tmp_path / "map").windows[::3]:
        alone = with_(window_s=None, stride_s=None, start_s=stored.info.t0_us / 1e6, duration_s=0.1)
        first_us = min(WORLD.event_span_us(k)[0] for k in (0, 1))
        alone = alone.model_copy(update={"start_s": (stored.info.t0_us - first_us) / 1e6})
        expected = map_window(WORLD, alone).depth_maps["Alg1/H"]
        found = stored.depth_map("Alg1/H")
        np.testing.assert_array_equal(found.depth_m, expected.depth_m)
        np.testing.assert_array_equal(found.T_world_rv, expected.T_world_rv)
    assert info.complete
    assert info.skipped == ()
    assert len(info.windows) == len(plan_windows(WORLD, CONFIG))


class StopAt:
    """Raises when a run has told so many things: an interrupt at any moment."""

    def __init__(self, calls):
        self.calls = calls

    def __call__(self, _stage, _done, _total):
        self.calls -= 1
        if self.calls == 0:
            raise KeyboardInterrupt


@pytest.mark.parametrize("calls", [1, 2, 5, 17, 40])
def test_an_interrupted_run_is_usable_and_resumes_to_the_same_bytes(tmp_path, calls):
    run(tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "map", progress=StopAt(calls))
    if calls > 5:
        stopped = read_map(tmp_path / "map")
        assert not stopped.info.complete
        assert len(stopped.windows) >= 1
        for window in stopped.windows:
            assert window.depth_map("Alg1/H").points == window.info.points["Alg1/H"]
    before = {
        path: path.stat().st_mtime_ns for path in (tmp_path / "map").glob("w*/Alg1-H/depth.npz")
    }
    run(tmp_path / "map")
    assert all_bytes(tmp_path / "map") == all_bytes(tmp_path / "whole")
    assert all(path.stat().st_mtime_ns == when for path, when in before.items())


KILLED = """
import sys
from pathlib import Path
sys.path[:0] = sys.argv[2:]
import test_windows as t
t.run(Path(sys.argv[1]))
"""


@pytest.mark.slow
def test_a_killed_run_resumes_to_the_same_bytes(tmp_path):
    run(tmp_path / "whole")
    out = tmp_path / "map"
    for finished in (1, 3, 6):
        process = subprocess.Popen(
            [sys.executable, "-c", KILLED, str(out), str(Path(__file__).parent), *HELPER_FOLDERS]
        )
        deadline = time.monotonic() + 120
        while len(list(out.glob("w*"))) < finished and time.monotonic() < deadline:
            time.sleep(0.002)
        os.kill(process.pid, signal.SIGKILL)
        process.wait()
    run(out)
    assert all_bytes(out) == all_bytes(tmp_path / "whole")


def test_what_a_kill_leaves_of_a_window_is_done_anew(tmp_path):
    run(tmp_path / "map")
    whole = all_bytes(tmp_path / "map")
    # As after a kill: the index is old, and one window has no folder.
    index = json.loads((tmp_path / "map" / "map.json").read_text())
    index |= {"windows": [], "complete": False}
    (tmp_path / "map" / "map.json").write_text(json.dumps(index))
    for path in sorted((tmp_path / "map" / "w003").rglob("*"), reverse=True):
        path.rmdir() if path.is_dir() else path.unlink()
    (tmp_path / "map" / "w003").rmdir()
    with listing(tmp_path / "map", {"map.json": facts_of(tmp_path / "map" / "map.json")}):
        pass
    run(tmp_path / "map")
    assert all_bytes(tmp_path / "map") == whole


MOVED = dataclasses.replace(WORLD, trajectory=sideways(speed_m_s=0.5))


@pytest.mark.parametrize(("values", "world", "force", "words"), [
    ({"planes": 21}, WORLD, False, "planes 20, not 21"),
    ({"stride_s": 0.06}, WORLD, False, "stride_s 0.05, not 0.06"),
    ({"hot_pixels": 3.0}, WORLD, False, "hot_pixels 0.0, not 3.0"),
    ({}, MOVED, False, "another recording of the name points"),
    # What suits no window is refused before anything is lost.
    ({"methods": ("Alg1/X",)}, WORLD, True, "Alg1/X"),
    ({"slice_row": 999}, WORLD, True, "slice_row"),
    ({"window_s": 3.0, "duration_s": None}, WORLD, True, "choose a shorter one"),
])  # fmt: skip
def test_a_folder_of_other_settings_is_refused_and_kept(tmp_path, values, world, force, words):
    run(tmp_path / "map", with_(duration_s=0.2))
    before, config = all_bytes(tmp_path / "map"), with_(**({"duration_s": 0.2} | values))
    refused(words, run, tmp_path / "map", config, world, force=force)
    assert all_bytes(tmp_path / "map") == before
    if not force:
        assert run(tmp_path / "map", config, world, force=True).complete


def test_threads_may_change_between_calls(tmp_path):
    run(tmp_path / "map", with_(duration_s=0.2, threads=1))
    before = all_bytes(tmp_path / "map" / "w000")
    assert run(tmp_path / "map", with_(duration_s=0.2, threads=2)).complete
    assert all_bytes(tmp_path / "map" / "w000") == before


def test_a_folder_that_is_no_map_is_refused(tmp_path):
    (tmp_path / "map").mkdir()
    (tmp_path / "map" / "mine.txt").write_text("precious")
    refused("is not a map", run, tmp_path / "map")
    (tmp_path / "file").write_text("")
    refused("is a file", run, tmp_path / "file")


def test_two_processes_never_write_one_folder(tmp_path):
    info = run(tmp_path / "map", with_(duration_s=0.2)).model_copy(update={"windows": ()})
    with open_store(tmp_path / "map", info):
        refused("another process", open_store(tmp_path / "map", info).__enter__)


# Bad windows


def silent_between(world, t0_us, t1_us):
    """The world without the events of camera 1 in a stretch of time."""
    events = world.streams[1]
    kept = part_of(events, (events.t_us < t0_us) | (events.t_us >= t1_us))
    return dataclasses.replace(world, streams=(world.streams[0], kept))


def test_a_run_goes_on_past_windows_with_too_few_events(tmp_path):
    world = silent_between(WORLD, 150_000, 300_000)
    info = run(tmp_path / "map", world=world)
    assert [w.name for w in info.skipped]
    assert len(info.windows) + len(info.skipped) == len(plan_windows(world, CONFIG))
    for window in info.skipped:
        assert (window.t0_us, window.t1_us) >= (100_000, 200_000)
        assert "cam1" in window.reason
        assert "none of which can vote" in window.reason
        assert "\n" not in window.reason
        assert not (tmp_path / "map" / window.name).exists()
    # A window that is not touched is the same as ever.
    run(tmp_path / "clean")
    assert all_bytes(tmp_path / "map" / "w000") == all_bytes(tmp_path / "clean" / "w000")


def test_the_least_number_of_events_is_a_setting(tmp_path):
    counts = [w.counts["cam0"]["voting"] for w in run(tmp_path / "a").windows]
    least = sorted(counts)[len(counts) // 2]
    info = run(tmp_path / "b", with_(min_events=least))
    both = {w.name: w.counts for w in read_map(tmp_path / "a").info.windows}
    enough = [n for n, c in both.items() if min(c[k]["voting"] for k in ("cam0", "cam1")) >= least]
    assert [w.name for w in info.windows] == enough
    assert all(f"at least {least}" in w.reason for w in info.skipped)


def with_gap(t0_us, t1_us, duration_us=500_000):
    dense = sideways(0.8, duration_us, 101)
    kept = (dense.t_us <= t0_us) | (dense.t_us >= t1_us)
    trajectory = Trajectory(dense.t_us[kept], dense.positions_m[kept], dense.quats_xyzw[kept])
    return dataclasses.replace(WORLD, trajectory=trajectory)


def test_a_run_goes_on_past_windows_without_poses(tmp_path):
    world = with_gap(200_000, 270_000)
    info = run(tmp_path / "map", world=world)
    for window in info.skipped:
        assert "no pose for 0.07 s (200000..270000 µs)" in window.reason
        assert window.t0_us < 270_000
        assert window.t1_us > 200_000
    for window in info.windows:
        assert window.t1_us <= 200_000 + 1 or window.t0_us >= 270_000
    assert info.skipped
    assert not run(tmp_path / "allowed", with_(max_pose_gap_s=0.1), world).skipped


def test_a_single_window_without_poses_is_refused():
    config = with_(window_s=None, stride_s=None)
    refused(r"no pose for 0\.07 s", map_window, with_gap(200_000, 270_000), config)


@given(
    steps=st.lists(st.integers(1, 400_000), min_size=1, max_size=20),
    t0=st.integers(0, 10**6), length=st.integers(1, 10**6),
)  # fmt: skip
def test_gaps_are_found_where_they_overlap_the_window(steps, t0, length):
    t_us = np.r_[0, np.cumsum(steps)]
    t0_us = min(t0, int(t_us[-1]) - 1)
    t1_us = min(t0_us + length, int(t_us[-1]) + 1)
    n = len(t_us)
    trajectory = Trajectory(t_us, np.zeros((n, 3)), np.tile([0.0, 0, 0, 1], (n, 1)))
    config = with_(max_pose_gap_s=0.1)
    # Naively: some instant of the window, poses aside, lies within a gap that is too long.
    gaps = [(a, b) for a, b in pairwise(t_us) if b - a > 100_000]
    bad = any(max(a + 1, t0_us) <= min(b - 1, t1_us - 1) for a, b in gaps)
    if bad:
        refused("no pose for", check_poses, trajectory, t0_us, t1_us, config)
    else:
        check_poses(trajectory, t0_us, t1_us, config)


def test_a_run_without_a_single_good_window_says_why(tmp_path):
    words = r"none of 8 windows could be mapped; w000: camera cam0"
    refused(words, run, tmp_path / "map", with_(min_events=10**6))
    info = read_map(tmp_path / "map").info
    assert (len(info.windows), len(info.skipped)) == (0, 8)


FULL = {
    "disk": (OSError(errno.ENOSPC, "No space left on device"), "no space left on device, "),
    "quota": (OSError(errno.EDQUOT, "Disk quota exceeded"), "disk quota exceeded"),
    "file": (OSError(errno.EFBIG, "File too large"), "file too large"),
    "numpy": (OSError("4096 requested and 0 written"), "no space left on device, "),
}  # fmt: skip


@pytest.mark.parametrize("stage", ["window", "index", "report"])
@pytest.mark.parametrize("full", FULL)
@pytest.mark.parametrize("force", [False, True])
def test_a_full_disk_stops_sliding_windows_which_go_on_later(
    tmp_path, monkeypatch, full, stage, force
):
    """It is no fault of one window, which would be left out, and of the next and the next."""
    run(tmp_path / "whole", finish=report_into)
    out, (error, words), write = tmp_path / "map", FULL[full], np.savez

    def fail(*_):
        raise error

    def savez(path, **arrays):
        fail() if "w002" in str(path) else write(path, **arrays)

    if force:
        run(out, with_(median_px=3))
    done, finish = (8, fail) if stage == "report" else (2, report_into)
    if stage != "report":
        monkeypatch.setattr(np, "savez", savez)
    if stage == "index":
        index = MapStore.write_index  # the first one is there before any window

        def write_index(self, head, names):
            fail() if self.has("w001") else index(self, head, names)

        monkeypatch.setattr(MapStore, "index_is_due", False)
        monkeypatch.setattr(MapStore, "write_index", write_index)
    said = refused(f"{words}.*; {done} of 8 windows", run, out, force=force, finish=finish)
    assert said.count("make room, and the same again goes on") == 1
    assert str(tmp_path) in said
    monkeypatch.undo()
    run(out, force=force, finish=report_into)
    assert all_bytes(out) == all_bytes(tmp_path / "whole")
    assert {path.name for path in tmp_path.iterdir()} == {"whole", "map"}


def report_into(folder):
    (folder / "report.html").write_text("report")


# One window alone

ONE = {"window_s": None, "stride_s": None, "start_s": 0.1, "duration_s": 0.2}


def test_a_single_window_has_the_maps_of_the_same_sliding_window(tmp_path):
    """Both go the same way; only what belongs to a run that may be taken up again is not there."""
    run(tmp_path / "one", with_(**ONE))
    run(tmp_path / "sliding", with_(start_s=0.1, duration_s=0.2, window_s=0.2, stride_s=None))
    one, sliding = (all_bytes(tmp_path / name) for name in ("one", "sliding"))
    assert set(sliding) - set(one) == {"w000/window.json", "w000/.eventsweep.json"}
    arrays = [name for name in one if name.endswith(".npz")]
    assert arrays
    assert all(one[name] == sliding[name] for name in arrays)
    info = read_map(tmp_path / "one").info
    assert info.windows == read_map(tmp_path / "sliding").info.windows
    assert (info.recording_sha256, info.without_pose, info.complete) == (None, {}, True)


@pytest.mark.parametrize("error", [KeyboardInterrupt, InputError, MemoryError])
@pytest.mark.parametrize("stage", ["sweep", "write", "finish"])
def test_a_single_window_that_does_not_get_done_leaves_nothing(tmp_path, stage, error):
    def progress(now, done, total):
        if now == stage:
            raise error("stopped")

    def finish(folder):
        assert (folder / "map.json").is_file()
        progress("finish", 0, 1)

    with pytest.raises(error, match="stopped"):
        run(tmp_path / "map", with_(**ONE), progress=progress, finish=finish)
    assert list(tmp_path.iterdir()) == []


def test_a_single_window_never_takes_the_place_of_another_unasked(tmp_path):
    run(tmp_path / "map", with_(**ONE))
    before = all_bytes(tmp_path)
    refused("set force=True to replace it", run, tmp_path / "map", with_(**ONE))
    assert all_bytes(tmp_path) == before
    run(tmp_path / "map", with_(**ONE), force=True)
    assert all_bytes(tmp_path) == before


def test_a_recording_that_knows_its_length_is_not_read_to_be_counted(tmp_path):
    """Nor is one that was made from it."""
    read = []

    class Counting(DerivedRecording):
        def events(self, camera, t0_us, t1_us):
            read.append(camera)
            return super().events(camera, t0_us, t1_us)

    class Stored(Recorded):
        def event_count(self, camera):
            return len(self.streams[camera])

    stored = Stored(WORLD.rig, WORLD.trajectory, WORLD.streams)
    run(tmp_path / "map", with_(**ONE), Counting(stored))
    assert read == [0, 1]


# Memory


def test_volumes_that_the_disk_cannot_hold_name_it_and_what_is_free(tmp_path, monkeypatch):
    monkeypatch.setattr("eventsweep.emvs.preflight.free_bytes", lambda _: 4096)
    out = tmp_path / "not" / "there"
    config = CONFIG.model_copy(update={"save_dsi": True})
    words = rf"{re.escape(str(out))}: save_dsi of .* needs [\d.]+ MB, 4.1 kB are free on that disk"
    refused(words, check_view_fits, reference_view(WORLD, config, 0), 8, config, out)


def test_what_cannot_be_held_is_refused(tmp_path):
    words = r"a lot needs at least 1 EB of memory.*: take less"
    refused(words, need_memory, 10**18, "a lot", "take less")
    need_memory(1, "nothing", "")
    config = with_(planes=100_000, view_width_px=32768, view_height_px=32768, save_dsi=True)
    view = reference_view(WORLD, config, 0)
    refused("lower the planes", check_view_fits, view, 1, config, tmp_path / "not" / "there")
    check_view_fits(reference_view(WORLD, CONFIG, 0), 8, CONFIG, tmp_path)


LONG = """
import shutil
import sys
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import RecordingInfo
from eventsweep.emvs.maps.sliding import map_windows

SECONDS, PER_SECOND, POINTS = 60, 400_000, 4000
CAMERA = Camera(1280, 720, 1050, 1050, 639.5, 359.5)
T_body_right = np.eye(4)
T_body_right[0, 3] = 0.12


class Long:
    name, depth_range_m = "long", (0.45, 4.0)
    rig = Rig("pair", (CAMERA, CAMERA), (np.eye(4), T_body_right))
    t_us = np.arange(0, SECONDS * 1_000_000 + 1, 10_000)
    path_m = np.stack([0.2 * np.sin(t_us * 2e-6), 0 * t_us, 0 * t_us], axis=1)
    trajectory = Trajectory(t_us, path_m, np.tile([0.0, 0, 0, 1], (len(t_us), 1)))
    points = np.random.default_rng(0).uniform((-2, -1, 0.8), (2, 1, 3.5), (POINTS, 3))

    def event_span_us(self, camera):
        return 0, SECONDS * 1_000_000 - 1

    def events(self, camera, t0_us, t1_us):
        t_us = np.arange(t0_us, t1_us, 1_000_000 // PER_SECOND + 1)
        which = self.points[t_us * 7919 % POINTS]
        x_m = which[:, 0] - 0.2 * np.sin(t_us * 2e-6) - 0.12 * camera
        u = np.rint(1050 * x_m / which[:, 2] + 639.5)
        v = np.rint(1050 * which[:, 1] / which[:, 2] + 359.5)
        seen = (u >= 0) & (u < 1280) & (v >= 0) & (v < 720)
        t_us, u, v = t_us[seen], u[seen].astype(np.uint16), v[seen].astype(np.uint16)
        return Events(u, v, t_us, (t_us % 2).astype(np.uint8))


def peak_mb():
    (line,) = [one for one in open("/proc/self/status") if one.startswith("VmHWM:")]
    return int(line.split()[1]) / 1024


out, peaks = Path(sys.argv[1]), {}


def progress(stage, done, total):
    if stage != "windows":
        return
    peaks[done] = peak_mb()
    # The disk of a test is small: of a finished window only its entry stays.
    for path in (out / f"w{done - 1:03d}").glob("*"):
        if path.is_dir():
            shutil.rmtree(path)
        elif path.name != "window.json":
            path.unlink()


config = MapperConfig(
    planes=30, methods=("Alg1/H",), window_s=1, stride_s=0.5, hot_pixels=3, threads=1
)
info = map_windows(Long(), out, config, RecordingInfo(name="long", path="long"), progress)
assert len(info.windows) == 119, info.skipped
assert min(w.points["Alg1/H"] for w in info.windows) > 100
print(peaks[5], peaks[60], peaks[119])
"""


@pytest.mark.slow
def test_a_minute_of_sliding_windows_takes_no_more_memory_than_its_first_half(tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", LONG, str(tmp_path / "map")],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    _, half_mb, end_mb = map(float, done.stdout.split())
    assert end_mb < half_mb + 15, done.stdout
