"""Videos as sequences and as files of events: whole, streamed, and what can be done with them."""

import json
import re
import subprocess
import sys
from http.server import BaseHTTPRequestHandler, HTTPServer
from threading import Thread

import numpy as np
import pytest

import eventsweep as es
from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.main import main
from eventsweep.plugins.video.frames import open_frames
from eventsweep.plugins.video.record import View, format_of, record
from eventsweep.sim.config import PixelConfig, SimConfig, VideoConfig
from eventsweep.sim.parallel import sensors
from eventsweep.sim.sensor.sensor import Sensor
from eventsweep.sim.sensor_presets import SensorConfig
from refusals import refused
from video_files import drifting, events_of, rows, write_folder, write_video

SECONDS = [f"{k / 20:.2f}" for k in range(10)]
NOISY = PixelConfig(sensor=SensorConfig(preset="davis346", latency_us=300))
WRITTEN = [name for name, one in FORMATS.items() if one.writes]


@pytest.fixture
def folder(tmp_path):
    return write_folder(tmp_path / "in", drifting(10), SECONDS)


def made(source, out, pixels=None, **options):
    return record(source, out, pixels or PixelConfig(), VideoConfig(), **options)


def test_a_sequence_without_poses_opens_and_tells_so(tmp_path, folder):
    told = made(folder, tmp_path / "seq")
    sequence = es.Sequence(told.path)
    assert told.facts()["path"] == str(tmp_path / "seq")
    assert sequence.event_count(0) == told.events == len(events_of(told.path)) > 1000
    assert sequence.event_span_us(0) == told.span_us == (0, 450_000)
    assert sequence.rig.name == "uncalibrated"
    assert not sequence.has_poses
    assert "no poses" in repr(sequence)
    assert len(sequence.truth_times_us(0)) == 0
    sequence.verify()
    with pytest.raises(InputError, match="has no poses"):
        sequence.trajectory  # noqa: B018
    refused("has no poses", es.map_window, sequence)
    refused("has no poses", es.map_windows, sequence.path, tmp_path / "map")
    assert not (tmp_path / "map").exists()


@pytest.mark.slow
def test_the_manifest_says_what_was_taken_for_granted(tmp_path, folder):
    made(folder, tmp_path / "seq", NOISY, seed=5)
    manifest = json.loads((tmp_path / "seq" / "manifest.json").read_text())
    assert manifest["seed"] == 5
    assert manifest["renderer"] == "video in"
    assert manifest["configuration"]["contrast_threshold_neg"] == 0.225
    assert manifest["configuration"]["video"]["encoding"] == "srgb"
    assert manifest["configuration"]["video"]["full_scale"] == 255
    assert manifest["configuration"]["video"]["time_base"] == "timestamps.txt in s"


def test_equal_runs_give_equal_bytes(tmp_path, folder):
    for name in "ab":
        made(folder, tmp_path / name, NOISY, seed=1)
    digests = {es.Sequence(tmp_path / name).manifest.digest() for name in "ab"}
    assert len(digests) == 1


def test_noise_has_labels_and_counts(tmp_path, folder):
    told = made(folder, tmp_path / "seq", NOISY)
    sequence = es.Sequence(told.path)
    labels = sequence.labels(0, told.span_us[0], told.span_us[1] + 1)
    counts = sequence.sensor_counts(0)
    assert np.bincount(labels, minlength=4).tolist() == [
        counts[name] for name in ("signal", "leak", "shot", "hot")
    ]
    assert counts["shot"] > 0
    assert counts["dropped_after_end"] > 0


@pytest.mark.parametrize("name", WRITTEN)
def test_every_format_holds_the_same_events(tmp_path, folder, name):
    made(folder, tmp_path / "seq")
    out = tmp_path / f"events{FORMATS[name].suffix}"
    told = made(folder, out, to=name)
    assert rows(events_of(out)) == rows(events_of(tmp_path / "seq"))
    assert told.format == name
    assert main(["convert", str(tmp_path / "seq"), str(tmp_path / "again"), "--to", name]) == 0
    assert rows(events_of(tmp_path / "again")) == rows(events_of(out))


@pytest.mark.parametrize(("out", "format_"), [
    ("seq", "sequence"), ("my.seq", "sequence"), ("a.h5", "dsec"), ("a.AEDAT4", "aedat4"),
    ("a.raw", "evt2"), ("a.csv", "csv"), ("a.npz", "npz"), ("a.bag", "rosbag1"),
])  # fmt: skip
def test_the_name_says_the_format(tmp_path, out, format_):
    assert format_of(tmp_path / out) == format_
    assert format_of(tmp_path / out, "sequence") == "sequence"


def test_formats_that_cannot_be_written_are_refused(tmp_path, folder):
    with pytest.raises(InputError, match=r"'dat' cannot be written: choose one of sequence, evt2"):
        made(folder, tmp_path / "a.dat", to="dat")


def test_info_and_convert_know_a_sequence_of_a_video(tmp_path, folder, capsys):
    made(folder, tmp_path / "seq")
    readable = open_readable(tmp_path / "seq")
    assert readable.what == "sequence of eventsweep; no poses"
    assert main(["info", str(tmp_path / "seq"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["streams"][0]["sensor_px"] == [40, 30]
    assert main(["convert", str(tmp_path / "seq"), str(tmp_path / "c"), "--to", "tumvie"]) == 0
    assert (tmp_path / "c").is_file()
    assert main(["convert", str(tmp_path / "seq"), str(tmp_path / "r"), "--to", "rig"]) == 0
    assert main(["convert", str(tmp_path / "seq"), str(tmp_path / "s"), "--to", "sequence"]) == 0
    assert not open_recording(tmp_path / "s").has_poses
    assert main(["convert", str(tmp_path / "seq"), str(tmp_path / "n"), "--to", "nerfstudio"]) == 2
    assert "has no poses" in capsys.readouterr().err


class Watched(Sensor):
    """A sensor that keeps the frames of camera 0 that it is shown."""

    shown: list = []  # noqa: RUF012

    def __init__(self, camera_index, *args, **kwargs):
        super().__init__(camera_index, *args, **kwargs)
        self._first = camera_index == 0

    def start(self, intensity, t_us):
        self._keep(intensity, t_us)
        super().start(intensity, t_us)

    def step(self, intensity, t_us):
        self._keep(intensity, t_us)
        return super().step(intensity, t_us)

    def _keep(self, intensity, t_us):
        if self._first:
            self.shown.append((t_us, intensity.copy()))


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A simulation of straight lines between frames, and the frames as a folder of floats."""
    place = tmp_path_factory.mktemp("rendered")
    config = {"sampling": "linear", "duration_s": 0.06, "truth_interval_s": 0.03}
    noisy = SimConfig(**config, sensor=SensorConfig(preset="davis346"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(sensors, "Sensor", Watched)
        Watched.shown = []
        es.simulate("planes", place / "ideal", SimConfig(**config), seed=2)
        shown, Watched.shown = Watched.shown, []
        es.simulate("planes", place / "noisy", noisy, seed=2)
    times_us, frames = zip(*shown, strict=True)
    write_folder(place / "frames", frames, suffix=".npy")
    lines = "".join(f"{t} {k}.npy\n" for k, t in enumerate(times_us))
    (place / "frames" / "images.txt").write_text(f"# us\n{lines}")
    rig = es.Sequence(place / "ideal").rig
    (place / "rig.json").write_text(json.dumps(rig.to_json()))
    return place


@pytest.mark.parametrize(("name", "preset"), [("ideal", "ideal"), ("noisy", "davis346")])
def test_rendered_frames_give_the_events_of_the_simulation(tmp_path, rendered, name, preset):
    pixels = PixelConfig(sensor=SensorConfig(preset=preset))
    video = VideoConfig(unit="us")
    told = es.video_to_events(rendered / "frames", tmp_path / "out", pixels, video, seed=2)
    simulated = events_of(rendered / name)
    assert told.frames > 15
    assert told.encoding == "linear"
    assert rows(events_of(tmp_path / "out")) == rows(simulated)
    assert len(simulated) > 1000


def test_with_calibration_and_poses_a_video_is_mapped(tmp_path, rendered):
    told = es.video_to_events(
        rendered / "frames", tmp_path / "out", video=VideoConfig(unit="us"),
        calibration=rendered / "rig.json", camera="left", poses=rendered / "ideal" / "poses.txt",
    )  # fmt: skip
    assert told.notes == ()
    config = es.MapperConfig(methods=("EMVS/cam0",), min_depth_m=0.5, max_depth_m=5, planes=30)
    found = es.map_window(es.open_recording(told.path), config).depth_maps["EMVS/cam0"]
    wanted = es.map_window(es.Sequence(rendered / "ideal"), config).depth_maps["EMVS/cam0"]
    assert found.mask.sum() > 100
    np.testing.assert_array_equal(found.mask, wanted.mask)
    np.testing.assert_array_equal(found.depth_m[found.mask], wanted.depth_m[found.mask])


@pytest.fixture
def calibration(tmp_path):
    camera = es.Camera(40, 30, 40.0, 40.0, 19.5, 14.5)
    path = tmp_path / "rig.json"
    path.write_text(json.dumps(es.Rig("one", (camera,), (np.eye(4),)).to_json()))
    return path


def poses(path, first_us, last_us):
    still = np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1))
    write_tum(path, Trajectory(np.array([first_us, last_us]), *still))
    return path


def test_poses_that_cover_a_part_are_noted(tmp_path, folder, calibration):
    view = View(calibration, None, poses(tmp_path / "poses.txt", 0, 225_000))
    told = made(folder, tmp_path / "out", view=view)
    assert told.notes == (f"{tmp_path}/poses.txt: poses cover 50.0% of the frames' time",)


def test_what_does_not_belong_to_the_video_is_refused(tmp_path, folder, calibration, rendered):
    def not_made(view, words, out="out"):
        refused(words, made, folder, tmp_path / out, view=view)
        assert not (tmp_path / out).exists()

    late = poses(tmp_path / "late.txt", 10**9, 2 * 10**9)
    not_made(View(calibration, None, late), "put both on one clock")
    not_made(View(rendered / "rig.json"), "cameras left, right; set camera to the one")
    not_made(View(rendered / "rig.json", "left"), "346x260 px, the frames have 40x30")
    not_made(View(rendered / "rig.json", "middle"), "set camera to the one")
    not_made(View(calibration), "an event file cannot hold calibration", "out.h5")
    refused("but no calibration", View, None, None, late)


def test_an_output_is_replaced_only_when_told(tmp_path, folder):
    for out in (tmp_path / "seq", tmp_path / "a.h5"):
        made(folder, out)
        refused("exists", made, folder, out)
        made(folder, out, NOISY, force=True)
    images = {path.name: path.read_bytes() for path in folder.iterdir()}
    made(folder, folder, force=True)
    kept = tmp_path / f"{folder.name}.kept-1"
    assert {path.name: path.read_bytes() for path in kept.iterdir()} == images
    assert {path.name for path in tmp_path.glob("[!.]*")} == {"a.h5", "in", kept.name, "seq"}


@pytest.mark.parametrize("out", ["seq", "a.h5"])
def test_an_interrupt_leaves_nothing(tmp_path, folder, out):
    def interrupt(_stage, done, total):
        if done > 0.4 * total:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        made(folder, tmp_path / out, progress=interrupt)
    assert [path.name for path in tmp_path.iterdir()] == ["in"]


def test_progress_rises_to_the_end(tmp_path, folder):
    told = []
    made(folder, tmp_path / "seq", progress=lambda *step: told.append(step))
    assert len(told) == 9
    assert told == sorted(told)
    assert told[-1] == ("events", 1000, 1000)


# `ru_maxrss` would begin with what the process that runs the tests held when it forked.
MEASURED = """
import sys
from pathlib import Path
from eventsweep.sim.config import PixelConfig, VideoConfig
from eventsweep.plugins.video.record import record
for out, source in enumerate(sys.argv[2:]):
    record(Path(source), Path(sys.argv[1], str(out)), PixelConfig(), VideoConfig())
    (line,) = [one for one in open("/proc/self/status") if one.startswith("VmHWM:")]
    print(line.split()[1])
"""


@pytest.mark.slow
def test_memory_does_not_grow_with_the_videos_length(tmp_path):
    """Ten times as many frames and events, in one process after the short one."""
    frames = drifting(150, 160, 120, step_px=0.5, colour=True)
    short = write_video(tmp_path / "short.avi", frames)
    long = write_video(tmp_path / "long.avi", np.concatenate([frames, frames[::-1]] * 5))
    program = [sys.executable, "-c", MEASURED, str(tmp_path), str(short), str(short), str(long)]
    done = subprocess.run(program, capture_output=True, text=True, check=True)
    _, before_kb, after_kb = map(int, done.stdout.split())
    counts = [es.Sequence(tmp_path / name).event_count(0) for name in "12"]
    assert counts[1] > 8 * counts[0] > 10**6
    assert after_kb - before_kb < 8_000


def test_a_playlist_is_not_followed_to_other_hosts(tmp_path):
    asked = []

    class Host(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *words):
            pass

    with HTTPServer(("127.0.0.1", 0), Host) as server:
        Thread(target=server.serve_forever, daemon=True).start()
        address = f"http://127.0.0.1:{server.server_port}/x.ts"
        text = f"#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{address}\n#EXT-X-ENDLIST\n"
        (tmp_path / "v.m3u8").write_text(text)
        refused("is a playlist, not a video", open_frames, tmp_path / "v.m3u8", VideoConfig())
        server.shutdown()
    assert asked == []


TWELVE_BITS = [(13 * frame.astype(np.uint16)) for frame in drifting(6)]
DARK = [np.zeros_like(frame) for frame in drifting(6)]
HELD = [frame for frame in drifting(6) for _ in range(2)]
SLOW_S = [0.02 * k for k in range(12)]
DOUBTED = {
    "12 bits": (TWELVE_BITS, SLOW_S, "% of full scale.*12 bits, set full_scale to 4095"),
    "black at first": ([DARK[0], DARK[0], *drifting(6)], SLOW_S,
                       "the first 2 frames are all black"),
    "only black": (DARK, SLOW_S, "no events: all frames are the same"),
    "hardly changing": ([DARK[0] + 200, DARK[0] + 201], SLOW_S, "no events: ln of no pixel's"),
    "a hole": (drifting(8), [0, 0.02, 0.04, 0.06, 1.06, 1.08, 1.1, 1.12],
               "longest step between frames, after 0.06 s, is 1 s, 50 times the median"),
    "one dropped": (drifting(40), [0.02 * (k + (k > 20)) for k in range(40)],
                    "after 0.4 s, is 0.04 s, 2 times the median"),
    "repeated": (HELD, SLOW_S, "6 of 11 frames repeat the one before"),
    "milliseconds": (drifting(4), ["0.0", "33.3", "66.7", "100.0"], "33.3 s apart.*set unit to ms"),
}  # fmt: skip


@pytest.mark.parametrize("kind", DOUBTED)
def test_frames_that_seem_wrong_are_doubted(tmp_path, kind):
    frames, stamps, words = DOUBTED[kind]
    folder = write_folder(tmp_path / "video", frames, stamps[: len(frames)])
    (note, *_) = [
        note
        for note in es.video_to_events(folder, tmp_path / "out").notes
        if re.search(words, note)
    ]
    assert note.startswith(f"{folder}: ")
    assert "\n" not in note


def test_sound_frames_are_not_doubted(tmp_path):
    sixteen = [(257 * frame.astype(np.uint16)) for frame in drifting(6, step_px=0.2)]
    folder = write_folder(tmp_path / "video", sixteen, SLOW_S[:6])
    assert es.video_to_events(folder, tmp_path / "out").notes == ()
    twelve = write_folder(tmp_path / "twelve", TWELVE_BITS, SLOW_S[:6])
    made = es.video_to_events(twelve, tmp_path / "out2", video=VideoConfig(full_scale=4095))
    assert made.events > 0
    assert not [note for note in made.notes if "full scale" in note]


def test_a_missing_number_of_a_picture_is_doubted_where_a_rate_gives_the_times(tmp_path):
    folder = write_folder(tmp_path / "video", drifting(6, step_px=0.2), SLOW_S[:6])
    (folder / "2.png").unlink()
    told = es.video_to_events(folder, tmp_path / "out", video=VideoConfig(rate_hz=50))
    (note,) = [note for note in told.notes if "numbers of images are missing" in note]
    assert "1 numbers of images are missing, the first after 1.png" in note
