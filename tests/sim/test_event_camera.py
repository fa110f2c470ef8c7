"""An event camera beside mj_step sends what `simulate` makes of the same states."""

from pathlib import Path

import numpy as np
import pytest

import rover
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.scenes import prepared
from eventsweep.sim.config import ModelConfig, SimConfig
from eventsweep.sim.event_camera import EventCamera, EventRig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.model.drives import initial_data
from eventsweep.sim.simulate import simulate
from made_events import assert_same_events
from refusals import refused

mujoco = import_mujoco()
STEPS = 10
NOISY = {"preset": "davis346", "shot_rate_dark_hz": 20}


def config(**more):
    model = ModelConfig(mount="camera:left", motion="dynamics", key="go")
    settings = {"sampling": "fast", "supersample": 2, "truth_interval_s": 0.01, "model": model}
    return SimConfig(**settings | {"imu": {"rate_hz": 0}} | more)


def ridden(model, rig, steps=STEPS, every=1):
    """Steps a model and yields what the rig's cameras send."""
    data = initial_data(model, "go")
    rig.step(data)
    for k in range(1, steps + 1):
        mujoco.mj_step(model, data)
        if k % every == 0:
            yield rig.step(data)


@pytest.mark.parametrize("sensor", [{}, NOISY], ids=["ideal", "noisy"])
def test_events_are_those_of_simulate(rover_xml, rover_model, tmp_path, sensor):
    wanted = config(sensor=sensor, frame_period_us=2000, duration_s=0.02)
    simulate(*prepared(str(rover_xml), "model:left,right", wanted, 3), 3, tmp_path / "simulated")
    live = config(sensor=sensor)
    record = tmp_path / "recorded"
    with EventRig(
        rover_model, "camera:left", ("left", "right"), config=live, seed=3, record=record
    ) as rig:
        packets = list(ridden(rover_model, rig))
    simulated, recorded = Sequence.open(tmp_path / "simulated"), Sequence.open(record)
    for k in range(2):
        expected = simulated.events(k, 0, 1 << 40)
        assert len(expected) > 100
        for found in (Events.concat([one[k] for one in packets]), recorded.events(k, 0, 1 << 40)):
            assert_same_events(found, expected)
        for t_us in (0, 10_000, 20_000):
            depth_m = recorded.truth_depth_m(k, t_us)
            assert np.array_equal(depth_m, simulated.truth_depth_m(k, t_us))
    recorded.verify()
    near_m, far_m = recorded.depth_range_m
    assert 0.2 < near_m < 1  # of what stands still: the arm is nearer
    assert 2.6 < far_m < 3.5
    T = recorded.trajectory.at(np.array([20_000]))
    assert np.allclose(T, simulated.trajectory.at(np.array([20_000])), atol=1e-9)


def test_depth_and_pose_are_those_of_the_last_call(rover_model):
    with EventCamera(rover_model, "left", config=config()) as camera:
        data = initial_data(rover_model, "go")
        assert len(camera.step(data)) == 0
        for _ in range(5):
            mujoco.mj_step(rover_model, data)
        events = camera.step(data)
        assert 0 <= events.t_us.min() <= events.t_us.max() <= 10_000
        mujoco.mj_forward(rover_model, data)
        assert np.allclose(camera.T_world_cam[:3, 3], data.camera("left").xpos)
        u, v = 10, 40  # the floor, to the left of the arm
        ray = np.linalg.inv(K(rover_model)) @ [u, v, 1]
        down = (camera.T_world_cam[:3, :3] @ ray)[2]
        assert camera.depth_m()[v, u] == pytest.approx(-camera.T_world_cam[2, 3] / down, rel=1e-3)
        assert camera.intensity().shape == (48, 64)


def K(model):
    with EventCamera(model, "left", config=config()) as camera:
        seen = camera.camera
    return np.array([[seen.fx_px, 0, seen.cx_px], [0, seen.fy_px, seen.cy_px], [0, 0, 1]])


def test_rarer_calls_send_as_many_events(rover_model):
    counts = []
    for every in (1, 5):
        with EventCamera(rover_model, "left", config=config()) as camera:
            counts.append(sum(len(one) for one in ridden(rover_model, camera, every=every)))
    assert counts[0] == pytest.approx(counts[1], rel=0.06)


@pytest.mark.parametrize(("brightness", "floats"), [(0.02, True), (0.5, False), (6.0, True)])
def test_light_at_the_first_call_decides_how_it_is_drawn(rover_xml, tmp_path, brightness, floats):
    """Dark, or brighter than white: in floats, and a line says so."""
    spec = mujoco.MjSpec.from_file(str(rover_xml))
    spec.visual.headlight.ambient = [brightness] * 3
    spec.visual.headlight.diffuse = spec.visual.headlight.specular = [0.0] * 3
    for lamp in spec.lights:
        lamp.active = False
    said, record = [], tmp_path / "recorded"
    with EventCamera(
        spec.compile(), "camera:left", config=config(), record=record, notice=said.append
    ) as camera:
        ridden_events = list(ridden(spec.compile(), camera, steps=2))
    assert len(ridden_events) == 2
    assert ("in float" in Sequence.open(record).manifest.renderer) is floats
    assert any("rendered in floating point" in line for line in said) is floats


LENS = Camera(64, 48, 50, 50, 31.5, 23.5)


def test_what_cannot_be_recorded_is_refused(rover_model, tmp_path):
    refused("compiled", EventCamera, "rover.xml", "eye")
    ahead = {"config": config(truth=("flow",)), "record": tmp_path / "r"}
    refused("look ahead", EventRig, rover_model, "eye", **ahead)
    camera = EventCamera(rover_model, "left", config=config(), record=tmp_path / "r").__enter__()
    camera.step(initial_data(rover_model, "go"))
    refused("nothing was recorded", camera.__exit__, None, None, None)
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "r").mkdir()
    (tmp_path / "r" / "thesis.tex").write_text("mine")
    refused("exists", EventCamera, rover_model, "left", record=tmp_path / "r")


def test_nothing_is_seen_before_the_first_call_and_each_call_goes_on(rover_model):
    data = initial_data(rover_model, "go")
    with EventCamera(rover_model, "left", config=config()) as camera:
        for ask in (camera.depth_m, camera.intensity, lambda: camera.T_world_cam):
            refused("call step", ask)
        camera.step(data)
        refused("not later than the last one", camera.step, data)


@pytest.mark.parametrize(("where", "settings", "words"), [
    (("eye",), {}, "site 'eye' has no lens model"),
    (("blind",), {}, "'blind' of the model has a resolution of"),
    (("eye", LENS), {"T_mount_body": np.ones((4, 4))}, "T_mount_body"),
])  # fmt: skip
def test_what_cannot_carry_a_camera_is_refused(rover_model, where, settings, words):
    refused(words, EventCamera, rover_model, *where, **settings)


def test_a_loop_that_fails_leaves_no_recording(rover_model, tmp_path):
    def fall():
        with EventCamera(rover_model, "left", config=config(), record=tmp_path / "r") as camera:
            for _ in ridden(rover_model, camera, steps=3):
                pass
            raise KeyError("gait")

    with pytest.raises(KeyError, match="gait"):
        fall()
    assert list(tmp_path.iterdir()) == []


def test_a_free_camera_in_a_world_that_stands_still(rover_model, tmp_path):
    text = rover.MJCF.replace('<body name="rover" pos="0 0 .25">\n    <freejoint name="root"/>',
                              '<body name="eyes" mocap="true"><camera name="free" '
                              'xyaxes="0 -1 0 0 0 1" resolution="64 48"/></body>\n'
                              '<body name="rover" pos="0 0 -2">')  # fmt: skip
    text = text.split("<keyframe>")[0] + "</mujoco>"
    world = mujoco.MjModel.from_xml_path(str(rover.write(tmp_path, text)))
    data, sent = mujoco.MjData(world), []
    with EventCamera(world, "free", config=config()) as camera:
        for k in range(5):
            data.time, data.mocap_pos[0] = 0.004 * k, (0, 0.01 * k, 1)
            sent.append(len(camera.step(data)))
    assert sent[0] == 0
    assert min(sent[1:]) > 40


@pytest.mark.slow
def test_memory_does_not_grow_with_the_number_of_calls(tmp_path):
    text = (
        '<mujoco><option timestep="0.001" gravity="0 0 0"/><worldbody>'
        '<geom type="box" pos="2 0 0" size=".1 .4 .4"/><body name="cart"><joint type="slide" '
        'axis="0 1 0"/><geom size=".01" mass="1"/><site name="eye"/></body></worldbody></mujoco>'
    )
    world = mujoco.MjModel.from_xml_string(text)
    data, sizes = mujoco.MjData(world), []
    lens = Camera(8, 6, 8, 8, 3.5, 2.5)
    small = SimConfig(sampling="fast", supersample=1)
    with EventCamera(world, "site:eye", lens, config=small) as camera:
        for k in range(100_000):
            data.qvel[0] = 0.3 * np.sin(1e-3 * k)
            mujoco.mj_step(world, data)
            camera.step(data)
            if k % 10_000 == 5_000:
                pages = int(Path("/proc/self/statm").read_text().split()[1])
                sizes.append(pages * 4096 / 1e6)
    assert sizes[-1] - sizes[0] < 8
