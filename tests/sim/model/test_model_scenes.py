"""A model's file becomes a scene: what moves in it, what its cameras see, and what is refused."""

import pickle
from dataclasses import replace

import numpy as np
import pytest

import rover
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.scenes import prepared
from eventsweep.sim.config import ModelConfig, ReplayConfig, SimConfig
from eventsweep.sim.mjcf import KEEPS_LINKS
from eventsweep.sim.model.scenes import scene_of
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.simulate import simulate
from refusals import all_bytes, refused

pytestmark = pytest.mark.usefixtures("blank_figures")

CONFIG = SimConfig(sampling="fast", supersample=2, duration_s=0.02, truth_interval_s=0.01)


def made(path, rig="model:left,right", said=None, config=CONFIG, **model):
    told = [] if said is None else said
    config = config.model_copy(update={"model": ModelConfig(**model)})
    return prepared(str(path), rig, config, 0, told.append)


@pytest.mark.slow
def test_dynamics_become_a_sequence_that_any_number_of_workers_makes(rover_xml, tmp_path):
    scene, rig, config = made(rover_xml, motion="dynamics", key="go")
    assert scene.name == "rover"
    assert pickle.loads(pickle.dumps(scene)).name == "rover"
    for workers in (1, 2):
        simulate(scene, rig, config, 0, tmp_path / f"{workers}", workers=workers)
    assert all_bytes(tmp_path / "1") == all_bytes(tmp_path / "2")
    sequence = Sequence.open(tmp_path / "1")
    assert len(sequence.events(0, 0, 20_000)) > 100
    start, end = sequence.trajectory.at(np.array([0, 20_000]))[:, :3, 3]
    assert end[0] - start[0] == pytest.approx(0.8 * 0.02, rel=0.05)
    assert sequence.manifest.configuration["model"]["sha256"] == config.model.sha256 != ""


def test_depth_is_that_of_the_walls_and_not_of_the_arm(rover_xml):
    scene, _, _ = made(rover_xml, motion="dynamics", key="go")
    near_m, far_m = scene.depth_range_m
    assert 0.3 < near_m < 1.0  # the floor below; the arm begins 5 cm away
    assert 2.6 < far_m < 3.5  # the wall
    assert scene.carrier == "rover"


def test_a_head_style_begins_at_the_mount(rover_xml):
    scene, rig, _ = made(rover_xml, rig="oblique", mount="eye", motion="walk")
    T = scene.motion(1.0, 0).T_world_body(0.0)
    assert np.linalg.norm(T[:3, 3] - [0.22, 0, 0.35]) < 0.1
    assert T[0, 2] > 0.9
    assert len(rig) == 2
    assert scene.animate is None


def test_recorded_poses_are_in_the_models_world(rover_xml, tmp_path):
    poses = tmp_path / "poses.txt"
    rows = [f"{k / 100} {-0.5 + k / 100} 0 1 -0.5 0.5 -0.5 0.5" for k in range(30)]
    poses.write_text("\n".join(rows) + "\n")
    config = CONFIG.model_copy(
        update={"duration_s": None, "replay": ReplayConfig(trajectory=poses)}
    )
    scene, _, noted = made(rover_xml, config=config)
    assert noted.replay.place == "world"
    assert scene.duration_s == pytest.approx(0.29)
    simulate(scene, named_rig("oblique"), noted, 0, tmp_path / "out")
    at = Sequence.open(tmp_path / "out").trajectory.at(np.array([150_000]))[0]
    assert np.allclose(at[:3, 3], [-0.35, 0, 1], atol=2e-3)


def test_a_table_of_joints_moves_a_urdf(tmp_path):
    path, table = rover.write_urdf(tmp_path), tmp_path / "neck.csv"
    table.write_text("t_s,neck\n0,0\n0.04,0.1\n")
    config = CONFIG.model_copy(update={"duration_s": None})
    scene, rig, _ = made(path, rig=None, mount="head", motion=str(table), config=config)
    assert rig.name == "davis346"
    assert scene.duration_s == pytest.approx(0.04)
    poses = [scene.motion(0.04, 0).T_world_body(t_s) for t_s in (0.0, 0.04)]
    drawn = [geom.group for geom in scene.spec().geoms]
    assert sorted(drawn)[0] < 3 <= sorted(drawn)[-1]
    turn = np.arccos((np.trace(poses[0][:3, :3].T @ poses[1][:3, :3]) - 1) / 2)
    assert turn == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(("model", "message"), [
    ({}, "nothing moves"),
    ({"motion": "flying"}, "motion 'flying': give dynamics"),
    ({"motion": "walk", "controller": "math:sin"}, "controller needs"),
    ({"motion": "dynamics", "mount": "nose"}, "nothing is called 'nose'"),
    ({"motion": "dynamics", "key": "home"}, "no key frame 'home'"),
    ({"motion": "walk", "mount": "body:kite", "sha256": "1"}, "its SHA-256 is not 1"),
])  # fmt: skip
def test_what_cannot_be_simulated_is_refused(rover_xml, model, message):
    refused(message, made, rover_xml, **model)


@pytest.mark.parametrize(("text", "words"), [
    (None, "no such file"), (rover.MJCF, r"hull|leaves"),
    ("<mujoco><worldbody>", r"scene\.xml is not valid MJCF"),
])  # fmt: skip
def test_files_that_are_no_models_are_refused(tmp_path, text, words):
    path = tmp_path / "scene.xml"
    if text is not None:
        path.write_text(text)
    refused(words, made, path, motion="dynamics")
    refused("mount given for scene desk, but only model files", made, "desk", rig=None, mount="eye")


MIRROR = rover.MJCF.replace('specular="0"/>', 'specular="0" reflectance=".3"/>')
CLIPPED = rover.MJCF.replace('znear="0.002"', 'znear="0.05"')
FAR = rover.MJCF.replace('znear="0.002"', 'znear="0.002" zfar=".2"')
BARE = """<mujoco><worldbody><geom type="plane" size="9 9 1"/>
<camera name="c" pos="0 0 2" xyaxes="0 -1 0 .9 0 .4" resolution="64 48"/></worldbody></mujoco>"""


@pytest.mark.parametrize(("text", "rig", "motion", "words"), [
    (BARE, None, "shake", "few events"), (rover.MJCF, "model:left,right", "dynamics", None),
    (MIRROR, "model:left,right", "dynamics", "a surface is reflective"),
    (CLIPPED, "model:left,right", "dynamics", "may be cut"),
    (FAR, "model:left,right", "dynamics", "have no depth, because their surfaces lie beyond"),
])  # fmt: skip
def test_a_look_around_tells_what_is_wrong(tmp_path, text, rig, motion, words):
    said = []
    made(rover.write(tmp_path, text), rig=rig, said=said, motion=motion)
    assert any(words in line for line in said) if words else said == []


def test_a_rig_that_sees_nothing_is_refused(rover_xml):
    config = CONFIG.model_copy(update={"model": ModelConfig(motion="walk", mount="site:eye")})
    up = named_rig("davis346")
    turned = np.array([[1.0, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1]])
    looking_up = replace(up, T_body_cam=tuple(turned @ T for T in up.T_body_cam))
    words = "no camera of rig davis346 sees a surface"
    refused(words, scene_of, rover_xml, config, looking_up, 0, print)


@pytest.mark.parametrize(("brightness", "floats"), [("0.02", True), ("0.5", False), ("2", True)])
def test_a_look_around_decides_how_light_is_drawn(tmp_path, brightness, floats):
    wall = tmp_path / "wall.xml"
    wall.write_text(
        f'<mujoco><visual><headlight ambient="{brightness} {brightness} {brightness}" '
        'diffuse="0 0 0" specular="0 0 0"/></visual><asset><texture name="t" type="2d" '
        'builtin="checker" rgb1=".9 .9 .9" rgb2=".4 .4 .4" width="64" height="64"/><material '
        'name="m" texture="t" texrepeat="9 9"/></asset><worldbody><geom type="plane" size="9 9 1" '
        'material="m"/><camera name="c" pos="0 0 2" xyaxes="0 -1 0 .9 0 .4" resolution="64 48"/>'
        "</worldbody></mujoco>"
    )
    said = []
    scene, _, config = made(wall, rig=None, said=said, motion="shake")
    assert config.light.floats(scene.hdr) is floats
    assert any("rendered in floating point" in line for line in said) is floats


ROBOT = """<robot name="r"><link name="base"><visual><geometry><box size="1 1 1"/></geometry>
</visual></link><link name="eye"/><joint name="j" type="fixed"><parent link="base"/>
<child link="eye"/><origin xyz="-3 0 0"/></joint></robot>"""


@pytest.mark.parametrize("mount", ["base", "body:eye", "eye", ""])
def test_a_link_that_mujoco_fuses_is_told_of_and_the_cure_works(tmp_path, mount):
    path = tmp_path / "r.urdf"
    path.write_text(ROBOT)
    said = refused("MuJoCo fuses such a link into what it is fixed to", made, path, rig=None,
                   mount=mount, motion="walk")  # fmt: skip
    assert (mount.rpartition(":")[2] or "base") in said
    path.write_text(ROBOT.replace('name="r">', f'name="r">{KEEPS_LINKS}'))
    assert KEEPS_LINKS in said
    scene, _, _ = made(path, rig=None, mount="eye", motion="walk")
    assert scene.carrier == "eye"
    refused("called 'nose' in the model: choose from body:base, body:eye$", made, path, rig=None,
            mount="nose", motion="walk")  # fmt: skip


def test_a_model_without_names_says_so(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text('<mujoco><worldbody><geom size="1"/></worldbody></mujoco>')
    refused("called 'eye' in the model: it has no names, give", made, path, rig=None, mount="eye",
            motion="walk")  # fmt: skip
    path.write_text('<mujoco><worldbody><body name="b"><joint/><geom size="1"/></body></worldbody>'
                    "</mujoco>")  # fmt: skip
    refused("no key frame 'k' in the model: it has none", made, path, rig=None, key="k",
            mount="b", motion="dynamics")  # fmt: skip
