from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import naive_baselines
from eventsweep.emvs.baselines.rectification import Rectified, depth_map, see, see_disparities
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_planes
from point_world import pinhole, sideways, stereo_rig
from refusals import refused

LENSES = (
    Camera(96, 64, 80.0, 81.0, 47.0, 32.0),
    Camera(90, 70, 78.0, 78.0, 46.0, 33.0, "radtan", (-0.2, 0.05, 1e-3, -1e-3)),
    Camera(96, 64, 75.0, 75.0, 49.0, 30.0, "kb4", (0.01, -0.005, 1e-3, 0.0)),
)


def rig_of(seed, degrees=6.0, direction=(1.0, 0.0, 0.0)):
    """Two different cameras, each turned at random, and the second one baseline away."""
    rng = np.random.default_rng(seed)
    poses = []
    for k in range(2):
        turn = Rotation.from_rotvec(np.radians(rng.uniform(-degrees, degrees, 3)))
        offset_m = rng.normal(0, 0.002, 3) + 0.1 * k * np.asarray(direction)
        poses.append(se3.from_rotation(turn, offset_m))
    return Rig("turned", tuple(rng.permutation(np.array(LENSES, object))[:2]), tuple(poses))


def seen_px(stereo, side, points_body):
    """Rectified pixels of points, by geometry alone."""
    points_rect = se3.transform(se3.inverse(stereo.T_body_rect[side]), points_body)
    return stereo.camera.project(points_rect), points_rect[:, 2]


@given(
    seed=st.integers(0, 2**32 - 1),
    direction=st.sampled_from([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0.8, 0.2, 0.3)]),
    order=st.sampled_from([(0, 1), (1, 0)]),
)
def test_partners_share_a_row_and_disparity_says_depth(seed, direction, order):
    rig = rig_of(seed, direction=direction)
    stereo = Rectified.of(rig, *order)
    rng = np.random.default_rng(seed)
    points_body = rng.uniform((-0.4, -0.3, 1.0), (0.4, 0.3, 4.0), (50, 3))
    (left, depth_m), (right, right_m) = (seen_px(stereo, side, points_body) for side in (0, 1))
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)
    np.testing.assert_allclose(depth_m, right_m, rtol=1e-12)
    disparity_px = left[:, 0] - right[:, 0]
    np.testing.assert_allclose(disparity_px, stereo.disparity_px(depth_m), rtol=1e-9)
    assert (disparity_px > 0).all()
    np.testing.assert_allclose(stereo.points_body(left, disparity_px), points_body, atol=1e-9)


@given(seed=st.integers(0, 2**32 - 1))
def test_maps_and_sources_are_inverse_to_each_other(seed):
    rig = rig_of(seed)
    stereo = Rectified.of(rig)
    for side, k in enumerate(stereo.cameras):
        camera = rig.cameras[k]
        columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
        images = [stereo.image(side, image) for image in (columns, rows)]
        u, v = np.rint(stereo.maps[side]).astype(int).reshape(-1, 2).T
        inside = (u > 3) & (v > 3) & (u < stereo.camera.width_px - 4)
        inside &= v < stereo.camera.height_px - 4
        # At the rectified pixel nearest to where a sensor pixel goes, the view shows that pixel
        # to within the rounding.
        for image, sensor in zip(images, (columns.ravel(), rows.ravel()), strict=True):
            well_inside = inside & (columns.ravel() > 2) & (rows.ravel() > 2)
            well_inside &= columns.ravel() < camera.width_px - 3
            well_inside &= rows.ravel() < camera.height_px - 3
            missed = np.abs(image[v[well_inside], u[well_inside]] - sensor[well_inside])
            assert missed.size > 1000
            assert missed.max() < 1.0


def test_a_rig_that_is_rectified_already_stays_as_it_is():
    camera = pinhole()
    stereo = Rectified.of(stereo_rig(camera))
    assert (stereo.camera.width_px, stereo.camera.height_px) == (camera.width_px, camera.height_px)
    np.testing.assert_allclose(stereo.camera.K, camera.K, rtol=1e-12)
    np.testing.assert_allclose(stereo.T_body_rect[0], np.eye(4), atol=1e-12)
    image = np.random.default_rng(0).random((camera.height_px, camera.width_px), np.float32)
    np.testing.assert_allclose(stereo.image(0, image), image, atol=1e-4)
    event = Events(*(np.array([9], t) for t in (np.uint16, np.uint16, np.int64, np.uint8)))
    np.testing.assert_allclose(stereo.events_px(1, event), [[9, 9]], atol=1e-4)


@given(seed=st.integers(0, 2**32 - 1))
def test_depth_in_the_reference_view_is_exact_whatever_the_rig_is_turned_by(seed):
    """A fronto-parallel plane of the reference view comes back at its own depth."""
    rig, config = rig_of(seed), MapperConfig(border_px=0)
    stereo, trajectory = Rectified.of(rig), sideways()
    T_world_rv = trajectory.at(250_000) @ rig.T_body_cam[0]
    view = ReferenceView(
        250_000, T_world_rv, rig.cameras[0].undistorted(), inverse_depth_planes(0.5, 5, 50)
    )
    # Cast the rectified view's rays onto the plane z = 2 m of the reference view, at another time.
    T_world_body = trajectory.at(200_000)
    T_rv_rect = se3.inverse(T_world_rv) @ T_world_body @ stereo.T_body_rect[0]
    bearing = stereo.camera.bearing_table()
    rays_rect = np.concatenate([bearing, np.ones_like(bearing[..., :1])], axis=-1)
    along = rays_rect @ T_rv_rect[2, :3]
    depth_rect_m = (2.0 - T_rv_rect[2, 3]) / along
    disparity_px = stereo.disparity_px(depth_rect_m).astype(np.float32)
    posed = SimpleNamespace(trajectory=trajectory)
    seen = see_disparities(disparity_px, disparity_px, stereo, 200_000, posed, view)
    assert seen.mask.mean() > 0.4
    np.testing.assert_allclose(seen.depth_m[seen.mask], 2.0, rtol=1e-5)
    found = depth_map("x", seen.depth_m, seen.value, view, config)
    assert found.points == seen.mask.sum()
    assert np.isfinite(found.depth_m).all()
    assert set(np.unique(found.argmax[found.mask])) == {int(np.argmin(np.abs(view.rho - 0.5)))}


@given(seed=st.integers(0, 2**32 - 1), n=st.integers(0, 60))
def test_the_nearest_point_wins(seed, n):
    rng = np.random.default_rng(seed)
    camera = Camera(8, 6, 5.0, 6.0, 3.4, 2.6)
    view = ReferenceView(0, np.eye(4), camera, np.array([1, 0.5], np.float32))
    points = rng.uniform((-2, -2, -1), (2, 2, 3), (n, 3)).round(1)
    points[rng.random(n) < 0.1] = np.nan
    values = rng.random(n)
    best = naive_baselines.nearest_points(points, values, camera.K.tolist(), 8, 6)
    seen = see(points, values, view)
    assert {tuple(place) for place in np.argwhere(seen.mask).tolist()} == set(best)
    for place, (z, value) in best.items():
        assert seen.depth_m[place] == pytest.approx(z, rel=1e-6)
        assert seen.value[place] == pytest.approx(value, rel=1e-6)


def test_depths_beyond_the_planes_are_left_out():
    rho = inverse_depth_planes(1.0, 4.0, 31)
    view = ReferenceView(0, np.eye(4), Camera(4, 1, 5.0, 5.0, 2.0, 0.0), rho)
    depth_m = np.array([[0.9, 1.0, 4.0, 5.0]], np.float32)
    found = depth_map("x", depth_m, np.ones((1, 4), np.float32), view, MapperConfig(border_px=0))
    assert found.mask.tolist() == [[False, True, True, False]]
    assert found.argmax[0, 1:3].tolist() == [0, 30]


def steep(degrees):
    T = np.eye(4)
    T[:3, 3] = 0.1 * np.cos(np.radians(degrees)), 0, 0.1 * np.sin(np.radians(degrees))
    return Rig("steep", (pinhole(),) * 2, (np.eye(4), T))


def turned(*degrees):
    """Cameras side by side, turned about their vertical axes."""
    turns = [Rotation.from_rotvec([0, np.radians(angle), 0]) for angle in degrees]
    poses = tuple(se3.from_rotation(turn, [0.1 * k, 0, 0]) for k, turn in enumerate(turns))
    return Rig("turned", (pinhole(),) * 2, poses)


@pytest.mark.parametrize(("rig", "pair", "words"), [
    (steep(55), (), r"leaves the image plane by 55\.0 degrees"),
    (turned(-70, 70), (), r"optical axis deviates from the mean one by 70\.0 degrees"),
    (turned(0, 180), (), "degrees"), (stereo_rig(pinhole(), cameras=1), (), "has 1 camera"),
    (stereo_rig(pinhole()), (0, 2), "cameras 0 and 2"),
    (stereo_rig(pinhole(), 0.0), (), "at the same point"),
])  # fmt: skip
def test_pairs_that_cannot_be_rectified_are_refused(rig, pair, words):
    assert Rectified.of(steep(30)).baseline_m == pytest.approx(0.1)
    refused(words, Rectified.of, rig, *pair)
