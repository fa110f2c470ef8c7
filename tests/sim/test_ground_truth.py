"""Ground truth: flow, boundaries, twist, geoms, depth per event, and both cameras' agreement."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import mujoco_scenes as made
import naive_truth
from eventsweep import scenes
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.sim import ground_truth
from eventsweep.sim.config import SimConfig
from eventsweep.sim.geoms import geom_table
from eventsweep.sim.motion.curves import HeadSway, look_at
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.simulate import simulate
from made_events import random_events
from refusals import refused
from warped_depth import warped

EVERYTHING = ("flow", "segmentation", "boundary", "twist", "event_depth")
CONFIG = SimConfig(truth_interval_s=0.02, truth_times_s=(0.007,), truth=EVERYTHING)
CAMERAS = [
    Camera(13, 11, 20, 22, 5.5, 4.5),
    Camera(13, 11, 20, 22, 5.5, 4.5, "radtan", (-0.2, 0.05, 0.001, -0.002)),
    Camera(13, 11, 12, 12, 6.5, 5.0, "kb4", (0.05, -0.01, 0.002, 0.0)),
]


@pytest.fixture(scope="module")
def made_sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("truth")
    scene = made.noise_scene(folder)
    out = simulate(scene, made.small_rig(), CONFIG, 0, folder / "s")
    return Sequence.open(out), scene.motion(0.05, 0)


def some_pose(seed: int, size: float) -> np.ndarray:
    rng = np.random.default_rng(seed)
    pose = look_at((0, 0, 0), (1, 0, 0))
    waves = HeadSway.seeded(pose, (size,) * 3, (30 * size,) * 3, (1.0,), seed)
    return se3.inverse(waves.T_world_body(0.0)) @ waves.T_world_body(rng.uniform(0, 1))


@given(st.integers(0, 2**31), st.sampled_from(CAMERAS))
def test_flow_equals_its_twin(seed, camera):
    rng = np.random.default_rng(seed)
    depth_m = rng.uniform(0.3, 5, (11, 13)).astype(np.float32)
    depth_m[2, 3:7] = np.inf
    T_later_now = some_pose(seed, 0.3)
    flow = ground_truth.flow_px(camera, camera.bearing_table(), depth_m, T_later_now)
    expected = naive_truth.flow_px(camera, depth_m, T_later_now)
    np.testing.assert_allclose(flow, expected, rtol=1e-5, atol=1e-4)


def test_stored_flow_is_the_motion_of_known_points(made_sequence):
    """The wall's face is the plane x = 2.4: its points come from there, not from the depth."""
    sequence, motion = made_sequence
    times_us = sequence.truth_times_us(0).tolist()
    assert times_us == [0, 7_000, 20_000, 25_000, 40_000, 50_000]
    for k, camera in enumerate(sequence.rig.cameras):
        for now_us, later_us in pairwise(times_us):
            now, later = (
                motion.T_world_body(t * 1e-6) @ sequence.rig.T_body_cam[k]
                for t in (now_us, later_us)
            )
            on_wall = sequence.truth_segmentation(k, now_us) == 1
            rows, columns = np.nonzero(on_wall)
            bearing = camera.unproject(np.stack([columns, rows], -1))
            rays = np.column_stack([bearing, np.ones(len(rows))]) @ now[:3, :3].T
            points = now[:3, 3] + rays * ((2.4 - now[0, 3]) / rays[:, :1])
            moved = camera.project(se3.transform(se3.inverse(later), points))
            expected = moved - np.stack([columns, rows], -1)
            assert on_wall.sum() > 1000
            stored = sequence.truth_flow_px(k, now_us)[on_wall]
            assert np.abs(stored - expected).max() < 1e-3
            assert np.abs(stored).max() > 0.1
        assert np.isnan(sequence.truth_flow_px(k, times_us[-1])).all()


def test_flow_leads_to_the_same_surface_later(made_sequence):
    """Followed by its flow, a pixel finds the depth there that its point has then."""
    sequence, motion = made_sequence
    camera = sequence.rig.cameras[0]
    now, later = (motion.T_world_body(t * 1e-6) for t in (0, 7_000))
    depth_m, flow = sequence.truth_depth_m(0, 0), sequence.truth_flow_px(0, 0)
    rows, columns = np.nonzero(~sequence.truth_boundary(0, 0))
    landed = np.stack([columns, rows], -1) + flow[rows, columns]
    u, v = np.rint(landed).astype(int).T
    inside = (u >= 0) & (u < camera.width_px) & (v >= 0) & (v < camera.height_px)
    inside[inside] &= ~sequence.truth_boundary(0, 7_000)[v[inside], u[inside]]
    bearing = camera.unproject(np.stack([columns, rows], -1).astype(float))
    points = np.column_stack([bearing, np.ones(len(rows))]) * depth_m[rows, columns, None]
    z_later = se3.transform(se3.inverse(later) @ now, points)[:, 2]
    there = sequence.truth_depth_m(0, 7_000)[v[inside], u[inside]]
    assert inside.mean() > 0.9
    # Half a pixel of rounding changes the depth of the slanted box by up to a percent.
    assert np.quantile(np.abs(there / z_later[inside] - 1), 0.999) < 0.01


@given(st.integers(0, 2**31))
def test_boundary_equals_its_twin(seed):
    rng = np.random.default_rng(seed)
    depth_m = rng.choice([1.0, 1.01, 1.05, 3.0, np.inf], (7, 9), p=[0.4, 0.2, 0.2, 0.1, 0.1])
    depth_m = depth_m.astype(np.float32)
    assert (ground_truth.boundary(depth_m) == naive_truth.boundary(depth_m, 0.02)).all()


def test_boundary_is_both_sides_of_a_step_and_nothing_on_planes_and_folds():
    v, u = np.mgrid[:40, :60].astype(float)
    floor_m = (1 / (0.1 + 0.005 * v)).astype(np.float32)
    assert not ground_truth.boundary(floor_m).any()
    folded_m = (1 / np.maximum(0.3, 0.2 + 0.005 * v)).astype(np.float32)
    assert not ground_truth.boundary(folded_m).any()
    stepped_m = np.where(u < 20, 1.0, 1.1).astype(np.float32)
    assert (ground_truth.boundary(stepped_m) == np.isin(u, (19, 20))).all()
    cable_m = np.where(v == 7, 1.0, np.inf).astype(np.float32)
    assert (ground_truth.boundary(cable_m) == np.isin(v, (6, 7, 8))).all()
    crossing_m = np.where((v == 7) | (u == 9), 1.0, np.inf).astype(np.float32)
    assert (
        ground_truth.boundary(crossing_m) == (np.isin(v, (6, 7, 8)) | np.isin(u, (8, 9, 10)))
    ).all()


@pytest.mark.parametrize("t_s", [0.0, 0.3, 1.0])
def test_twist_is_that_of_a_known_motion(t_s):
    """A rig turning at a constant rate about a point 0.2 m beside the camera."""
    rate_rad_s = np.array([0.3, -1.2, 0.7])
    T_body_cam = some_pose(1, 0.2)

    class Turning:
        def T_world_body(self, t_s):
            from scipy.spatial.transform import Rotation

            pose = np.eye(4)
            pose[:3, :3] = Rotation.from_rotvec(rate_rad_s * t_s).as_matrix()
            pose[:3, 3] = np.array([0.5, 0.1, -0.2]) * t_s
            return pose

    T_world_cam = Turning().T_world_body(t_s) @ T_body_cam
    arm = Turning().T_world_body(t_s)[:3, :3] @ T_body_cam[:3, 3]
    # The axis stands still, so that the rate is the same in world and body.
    linear = np.array([0.5, 0.1, -0.2]) + np.cross(rate_rad_s, arm)
    expected = np.concatenate([linear, rate_rad_s]).reshape(2, 3) @ T_world_cam[:3, :3]
    found = ground_truth.twist(Turning(), T_body_cam, t_s, 1.0)
    np.testing.assert_allclose(found, expected.ravel(), atol=1e-6)


def test_stored_twist_predicts_the_stored_poses(made_sequence):
    sequence, _ = made_sequence
    for t_us in (0, 7_000, 50_000):
        step_us = 1000 if t_us < 50_000 else -1000
        for k in range(2):
            T_body_cam = sequence.rig.T_body_cam[k]
            now, then = (sequence.trajectory.at(t) @ T_body_cam for t in (t_us, t_us + step_us))
            moved_m = (se3.inverse(now) @ then)[:3, 3]
            twist = sequence.truth_twist(k, t_us)
            assert np.linalg.norm(moved_m - twist[:3] * step_us * 1e-6) < 0.05 * np.linalg.norm(
                moved_m
            )


def test_geoms_are_named_and_what_hangs_on_a_joint_is_dynamic(tmp_path):
    built = made.spec(
        '<geom name="floor" type="plane" size="1 1 1"/>'
        '<body name="table"><geom type="box" size="1 1 1"/></body>'
        '<body name="ball"><freejoint/><geom type="sphere" size=".1"/>'
        '<body name="fin"><geom type="box" size=".1 .1 .1"/></body></body>'
        '<geom type="box" size="1 1 1"/>'
    )
    table = geom_table(built.compile())
    assert [(g.name, g.dynamic) for g in table.values()] == [
        ("floor", False), ("geom1", False), ("table", False), ("ball", True), ("fin", True),
    ]  # fmt: skip


def test_segmentation_names_what_is_seen(made_sequence):
    sequence, _ = made_sequence
    for k in range(2):
        depth_m, ids = sequence.truth_depth_m(k, 25_000), sequence.truth_segmentation(k, 25_000)
        assert set(np.unique(ids)) == {0, 1}
        assert depth_m[ids == 0].max() < 1.3 < depth_m[ids == 1].min()
        assert not sequence.truth_dynamic(k, 25_000).any()
        # The box's outline is a boundary; the wall and the box's faces are not.
        outline = np.zeros(ids.shape, bool)
        for axis in (0, 1):
            changed = np.diff(ids, axis=axis) != 0
            pad = [(0, 0), (0, 0)]
            for pad[axis] in ((1, 0), (0, 1)):
                outline |= np.pad(changed, pad)
        marked = sequence.truth_boundary(k, 25_000)
        assert marked[outline].all()
        # A face of the box seen edge on, one pixel wide, is a step as well.
        near = np.pad(outline, 1)
        near = near[1:-1, :-2] | near[1:-1, 2:] | near[1:-1, 1:-1]
        assert near[marked].all()
    assert [geom.dynamic for geom in sequence.geoms.values()] == [False, False]


def test_every_event_lies_on_the_surface_that_made_it(made_sequence):
    sequence, _ = made_sequence
    for k in range(2):
        count = sequence.event_count(k)
        points = sequence.event_points_world(k, 0, 50_001)
        assert len(points) == count > 1000
        # The pixel's nearest sample lies up to 0.35 px beside its centre: 0.4 % at 100 px.
        wall = np.abs(points[:, 0] - 2.4) < 0.01
        box = (np.abs(points - (1, 0.1, 1)) < 0.1 + 0.012).all(1)
        assert (wall | box).all()
        assert min(wall.sum(), box.sum()) > 200


@given(st.integers(0, 2**31))
def test_event_depth_equals_its_twin(seed):
    rng = np.random.default_rng(seed)
    before_m = rng.choice([1.0, 1.5, np.inf], (5, 7)).astype(np.float32)
    after_m = (before_m * rng.uniform(0.985, 1.015, (5, 7))).astype(np.float32)
    after_m[rng.random((5, 7)) < 0.2] = 0.7
    events = random_events(rng, 20, 7, 5, 50, 901)
    depth_m = ground_truth.event_depth_m(before_m, after_m, (100, 900), events)
    expected = naive_truth.depth_at_events(before_m, after_m, 100, 900, events, 0.02)
    np.testing.assert_allclose(depth_m, expected, rtol=1e-6)


@pytest.mark.parametrize(("shape", "span_us", "message"), [
    ((5, 6), (100, 900), "one shape"), ((5, 7), (900, 900), "rising times"),
    ((5, 7), (100, 900), "column 7 and row 2"),
])  # fmt: skip
def test_event_depth_refuses_what_does_not_belong_together(shape, span_us, message):
    events = Events(*(np.array([v], d) for v, d in ((7, "u2"), (2, "u2"), (500, "i8"), (1, "u1"))))
    before_m, after_m = np.ones((5, 7), np.float32), np.ones(shape, np.float32)
    refused(message, ground_truth.event_depth_m, before_m, after_m, span_us, events)


def test_what_was_not_asked_for_is_refused_by_name(tmp_path):
    config = SimConfig(duration_s=0.002, truth=("twist",))
    out = simulate(made.noise_scene(tmp_path), made.tiny_rig(), config, 0, tmp_path / "s")
    sequence = Sequence.open(out)
    assert sequence.truth_names(0) == ("twist",)
    for read in (sequence.truth_flow_px, sequence.truth_segmentation, sequence.truth_boundary):
        refused("simulate with it in `truth`", read, 0, 0)
    refused("no depth_m per event", sequence.event_depth_m, 0, 0, 2000)
    refused("no label per event", sequence.labels, 0, 0, 2000)
    with pytest.raises(InputError, match="segmentation"):
        _ = sequence.geoms


def lens_rig():
    """The small rig behind lenses: barrel distortion and a fisheye."""
    rig = made.small_rig()
    left = replace(rig.cameras[0], model="radtan", distortion=(-0.25, 0.08, 0.001, -0.002))
    right = replace(rig.cameras[1], model="kb4", distortion=(-0.02, 0.01, -0.004, 0.001))
    return replace(rig, cameras=(left, right))


def test_truth_behind_lenses(tmp_path):
    """Depth on the sensor and in the undistorted view show one world; flow knows the lens."""
    scene, rig = made.noise_scene(tmp_path), lens_rig()
    config = SimConfig(duration_s=0.01, truth=("flow", "segmentation", "boundary"))
    sequence = Sequence.open(simulate(scene, rig, config, 0, tmp_path / "s"))
    for k, camera in enumerate(rig.cameras):
        depth_m, view_m = sequence.truth_depth_m(k, 0), sequence.truth_view_depth_m(k, 0)
        assert not np.array_equal(depth_m, view_m)
        on_wall = (sequence.truth_segmentation(k, 0) == 1) & ~sequence.truth_boundary(k, 0)
        now, later = (
            scene.motion(0.01, 0).T_world_body(t_s) @ rig.T_body_cam[k] for t_s in (0.0, 0.005)
        )
        for seen, depth in ((camera, depth_m), (camera.undistorted(), view_m)):
            rays = np.dstack([seen.bearing_table(), np.ones(depth.shape)]) @ now[:3, :3].T
            wall_m = (2.4 - now[0, 3]) / rays[..., 0]
            far = (depth > 1.5) & np.isfinite(depth)
            assert far.sum() > 5000
            assert np.abs(depth / wall_m - 1)[far].max() < 2e-4
        points = (
            now[:3, 3]
            + (np.dstack([camera.bearing_table(), np.ones(depth_m.shape)]) @ now[:3, :3].T)[on_wall]
            * depth_m[on_wall][:, None]
        )
        rows, columns = np.nonzero(on_wall)
        moved = camera.project(se3.transform(se3.inverse(later), points))
        flow = sequence.truth_flow_px(k, 0)[on_wall]
        assert np.abs(flow - (moved - np.stack([columns, rows], -1))).max() < 1e-3
    assert np.array_equal(
        truth_of(sequence, 0, EvalConfig()).depth_m, sequence.truth_view_depth_m(0, 0)
    )


def test_both_cameras_see_one_world_through_lenses(tmp_path):
    scene, rig = made.noise_scene(tmp_path), lens_rig()
    pose = scene.motion(0.05, 0).T_world_body(0.02)
    with StereoRenderer(scene.spec(), rig, 2, scene.depth_range_m) as renderer:
        for result in consistent(rig, pose, renderer):
            assert result.seen > 0.4
            assert result.error_px.max() < 0.5


def consistent(rig, T_world_body, renderer):
    """The law for all ordered pairs of cameras; returns the shares of pixels seen by both."""
    depths_m = [renderer.depth(k, T_world_body) for k in range(len(rig))]
    for a, b in ((0, 1), (1, 0)):
        yield warped(rig, a, b, depths_m[a], depths_m[b])


def test_both_cameras_see_one_world_small(made_sequence, tmp_path):
    scene = made.noise_scene(tmp_path)
    rig, pose = made.small_rig(), scene.motion(0.05, 0).T_world_body(0.02)
    with StereoRenderer(scene.spec(), rig, 1, scene.depth_range_m) as renderer:
        for result in consistent(rig, pose, renderer):
            assert result.seen > 0.5
            assert result.error_px.max() < 0.5


def test_both_cameras_see_one_world_desk():
    scene, rig = scenes.load("desk"), named_rig("davis346")
    with StereoRenderer(scene.spec(), rig, 1, scene.depth_range_m) as renderer:
        for result in consistent(rig, scene.motion(0.5, 0).T_world_body(0.25), renderer):
            assert result.seen > 0.6
            assert result.error_px.max() < 0.5


@pytest.mark.parametrize(("geom", "inside"), [
    ('type="box" size=".2 .3 .1" pos=".15 .2 1" euler="0 0 10"', True),
    ('type="box" size=".2 .3 .1" pos=".35 .2 1" euler="0 0 10"', False),
    ('type="sphere" size=".2" pos="0 .15 1"', True),
    ('type="sphere" size=".2" pos="0 .15 1.2"', False),
    ('type="ellipsoid" size=".2 .4 .1" pos="0 .3 1"', True),
    ('type="ellipsoid" size=".2 .4 .1" pos=".1 .38 1"', False),
    ('type="cylinder" size=".2 .4" pos="0 0 1.35"', True),
    ('type="cylinder" size=".2 .4" pos=".15 .15 1.35"', False),
    ('type="capsule" size=".2 .4" pos="0 0 1.5"', True),
    ('type="capsule" size=".2 .4" pos="0 0 1.65"', False),
    ('type="box" size=".2 .3 .1" pos="0 0 1" rgba="1 1 1 0"', False),
    ('type="mesh" mesh="wedge" pos="0 0 1"', True),
    ('type="mesh" mesh="wedge" pos=".3 0 1"', False),
])  # fmt: skip
def test_a_rig_that_starts_inside_an_object_is_refused(tmp_path, geom, inside):
    scene = made.noise_scene(tmp_path)
    mesh = '<asset><mesh name="wedge" vertex="-.2 -.2 -.2 .2 -.2 -.2 0 .3 -.2 0 0 .4"/></asset>'
    body = f'{mesh}<worldbody><geom name="in" {geom}/>'
    scene.mjcf.write_text(scene.mjcf.read_text().replace("<worldbody>", body))
    pose = look_at((0, 0, 1), (2, 0, 1))
    still = replace(scene, motion=lambda *_: HeadSway(pose, ()))
    call = (still, made.tiny_rig(), SimConfig(duration_s=0.001), 0, tmp_path / "s")
    if inside:
        refused("starts inside 'in'", simulate, *call)
    else:
        simulate(*call)
    assert (tmp_path / "s").exists() is not inside
