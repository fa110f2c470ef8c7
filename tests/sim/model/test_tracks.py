"""States between two known ones, where they come from, and what is refused."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp

import rover
from eventsweep.eval.cli.main import main
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.model.drives import (
    initial_data,
    load_controller,
    read_joints,
    run_dynamics,
)
from eventsweep.sim.model.tracks import StateTrack, state_of
from refusals import refused

mujoco = import_mujoco()
SWING = 7


def test_joints_go_straight_and_turns_along_a_great_circle(rover_model):
    rng = np.random.default_rng(1)
    qpos = np.tile(initial_data(rover_model, "").qpos, (3, 1))
    turns = Rotation.random(3, rng=rng)
    qpos[:, :3], qpos[:, 3:7] = rng.normal(size=(3, 3)), turns.as_quat(scalar_first=True)
    qpos[:, SWING] = rng.normal(size=3)
    mocap = np.zeros((3, 1, 7))
    mocap[..., :3], mocap[:, 0, 3:] = rng.normal(size=(3, 1, 3)), turns.as_quat(scalar_first=True)
    t_us = np.array([0, 3000, 4000])
    track, data = StateTrack(t_us, qpos, mocap), mujoco.MjData(rover_model)
    between = Slerp(t_us, turns)
    for t in (0, 700, 2999.5, 3000, 3600, 4000):
        track(rover_model, data, t * 1e-6)
        for k in range(3):
            assert data.qpos[k] == pytest.approx(np.interp(t, t_us, qpos[:, k]), abs=1e-12)
            assert data.mocap_pos[0, k] == pytest.approx(np.interp(t, t_us, mocap[:, 0, k]))
        assert data.qpos[SWING] == pytest.approx(np.interp(t, t_us, qpos[:, SWING]), abs=1e-12)
        for quat in (data.qpos[3:7], data.mocap_quat[0]):
            turn = Rotation.from_quat(quat, scalar_first=True) * between(t).inv()
            assert turn.magnitude() < 1e-7


def test_known_states_are_met_to_the_bit_and_the_ends_hold(rover_model):
    track = run_dynamics(rover_model, 0.02, "go")
    data = mujoco.MjData(rover_model)
    for k, t_us in enumerate(track.t_us.tolist()):
        track(rover_model, data, t_us * 1e-6)
        assert np.array_equal(data.qpos, track.qpos[k])
    track(rover_model, data, 1.0)
    assert np.array_equal(data.qpos, track.qpos[-1])


def push(model, data):
    data.ctrl[0] = 0.5


def test_dynamics_are_those_of_mujoco(rover_model):
    track = run_dynamics(rover_model, 0.1, "go", push)
    data = initial_data(rover_model, "go")
    for k in range(50):
        assert np.array_equal(track.qpos[k], data.qpos)
        push(rover_model, data)
        mujoco.mj_step(rover_model, data)
    assert track.t_us[-1] == 100_000
    calm = run_dynamics(rover_model, 0.1, "go")
    assert abs(calm.qpos[-1, SWING] - track.qpos[-1, SWING]) > 0.05


def test_a_table_moves_the_joints_that_it_names(rover_model, tmp_path):
    path = tmp_path / "swing.csv"
    path.write_text("t_s, swing\n1.0, 0\n1.5, 0.4\n2.0, 0.3\n")
    track, data = read_joints(path, rover_model), mujoco.MjData(rover_model)
    track(rover_model, data, 0.25)
    assert data.qpos[SWING] == pytest.approx(0.2)
    assert np.array_equal(
        data.qpos[:SWING], StateTrack.at_rest(initial_data(rover_model, "")).qpos[0, :SWING]
    )


@pytest.mark.parametrize(("text", "message"), [
    ("", "columns none"), ("swing\n0\n1\n", "columns swing: needs t_s"),
    ("t_s,swing\n0,0\n", "must increase"), ("t_s,swing\n0,0\n0,1\n", "must increase"),
    ("t_s,swing\n0,a\n1,1\n", "could not convert"),
    ("t_s,swing\n0,0\n1\n", "row '1': needs"), ("t_s,swing\n0,0\n1,nan\n", "row '1,nan'"),
    ("t_s,elbow\n0,0\n1,1\n", "no joint 'elbow'.*it has root, swing"),
    ("t_s,root\n0,0\n1,1\n", "'root' is a free or ball joint"),
])  # fmt: skip
def test_a_bad_table_is_refused(rover_model, tmp_path, text, message):
    path = tmp_path / "joints.csv"
    path.write_text(text)
    refused(message, read_joints, path, rover_model)


def fails(model, data):
    raise KeyError("gait")


STILL = '<mujoco><worldbody><geom size="1"/></worldbody></mujoco>'


@pytest.mark.parametrize(("values", "words"), [
    ((0.1, "home"), r"no key frame 'home'.*go"), ((1e6,), "at most 10,000,000"),
    ((0.1, "", fails), r"the controller failed at 0 s: KeyError: 'gait'"),
])  # fmt: skip
def test_what_cannot_drive_a_model_is_refused(rover_model, values, words):
    refused(words, run_dynamics, rover_model, *values)
    refused("no joints", run_dynamics, mujoco.MjModel.from_xml_string(STILL), 1.0)


@pytest.mark.parametrize(("name", "words"), [
    ("nowhere:f", "No module"), ("math:f", "no attribute"), ("math", "attribute|MODULE"),
    ("math:pi", "is not a function"),
])  # fmt: skip
def test_what_is_no_controller_is_refused(name, words):
    refused(words, load_controller, name)
    assert load_controller("math:sin")(0) == 0


WILD = """<mujoco><option timestep="0.1"/><worldbody><body><joint name="j" type="slide"/>
<geom size=".1"/></body></worldbody><actuator><position joint="j" kp="1e9"/></actuator></mujoco>"""


def runaway(model, data):
    data.qvel[0] = 1e12


def test_an_unstable_model_is_told(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    wild = mujoco.MjModel.from_xml_string(WILD)
    refused("becomes unstable", run_dynamics, wild, 2.0, "", runaway)
    assert list(tmp_path.iterdir()) == []


def test_a_state_is_a_copy(rover_model):
    data = initial_data(rover_model, "")
    qpos, mocap = state_of(data)
    data.qpos[0] = data.mocap_pos[0, 0] = 9
    assert qpos[0] != 9
    assert mocap[0, 0] != 9


def test_a_settings_file_runs_no_code(tmp_path, capsys):
    evil, settings = tmp_path / "evil.py", tmp_path / "s.toml"
    evil.write_text(f"open({str(tmp_path / 'ran')!r}, 'w')\ndef go(model, data): pass\n")
    settings.write_text(f"[sim.model]\nmotion = 'dynamics'\ncontroller = '{evil}:go'\n")
    asked = ["simulate", str(rover.write(tmp_path)), "--out", str(tmp_path / "out")]
    assert main([*asked, "--config", str(settings)]) == 2
    assert "no file may name code to run" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()
