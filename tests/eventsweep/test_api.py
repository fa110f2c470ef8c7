"""The public names: what importing them costs, what they refuse, and how they show themselves."""

import os
import re
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest

import eventsweep as es
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.eval.cli.main import main
from places import HAS_PLUGINS, ROOT
from point_world import fronto_parallel
from programs import python
from refusals import command_refused, line_of

PYTHON_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
METHODS = ("Alg1/H", "EMVS/cam0")


def python_blocks(page: str) -> list[str]:
    return PYTHON_BLOCK.findall((ROOT / "docs" / page).read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """A sequence of points on a plane, with its true depth at the middle of every window."""
    world = fronto_parallel(1.5)
    path = tmp_path_factory.mktemp("points") / "sequence"
    with SequenceWriter(
        path, name="points", rig=world.rig, trajectory=world.trajectory, config={},
        depth_range_m=(0.5, 4),
    ) as writer:  # fmt: skip
        for camera, events in enumerate(world.streams):
            writer.append_events(camera, events)
            sensor = world.rig.cameras[camera]
            truth_m = np.full((sensor.height_px, sensor.width_px), 1.5, np.float32)
            middle_us = sum(world.event_span_us(0)) // 2
            for t_us in sorted({0, *range(100_000, 500_000, 50_000), middle_us}):
                writer.append_truth(camera, t_us, truth_m, np.zeros(truth_m.shape, np.uint8))
    return path


@pytest.fixture(scope="module")
def recording(folder):
    return es.open_recording(str(folder))


@pytest.fixture(scope="module")
def config(recording):
    times_us = recording.truth_times_us(0)
    middle_s = float(times_us[len(times_us) // 2]) / 1e6
    return es.MapperConfig(methods=METHODS, planes=20, reference_s=middle_s)


@pytest.fixture(scope="module")
def result(recording, config):
    return es.map_window(recording, config)


# Importing
def test_importing_the_package_or_its_light_names_loads_nothing_heavy():
    code = (
        "import sys; before = set(sys.modules); import eventsweep; "
        "print(*{name.split('.')[0] for name in set(sys.modules) - before})"
    )
    foreign = set(python("-c", code).stdout.split()) - set(sys.stdlib_module_names)
    assert foreign == {"eventsweep", "lazy_loader"}
    code = (
        "import sys, eventsweep as es; es.InputError, es.MapperConfig, es.SimConfig, es.EvalConfig;"
        "sys.exit(bool({'numpy', 'numba', 'mujoco', 'h5py', 'cv2'} & set(sys.modules)))"
    )
    assert python("-c", code).returncode == 0


def test_every_public_name_is_there_and_has_an_example_and_no_other_is():
    assert [name for name in es.__all__ if getattr(es, name) is None] == []
    assert set(es.__all__) <= set(dir(es))
    code = "\n".join(python_blocks("api.md"))
    assert [name for name in es.__all__ if not re.search(rf"\bes\.{name}\b", code)] == []
    with pytest.raises(AttributeError, match="No eventsweep attribute map_windwo"):
        es.map_windwo  # noqa: B018


@pytest.mark.parametrize("page", ["tutorial.md", "api.md"])
def test_mapping_and_scoring_take_six_lines_and_one_import(page):
    block = next(text for text in python_blocks(page) if "import eventsweep" in text)
    lines = [line for line in block.splitlines() if line]
    assert len(lines) <= 6
    assert sum("import" in line for line in lines) == 1
    assert "es.score(" in block


# What comes out
@pytest.mark.parametrize(
    "flags", [[], pytest.param(["--map.hot-pixels", "3"], marks=pytest.mark.slow)]
)
def test_a_window_scores_as_the_command_line_does(folder, config, tmp_path, flags):
    chosen = config.model_copy(update={"hot_pixels": 3.0}) if flags else config
    recording = es.open_recording(folder)
    direct = es.score(es.map_window(recording, chosen), recording)
    asked = ["--method", "Alg1/H", "--method", "EMVS/cam0", "--map.planes", "20", "--quiet", *flags]
    where = [str(folder), "--out", str(tmp_path / "map")]
    assert main(["map", *where, *asked, "--map.reference-s", str(config.reference_s)]) == 0
    written = es.score(str(tmp_path / "map"))
    assert direct.rows.equals(written.rows)
    for name in ("configuration", "seed", "sequences", "metrics"):
        assert getattr(direct, name) == getattr(written, name)


@pytest.mark.slow
def test_paths_may_be_strings_everywhere(folder, config, tmp_path):
    path, out = str(folder), str(tmp_path / "windows")
    assert repr(es.Sequence(path)) == repr(es.open_recording(path))
    by_path = es.score(es.map_window(path, config), path)
    assert len(by_path.rows)
    sliding = es.MapperConfig(methods=METHODS, planes=20, window_s=0.1, start_s=0.05)
    stored = es.map_windows(path, out, sliding, clouds=False)
    assert es.score(out).rows.equals(es.score(stored).rows)
    again = es.map_windows(es.open_recording(path), out, sliding, clouds=False)
    assert len(again.windows) == len(stored.windows) > 1


def test_one_window_or_several_are_mapped_into_a_folder_that_says_what_it_is(
    folder, config, tmp_path
):
    stored = es.map_windows(folder, tmp_path / "one", config)
    alone = es.map_window(folder, config).depth_maps
    (window,) = stored.windows
    assert [name for name in alone if not window.depth_map(name).points] == []
    for name, depth_map in alone.items():
        np.testing.assert_array_equal(window.depth_map(name).depth_m, depth_map.depth_m)
    assert {path.parent.name for path in window.path.rglob("cloud.ply")} == {"Alg1-H", "EMVS-cam0"}
    config = es.MapperConfig(methods=METHODS, planes=20, window_s=0.2)
    stored = es.map_windows(str(folder), str(tmp_path / "map"), config, clouds=False)
    assert repr(stored) == (
        f"StoredMap({str(tmp_path / 'map')!r}, of points: 2 windows; methods: Alg1/H, EMVS/cam0)"
    )
    window = stored.windows[0]
    assert repr(window).startswith(f"StoredWindow({str(window.path)!r}, {window.info.t0_us} to ")


def test_a_scene_is_simulated_by_name_or_by_itself(tmp_path):
    short = es.SimConfig(duration_s=0.02)
    sequence = es.simulate("planes", str(tmp_path / "one"), short, rig="rpg")
    other = es.simulate(
        es.load_scene("planes"), tmp_path / "two", short, rig=sequence.rig, progress=print
    )
    assert isinstance(sequence, es.Sequence)
    assert sequence.manifest.digest() == other.manifest.digest()


# How things show themselves
def test_everything_says_what_it_is(recording, result):
    counts = [len(recording.events(k, 0, 1_000_000)) for k in (0, 1)]
    rig = "2 cameras, 96 x 64 px, baseline 0.1 m"
    assert repr(recording.rig) == f"Rig('test', {rig})"
    assert repr(recording.trajectory) == "Trajectory(6 poses, 0 to 500000 µs, a way of 0.4 m)"
    assert repr(recording) == (
        f"Sequence('points', {rig}, 6 poses from 0 to 500000 µs, {counts[0]} + {counts[1]} events)"
    )
    events = recording.events(0, 0, 1_000_000)
    span = f"{events.t_us[0]} to {events.t_us[-1]} µs"
    assert repr(events) == f"Events({counts[0]} events, {span})"
    assert repr(events.slice(0, 0)) == "Events(none)"
    assert repr(events.slice(0, 1)) == f"Events(1 event at {events.t_us[0]} µs)"
    depth_map = result.depth_maps["Alg1/H"]
    depth_m = depth_map.depth_m[depth_map.mask]
    assert repr(depth_map) == (
        f"DepthMap('Alg1/H', 96 x 64 px, {depth_map.points} points, "
        f"{depth_m.min():.3g} to {depth_m.max():.3g} m)"
    )
    assert repr(result).splitlines() == [
        f"WindowResult({result.window.t0_us} to {result.window.t1_us} µs, view of 96 x 64 px at "
        f"{result.window.t_ref_us} µs, on cpu;",
        f"  points: Alg1/H {depth_map.points}, EMVS/cam0 {result.depth_maps['EMVS/cam0'].points})",
    ]
    results = es.score(result, recording)
    metrics = results.rows["metric"].nunique()
    assert repr(results) == (
        f"Results({len(results.rows)} numbers of points: {metrics} metrics of Alg1/H, EMVS/cam0)"
    )


@pytest.mark.parametrize(("make", "text"), [
    (lambda: started(7), "EventSimulator(4 x 3 px, last frame at 7 µs)"),
    (lambda: es.EventSimulator(4, 3), "EventSimulator(4 x 3 px, no frame yet)"),
    (lambda: es.MapperConfig(), "MapperConfig()"),
    (lambda: es.MapperConfig(planes=5, median_px=5), "MapperConfig(planes=5)"),
    (lambda: es.SimConfig(sensor={"preset": "gen4"}, log_eps=0.1),
     "SimConfig(refractory_period_us=100, log_eps=0.1, sensor=SensorConfig(preset='gen4'))"),
    (lambda: es.EvalConfig(border_px=3), "EvalConfig(border_px=3)"),
    (lambda: es.Method.from_function("Mine/least", min, "the least"),
     "Method('Mine/least': the least)"),
    (lambda: es.METRICS["mean_error"],
     "Metric('mean_error' [m], better: lower; mean |e - g|)"),
])  # fmt: skip
def test_what_is_made_says_what_is_not_as_it_is_by_default(make, text):
    assert repr(make()) == text


def test_registries_and_scenes_say_what_they_are():
    assert repr(es.METRICS).startswith(f"{len(es.METRICS)} metrics: points, completeness, ")
    assert repr(es.load_scene("planes")).startswith("Scene('planes', 0.5 s, 0.7 to 4.5 m, rig ")
    assert "desk" in es.scene_names()
    assert es.load_scene("desk").name == "desk"
    assert "Alg1/H" in es.methods()
    assert es.METRICS["mean_error"].unit == "m"


# What is refused
def refused(call, *arguments) -> str:
    message = line_of(call, *arguments)
    assert "pydantic" not in message
    return message


@pytest.mark.parametrize(("call", "words"), [
    (lambda: es.MapperConfig(planes=1), "planes is 1: input should be greater"),
    (lambda: es.MapperConfig(planez=50), "unknown key planez; did you mean planes?"),
    (lambda: es.MapperConfig(planes="many"), "planes is 'many': input should be a valid int"),
    (lambda: es.MapperConfig(planes=1, median_px=0), "(1 more faults)"),
    (lambda: es.MapperConfig(median_px=4), "median_px is 4: must be odd"),
    (lambda: es.MapperConfig(min_depth_m=np.ones(200)), "min_depth_m is array([1., 1.,"),
    (lambda: es.MapperConfig(sgm={"decay_s": -1}), "sgm.decay_s is -1"),
    (lambda: es.MapperConfig(sgm={"matcher": {"block_px": 4}}), "sgm.matcher.block_px is 4"),
    (lambda: es.MapperConfig(sgm={"dekay_s": 1}), "did you mean decay_s?"),
    (lambda: es.MapperConfig.model_validate([1]), "MapperConfig is [1]"),
    (lambda: setattr(es.MapperConfig(), "planes", 3), "cannot be changed"),
    (lambda: es.SimConfig(duration_s=-1), "duration_s is -1"),
    (lambda: es.SimConfig(sensor={"preset": "davis"}),
     "sensor preset davis: neither one of ideal, davis240"),
    (lambda: es.SimConfig(imu={"quat_xyzw": (1, 1, 1, 1)}), "imu.quat_xyzw is (1, 1, 1, 1)"),
    (lambda: es.SimConfig(min_frame_interval_us=10**6), "min_frame_interval_us=1000000"),
    (lambda: es.EvalConfig(border_px=-1), "border_px is -1"),
    (lambda: es.open_recording("nowhere"), "nowhere: no such folder"),
    (lambda: es.Sequence("nowhere"), "nowhere"),
    (lambda: es.map_window("nowhere"), "nowhere: no such folder"),
    (lambda: es.load_scene("desc"), "unknown scene 'desc'"),
    (lambda: es.simulate("desk", "o", rig="kinect"), "unknown rig 'kinect'"),
    (lambda: es.simulate("desk", "o", seed=-1), "seed -1"),
    (lambda: es.simulate("desk", "o", es.MapperConfig()), "needs SimConfig(...)"),
    (lambda: es.register_method(es.Method.from_function("x", len, "y")), "method name 'x'"),
    (lambda: es.score("nowhere"), "nowhere: no maps"),
    (lambda: es.EventSimulator(0, 3), "a sensor of 0 x 3 px"),
    (lambda: es.EventSimulator(4, 3, es.MapperConfig()), "needs PixelConfig(...)"),
    (lambda: es.VideoConfig(rate_hz=-1), "rate_hz is -1"),
    (lambda: es.METRICS["mean_eror"], "no metric 'mean_eror': did you mean mean_error?"),
    (lambda: es.METRICS["x"], "no metric 'x': choose from points, completeness"),
    (lambda: es.Camera(0, 3, 1, 1, 1, 1), "camera of 0x3 px"),
])  # fmt: skip
def test_bad_input_is_refused_in_one_line(call, words):
    assert words in refused(call)


CAMERA = es.Camera(4, 3, 1, 1, 1, 1)
STILL = es.Trajectory(np.array([0, 9]), np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1)))
SHIFTED = es.MapperConfig(methods=METHODS, planes=20, reference_shift=0.5)
BETWEEN = es.MapperConfig(reference_s=0.22)
TIMES, POSITIONS, QUATS = STILL.t_us, STILL.positions_m, STILL.quats_xyzw


def started(t_us=0) -> es.EventSimulator:
    pixels = es.EventSimulator(4, 3)
    pixels.start(np.ones((3, 4), np.float32), t_us=t_us)
    return pixels


@pytest.mark.parametrize(("call", "words"), [
    (lambda: es.Camera("a", 3, 1, 1, 1, 1), "width_px is 'a': needs a whole number"),
    (lambda: es.Camera(4.5, 3, 1, 1, 1, 1), "width_px is 4.5: needs a whole number"),
    (lambda: es.Camera(4, 3, None, 1, 1, 1), "fx_px is None: needs a number"),
    (lambda: es.Camera(4, 3, 1, 1, 1, 1, "radtan", 0.1), "distortion is 0.1: needs a tuple"),
    (lambda: es.Camera(4, 3, 1, 1, 1, 1, "kb4", tuple("abcd")), "distortion is 'a'"),
    (lambda: CAMERA.project("a"), "points_cam is 'a': needs numbers of shape (..., 3)"),
    (lambda: CAMERA.project([1, 2]), "points_cam is [1, 2]: needs numbers of shape"),
    (lambda: CAMERA.unproject([1, 2, 3]), "uv_px is [1, 2, 3]: needs numbers of shape"),
    (lambda: es.Rig("a", CAMERA, (np.eye(4),)), "rig's cameras is Camera("),
    (lambda: es.Rig("a", ("cam",), (np.eye(4),)), "rig's camera is 'cam': needs Camera"),
    (lambda: es.Rig("a", (CAMERA,), (np.eye(4).tolist(),)), "rig's T_body_cam is [[1.0"),
    (lambda: es.Rig("a", (CAMERA,), (np.eye(4),), "left"), "camera_names is 'left'"),
    (lambda: es.Rig("a", (CAMERA,), (np.eye(4),)).baseline_m(0, "b"), "no camera 'b'"),
    (lambda: es.Trajectory([0, 9], POSITIONS, QUATS), "t_us is [0, 9]: needs an array (N,)"),
    (lambda: es.Trajectory(TIMES / 1e6, POSITIONS, QUATS), "needs an array (N,) of whole µs"),
    (lambda: es.Trajectory(TIMES, "b", QUATS), "positions_m is 'b': needs an array (N, 3)"),
    (lambda: es.Trajectory(TIMES, POSITIONS, np.array("c")), "quats_xyzw is array('c'"),
    (lambda: es.Trajectory(TIMES, QUATS, POSITIONS), "positions (2, 4), quaternions (2, 3)"),
    (lambda: es.Trajectory(TIMES[None], POSITIONS, QUATS), "needs (N,), (N, 3) and (N, 4)"),
    (lambda: es.Trajectory.from_matrices(TIMES, np.eye(4)), "needs (N, 4, 4)"),
    (lambda: STILL.at("noon"), "time 'noon': needs µs"),
    (lambda: es.Events([1], [2], [3], [1]), "events' column x is [1]: needs an array"),
    (lambda: es.register_method("x"), "method is 'x': needs what Method.from_function"),
    (lambda: es.Method.from_function("A/b", 5, "c"), "function is 5: needs a function"),
    (lambda: es.methods("x"), "n_cameras is 'x': needs a whole number"),
    (lambda: es.open_recording(5), "path is 5: needs a path"),
    (lambda: es.Sequence(None), "path is None: needs a path"),
    (lambda: es.map_window(5), "recording is 5: needs a path, what open_recording returned"),
    (lambda: es.map_windows(CAMERA, "o"), "with name, rig, trajectory, depth_range_m"),
    (lambda: es.map_windows("r", 5), "out is 5: needs a path"),
    (lambda: es.load_scene(5), "unknown scene 5"),
    (lambda: es.simulate("nope", "o"), "unknown scene 'nope'"),
    (lambda: es.simulate(5, "o"), "scene is 5: needs a scene's name"),
    (lambda: es.simulate("desk", 5), "out is 5: needs a path"),
    (lambda: es.simulate("desk", "o", seed="a"), "seed is 'a': needs a whole number"),
    (lambda: es.simulate("desk", "o", rig=5), "rig is 5: needs a rig's name"),
    (lambda: es.simulate("desk", "o", workers=1.5), "workers is 1.5: needs a whole number"),
    (lambda: es.score(5), "mapped is 5: needs a window, a map or a folder's path"),
    (lambda: es.EventSimulator("a", 3), "width_px is 'a': needs a whole number"),
    (lambda: started().step([[1] * 4] * 3, 5), "intensity is [[1, 1, 1, 1]"),
    (lambda: started().step(np.full((3, 4), "a"), 5), "needs an array (3, 4) of numbers"),
    (lambda: started().step(np.ones((3, 4)), "b"), "t_us is 'b': needs a whole number"),
    (lambda: started().start(np.ones((3, 4)), 0.5), "t_us is 0.5: needs a whole number"),
])  # fmt: skip
def test_what_is_of_another_type_is_refused_in_one_line(call, words):
    assert words in refused(call)


def test_an_error_names_parameters_and_the_command_line_its_flags(folder, tmp_path, capsys):
    out, asked = tmp_path / "map", es.MapperConfig(methods=("EMVS/cam0",), planes=4)
    es.map_windows(folder, out, asked, clouds=False)
    said = refused(lambda: es.map_windows(folder, out, asked, clouds=False))
    assert "set force=True" in said
    assert "--" not in said
    said = command_refused(capsys, "map", folder, "--out", out, "--quiet")
    assert "add --force" in said


@pytest.mark.parametrize("camera", [2, 7, -1])
@pytest.mark.parametrize("read", [
    lambda r, k: r.events(k, 0, 1000), lambda r, k: r.events(camera=k, t0_us=0, t1_us=1000),
    lambda r, k: r.event_span_us(k), lambda r, k: r.event_count(k), lambda r, k: r.frame(k, 0),
    lambda r, k: r.photo_times_us(k), lambda r, k: r.truth_times_us(k),
    lambda r, k: r.truth_depth_m(k, 0), lambda r, k: r.truth_view_depth_m(k, 0),
    lambda r, k: r.labels(k, 0, 1000), lambda r, k: r.event_points_world(k, 0, 1000),
    lambda r, k: r.rig.baseline_m(0, k),
])  # fmt: skip
def test_a_camera_that_is_not_there_is_refused(recording, read, camera):
    assert f"no camera {camera}, it has 0 to 1" in refused(read, recording, camera)


@pytest.mark.parametrize(("call", "words"), [
    (lambda recording, result: result.depth_maps["Alg1/A"], "did you mean Alg1/H?"),
    (lambda recording, result: es.score(result), "score(result, recording)"),
    (lambda recording, result: es.score("map", recording), "leave it out"),
    (lambda recording, result: es.map_window(recording, es.SimConfig()),
     "needs MapperConfig(...)"),
    (lambda recording, result: es.score(result, recording, {"border_px": 1}),
     "needs EvalConfig(...)"),
    (lambda recording, result: es.map_window(recording, es.MapperConfig(methods=("Alg1/Z",))),
     "unknown method"),
    (lambda recording, result: es.map_window(recording, es.MapperConfig(window_s=0.1)),
     "call map_windows"),
    (lambda recording, result: es.score(es.map_window(recording, SHIFTED), recording),
     "reference view is not camera 0's"),
    (lambda recording, result: es.score(result, fronto_parallel(1.5)), "without ground truth"),
    (lambda recording, result: es.score(es.map_window(recording, BETWEEN), recording),
     "no ground truth at"),
    (lambda recording, result: recording.trajectory.at(10**9), "never extrapolated"),
])  # fmt: skip
def test_what_does_not_fit_together_is_refused(recording, result, call, words):
    assert words in refused(call, recording, result)
    assert result.depth_maps.get("Alg1/A") is None


# Types
@pytest.fixture(scope="module")
def installed(tmp_path_factory) -> Path:
    """A Python that has our packages as a wheel lays them out, beside the libraries of this one."""
    home = tmp_path_factory.mktemp("installed")
    venv.create(home, symlinks=True)
    (site,) = (home / "lib").glob("python*/site-packages")
    (site / "eventsweep").symlink_to(ROOT / "eventsweep")
    libraries = [path for path in sys.path if path.endswith("site-packages")]
    (site / "libraries.pth").write_text("\n".join(libraries) + "\n")
    return home / "bin" / "python"


def test_the_package_and_its_parts_say_that_they_have_types():
    links = [path for path in (ROOT / "eventsweep").iterdir() if path.is_symlink()]
    assert len(links) == 5
    parts = [path for path in links if HAS_PLUGINS or path.name != "plugins"]
    folders = [ROOT / "eventsweep", *parts]
    assert [path for path in folders if not (path / "py.typed").exists()] == []


def strictly_checked(python: Path, script: Path) -> "subprocess.CompletedProcess[str]":
    """Runs mypy as users do: without our settings, and without pydantic's plugin."""
    options = ["--strict", "--config-file=", "--python-executable", str(python)]
    env = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        [sys.executable, "-m", "mypy", *options, str(script)], cwd=script.parent, env=env,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("page", ["tutorial.md", "api.md"])
def test_a_strict_type_checker_passes_the_examples(installed, page, tmp_path):
    script = tmp_path / "script.py"
    script.write_text("\n".join(python_blocks(page)))
    done = strictly_checked(installed, script)
    assert done.returncode == 0, done.stdout + done.stderr


WRONGLY_TYPED = """import eventsweep as es
es.MapperConfig(planez=3)
es.SimConfig(duration_s="long")
points: int = es.map_window("a")
es.map_windwo"""


@pytest.mark.slow
def test_a_type_checker_sees_wrong_names_and_types(installed, tmp_path):
    (tmp_path / "script.py").write_text(WRONGLY_TYPED)
    said = strictly_checked(installed, tmp_path / "script.py").stdout
    assert [f"script.py:{k}: error" in said for k in range(1, 6)] == [False] + [True] * 4
