"""A recorded trajectory in a scene: where it goes, what is refused, what is written down."""

import json
import pickle
from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import mujoco_scenes as made
from eventsweep.emvs.data.poses import read_poses, write_tum
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets.custom import read_hand_eye
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.sim.config import ReplayConfig, SimConfig
from eventsweep.sim.motion.curves import look_at, sampled
from eventsweep.sim.motion.head_motion import six_dof
from eventsweep.sim.scene import replayed
from eventsweep.sim.simulate import describe, make_job, simulate
from mujoco_scenes import Killed, stop_at
from refusals import refused

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def tum(folder):
    """A recorded head: 120 Hz, from some pose of its own world."""
    head = sampled(six_dof(3.0, seed=4), 3.0, rate_hz=120)
    T_world_head = look_at((4, -2, 1), (5, 1, 1)) @ se3.inverse(look_at((0, 0, 0), (1, 0, 0)))
    poses = T_world_head @ se3.from_quat_xyzw(head.positions_m, head.quats_xyzw)
    path = folder / "head.txt"
    write_tum(path, Trajectory.from_matrices(head.t_us + 17_000_000, poses))
    return path


def config_of(path, duration_s=0.02, **settings):
    return SimConfig(duration_s=duration_s, replay=ReplayConfig(trajectory=path, **settings))


def motion_of(scene, path, **settings):
    moving, _ = replayed(scene, config_of(path, **settings))
    return moving.motion(0.5, 0)


def recorded_poses(path, start_s, times_s):
    recorded = read_poses(path)
    return recorded.at(recorded.t_us[0] + np.rint((start_s + times_s) * 1e6).astype(np.int64))


TIMES_S = np.arange(0, 0.5, 1 / 120)


def test_the_stored_poses_are_the_recorded_ones_carried_to_the_scenes_start(folder, scene, tum):
    """Within 0.3 mm and 0.5 mrad: the bound on what smoothing at 10 Hz takes from a head."""
    out = simulate(scene, made.tiny_rig(), config_of(tum, start_s=1.0), 0, folder / "s")
    sequence = Sequence.open(out)
    t_us = np.array([0, 8_000, 16_000, 20_000])
    recorded = recorded_poses(tum, 1.0, t_us * 1e-6)
    expected = scene.motion(0.02, 0).T_world_body(0) @ se3.inverse(recorded[0]) @ recorded
    found = sequence.trajectory.at(t_us)
    assert np.abs(found[:, :3, 3] - expected[:, :3, 3]).max() < 3e-4
    turn = Rotation.from_matrix(np.swapaxes(found[:, :3, :3], 1, 2) @ expected[:, :3, :3])
    assert turn.magnitude().max() < 5e-4
    saved = sequence.manifest.configuration["replay"]
    assert saved["trajectory"] == str(tum)
    assert len(saved["sha256"]) == 64
    assert saved["start_s"] == 1.0


def test_in_its_own_world_a_trajectory_stays_where_it_was(scene, tum):
    poses = motion_of(scene, tum, place="world", start_s=0.5).poses(TIMES_S)
    expected = recorded_poses(tum, 0.5, TIMES_S)
    assert np.abs(poses[:, :3, 3] - expected[:, :3, 3]).max() < 5e-4
    turn = Rotation.from_matrix(np.swapaxes(poses[:, :3, :3], 1, 2) @ expected[:, :3, :3])
    assert turn.magnitude().max() < 1e-3


def test_level_keeps_the_tilt_and_takes_the_scenes_place_and_heading(scene, tum):
    as_recorded = motion_of(scene, tum, place="world").poses(TIMES_S)
    level = motion_of(scene, tum, place="level").poses(TIMES_S)
    own = scene.motion(0.5, 0).T_world_body(0)
    np.testing.assert_allclose(level[0, :3, 3], own[:3, 3], atol=1e-9)
    np.testing.assert_allclose(level[:, 2, :3], as_recorded[:, 2, :3], atol=1e-9)
    np.testing.assert_allclose(np.arctan2(*level[0, 1::-1, 2]), np.arctan2(*own[1::-1, 2]))


def test_scale_shift_and_heading(scene, tum):
    plain = motion_of(scene, tum).poses(TIMES_S)
    own = plain[0, :3, 3]
    scaled = motion_of(scene, tum, scale=0.5).poses(TIMES_S)
    np.testing.assert_allclose(scaled[:, :3, 3] - own, 0.5 * (plain[:, :3, 3] - own), atol=1e-9)
    np.testing.assert_allclose(scaled[:, :3, :3], plain[:, :3, :3], atol=1e-9)
    quarter = motion_of(scene, tum, shift_m=(1, 2, 3), heading_deg=90).poses(TIMES_S)
    np.testing.assert_allclose(quarter[0, :3, 3], own + np.array([1, 2, 3]), atol=1e-9)
    R = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    np.testing.assert_allclose(quarter[:, :3, :3], R @ plain[:, :3, :3], atol=1e-9)
    away = (plain[:, :3, 3] - own) @ R.T
    np.testing.assert_allclose(quarter[:, :3, 3] - quarter[0, :3, 3], away, atol=1e-9)


def test_a_view_straight_down_has_no_heading(folder, scene):
    down = Rotation.from_euler("x", 180, degrees=True).as_quat()
    path = folder / "down.txt"
    times_us = np.arange(100, dtype=np.int64) * 10_000
    write_tum(path, Trajectory(times_us, np.zeros((100, 3)), np.tile(down, (100, 1))))
    refused("straight up or down", motion_of, scene, path, place="level")


def test_a_gap_counts_only_where_it_is_replayed(folder, scene, tum):
    recorded = read_poses(tum)
    late = np.arange(len(recorded)) > 300
    t_us = recorded.t_us + np.where(late, 128_000, 0)
    path = folder / "gap.txt"
    write_tum(path, Trajectory(t_us, recorded.positions_m, recorded.quats_xyzw))
    assert motion_of(scene, path, start_s=0.1).duration_s == pytest.approx(0.5)
    for start_s in (1.2, 2.3, 2.6):
        words = [r"a gap of 0\.136 s 2\.500 s .* 300 and 301", "raise max_gap_s"]
        refused(words, motion_of, scene, path, start_s=start_s)
    across = motion_of(scene, path, start_s=2.3, max_gap_s=0.14)
    assert across.duration_s == pytest.approx(0.5)


def test_the_replayed_part_is_that_of_the_whole(scene, tum):
    whole = replayed(scene, config_of(tum, place="world"))[0].motion(3.0, 0)
    part = motion_of(scene, tum, place="world", start_s=1.7)
    np.testing.assert_allclose(part.poses(TIMES_S), whole.poses(1.7 + TIMES_S), atol=1e-5)


def test_the_hash_is_checked_where_it_is_given(scene, tum):
    _, noted = replayed(scene, config_of(tum))
    again = replayed(scene, noted)[1]
    assert again == noted
    other = noted.replay.model_copy(update={"sha256": "0" * 64})
    refused("SHA-256 is not 000", replayed, scene, noted.model_copy(update={"replay": other}))


def test_work_of_another_trajectory_under_the_same_name_is_not_taken_up(folder, scene, tum):
    path, out = folder / "changing.txt", folder / "changed"
    path.write_bytes(tum.read_bytes())
    config = config_of(path, duration_s=0.05)
    with pytest.raises(Killed):
        simulate(scene, made.tiny_rig(), config, 0, out, commit_s=0, progress=stop_at(20_000))
    path.write_text(tum.read_text().replace("17.000000 ", "17.000001 "))
    refused("resume=False", simulate, scene, made.tiny_rig(), config, 0, out)


def test_a_replaying_job_reaches_other_processes_whole(scene, tum):
    job = make_job(scene, made.tiny_rig(), config_of(tum), 0)
    sent = pickle.loads(pickle.dumps(job))
    np.testing.assert_array_equal(sent.motion().poses([0.01]), job.motion().poses([0.01]))


T_BODY_CAM = look_at((0.06, 0.01, -0.02), (1, 0.2, 0))


def test_hand_eye_files(folder, scene, tum):
    plain = folder / "hand_eye.json"
    plain.write_text(json.dumps({"T_body_cam": T_BODY_CAM.tolist()}))
    np.testing.assert_allclose(read_hand_eye(plain), T_BODY_CAM, atol=1e-12)
    as_recorded = motion_of(scene, tum, place="world").poses(TIMES_S)
    turned = motion_of(scene, tum, place="world", hand_eye=plain).poses(TIMES_S)
    np.testing.assert_allclose(turned, as_recorded @ T_BODY_CAM, atol=1e-6)


@pytest.mark.parametrize(("text", "message"), [
    ("{}", "T_body_cam"), ("[", "not valid JSON"),
    ('{"T_body_cam": [[1, 2], [3]]}', "T_body_cam"),
    (json.dumps({"T_body_cam": (2 * np.eye(4)).tolist()}), "rigid"),
    ('{"value0": {"T_imu_marker": {"px": 0}}}', "T_imu_marker"),
    ('{"value0": 3}', "T_body_cam"),
])  # fmt: skip
def test_bad_hand_eye_files_are_refused(folder, text, message):
    path = folder / "bad.json"
    path.write_text(text)
    refused(message, read_hand_eye, path)


def test_one_calibration_without_the_other_is_refused(scene, tum, shared_data):
    marker = shared_data / "tumvie/mocap-imu-calibrationA.json"
    refused("imu_cam", read_hand_eye, marker)
    refused("give both", motion_of, scene, tum, imu_cam=marker)


@pytest.mark.parametrize("which", ["A", "B"])
def test_a_real_hand_eye_puts_the_camera_a_hand_from_the_marker(shared_data, which):
    """All that the calibrations can tell by themselves: rigid, and 10 to 20 cm apart."""
    at = shared_data / "tumvie"
    marker, cameras = f"mocap-imu-calibration{which}.json", f"camera-calibration{which}.json"
    T_marker_cam = read_hand_eye(at / marker, at / cameras)
    assert se3.is_rigid(T_marker_cam, 1e-9)
    assert 0.1 < np.linalg.norm(T_marker_cam[:3, 3]) < 0.2


@pytest.mark.parametrize("name", ["tumvie/mocap-6dof", "tumvie/mocap-desk", "rpg_eccv18/boxes"])
def test_recorded_heads_are_upright_without_a_hand_eye(shared_data, name):
    """So these files hold poses of the camera, not of a marker: y is down, z far from upright."""
    recorded = read_poses(shared_data / f"{name}.tum.txt")
    poses = se3.from_quat_xyzw(recorded.positions_m, recorded.quats_xyzw)
    assert poses[:, 2, 1].mean() < -0.9
    assert np.abs(poses[:, 2, 2].mean()) < 0.4


def test_a_recorded_car_drives_where_its_camera_looks(shared_data):
    recorded = read_poses(shared_data / "dsec/zurich_city_04_a/poses.tum.txt")
    poses = se3.from_quat_xyzw(recorded.positions_m, recorded.quats_xyzw)
    step = np.einsum("nji,nj->ni", poses[:-1, :3, :3], np.diff(recorded.positions_m, axis=0))
    length = np.linalg.norm(step, axis=1)
    assert (step[length > 0.3] / length[length > 0.3, None]).mean(axis=0)[2] > 0.99


@pytest.mark.parametrize(("name", "limits"), [
    ("tumvie/mocap-6dof", {}), ("rpg_eccv18/boxes", {}),
    ("mvsec/indoor_flying1", {"max_gap_s": 0.13, "position_hz": 2, "rotation_hz": 2}),
    (
        "dsec/zurich_city_04_a/poses",
        {"max_gap_s": 0.11, "max_speed_m_s": 20, "position_hz": 1, "rotation_hz": 1},
    ),
])  # fmt: skip
def test_real_trajectories_replay_as_a_body_that_can_move_so(shared_data, scene, name, limits):
    path = shared_data / f"{name}.tum.txt"
    motion = motion_of(scene, path, start_s=10.0, **limits)
    moving = motion.kinematics(np.linspace(0, 0.5, 200))
    assert np.linalg.norm(moving.acceleration_m_s2, axis=1).max() < 10
    assert np.linalg.norm(moving.angular_velocity_rad_s, axis=1).max() < 5
    np.testing.assert_allclose(motion.T_world_body(0), scene.motion(0.5, 0).T_world_body(0))


@pytest.mark.slow
def test_the_command_line_replays(folder, tum):
    from eventsweep.eval.cli.main import main

    out = folder / "cli"
    flags = ["--trajectory", str(tum), "--sim.replay.start-s", "1", "--seconds", "0.02"]
    assert main(["simulate", "planes", "--out", str(out), *flags, "--quiet"]) == 0
    sequence = Sequence.open(out)
    step = se3.inverse(sequence.trajectory.at(0)) @ sequence.trajectory.at(20_000)
    recorded = recorded_poses(tum, 1.0, np.array([0, 0.02]))
    np.testing.assert_allclose(step, se3.inverse(recorded[0]) @ recorded[1], atol=5e-4)
    bad = [*flags, "--sim.replay.max-gap-s", "0.002", "--force"]
    assert main(["simulate", "planes", "--out", str(out), *bad, "--quiet"]) == 2


@dataclass(frozen=True)
class Sliding:
    """Moves the one slide joint of a scene at a steady speed."""

    speed_m_s: float
    max_interval_us: int = 5_000

    def __call__(self, model, data, t_s):
        data.qpos[0] = self.speed_m_s * t_s


def test_the_key_of_unfinished_work_knows_how_bodies_move(folder, scene):
    mjcf = folder / "sliding.xml"
    body = '<body><joint type="slide"/><geom name="free" size=".05" pos="1 0 1"/></body>'
    mjcf.write_text(scene.mjcf.read_text().replace("</worldbody>", body + "</worldbody>"))

    def key(animate):
        moving = replace(scene, mjcf=mjcf, animate=animate)
        job = make_job(moving, made.tiny_rig(), SimConfig(duration_s=0.02), 0)
        with job.renderer() as renderer:
            return describe(job, renderer)[1]

    assert key(Sliding(1.0)) == key(Sliding(1.0))
    assert len({key(Sliding(1.0)), key(Sliding(1.001)), key(Sliding(1.0, 4_000)), key(None)}) == 4
