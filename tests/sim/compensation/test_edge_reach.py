"""Which pixels can need layers: as many as when everything is walked, and few others."""

from typing import NamedTuple

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy import ndimage

from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.compensation import layer_search_kernels as search
from eventsweep.sim.compensation.edge_reach_kernels import Seen, distances, within_reach
from eventsweep.sim.compensation.interval import interval_between, lens_of
from eventsweep.sim.compensation.path_kernels import TO_FIRST_END, TO_SECOND_START, View
from eventsweep.sim.compensation.range_kernels import cell_depths
from eventsweep.sim.rendering.lens import widened_camera
from eventsweep.sim.rendering.moving_bodies import BodyPixels
from painted_planes import pose, rays_through

GRID, BORDER = 3, 8
SIZE = WIDTH, HEIGHT = 40, 30
CAMERAS = {
    "pinhole": Camera(*SIZE, 60.0, 62.0, 19.1, 14.4),
    "radtan": Camera(*SIZE, 60.0, 62.0, 19.1, 14.4, "radtan", (-0.2, 0.05, 1e-3, -2e-3, 0.01)),
    "kb4": Camera(*SIZE, 60.0, 62.0, 19.1, 14.4, "kb4", (-0.03, 0.01, -0.004, 0.001)),
}
SPAN_US = 0, 10_000


class Board(NamedTuple):
    """A rectangle z = `depth_m` in the world, where it lies at first, and its drift in all."""

    depth_m: float
    left_m: float
    top_m: float
    width_m: float
    height_m: float
    drift_m: tuple[float, float] = (0.0, 0.0)


WALL = Board(4.0, -9.0, -9.0, 18.0, 18.0)


def some_boards(rng):
    """Up to four, near and small, half of them drifting."""
    drifts = rng.uniform(-0.1, 0.1, (4, 2)) * rng.integers(0, 2, (4, 1))
    return [
        Board(rng.uniform(0.9, 3.5), *rng.uniform(-0.8, 0.5, 2), *rng.uniform(0.02, 0.8, 2), drift)
        for drift in map(tuple, drifts[: rng.integers(1, 5)])
    ]


def shown(all_boards, rays, T_world_cam, share):
    """Inverse depth and number of the nearest board along rays (..., 3), whose z is 1."""
    nearest, number = np.zeros(rays.shape[:-1]), np.zeros(rays.shape[:-1], int)
    directions = rays @ T_world_cam[:3, :3].T
    for k, board in enumerate(all_boards):
        depth_m = (board.depth_m - T_world_cam[2, 3]) / directions[..., 2]
        corner = np.array([board.left_m, board.top_m]) + share * np.array(board.drift_m)
        at = T_world_cam[:2, 3] + depth_m[..., None] * directions[..., :2] - corner
        on = ((at >= 0) & (at <= (board.width_m, board.height_m))).all(axis=-1)
        on &= 1 / depth_m > nearest
        nearest[on], number[on] = 1 / depth_m[on], k
    return nearest, number


def seen_pair(camera, all_boards, poses, seed=0):
    """What `find_layers` takes: both frames, grid, border and view."""
    rng, frames, bodies = np.random.default_rng(seed), [], []
    for T, share in ((poses[0], 0.0), (poses[2], 1.0)):
        columns, rows = ((np.arange(GRID * (n + 2 * BORDER)) + 0.5) / GRID - 0.5 for n in SIZE)
        rays = rays_through(camera, columns - BORDER, rows - BORDER)
        rho = shown(all_boards, rays, T, share)[0].astype(np.float32)
        centres = np.arange(WIDTH + 2 * BORDER) - BORDER, np.arange(HEIGHT + 2 * BORDER) - BORDER
        number = shown(all_boards, rays_through(camera, *centres), T, share)[1]
        moving = np.array([any(board.drift_m) for board in all_boards])
        found = np.argwhere(moving[number])
        pixels = found[:, ::-1] - BORDER
        bodies.append(BodyPixels(pixels, np.zeros((len(found), 3)), number[tuple(found.T)]))
        frames.append((rng.random(rho.shape, np.float32), rho))
    shape = HEIGHT + 2 * BORDER, WIDTH + 2 * BORDER

    def moved(now_us, later_us):
        T = np.tile(np.eye(4), (len(all_boards), 1, 1))
        T[:, :2, 3] = 1e-4 * (later_us - now_us) * np.array([b.drift_m for b in all_boards])
        return T

    between = interval_between(SPAN_US, poses, shape, tuple(bodies), moved, BORDER)
    pair = []
    for (light, rho), body in zip(frames, (between.body_before, between.body_after), strict=True):
        near, far = np.empty(shape, np.float32), np.empty(shape, np.float32)
        cell_depths(rho, GRID, near, far)
        pair.append(Seen(light, rho, light, near, far, body))
    wide = lens_of(widened_camera(camera, BORDER)).bearing
    return (*pair, GRID, BORDER, View(wide, lens_of(camera).terms, between.ways))


def walked_everywhere(before, after, grid, border, view):
    """The layers if every pixel is walked."""
    reached = search.empty_reached(np.arange(WIDTH * HEIGHT, dtype=np.int32).reshape(HEIGHT, WIDTH))
    everything = np.ones(before.body.shape, np.uint8)
    ranges = np.empty(search.MOST, np.int64), np.empty(search.MOST), np.empty(search.MOST)
    for frame, to_other in ((before, TO_SECOND_START), (after, TO_FIRST_END)):
        search.reach_out(frame, grid, border, view, to_other, everything, *ranges, reached)
    return search.chosen(reached)


def rows_of(layers):
    """What is known of each pixel that has layers."""
    lists = layers.way, layers.low, layers.high
    return [
        (*(tuple(values[k, :number]) for values in lists), layers.dark[k], layers.bright[k])
        for k, number in enumerate(layers.number)
    ]


@given(st.integers(0, 2**32 - 1), st.sampled_from(sorted(CAMERAS)))
def test_layers_are_those_of_walking_everywhere(seed, model):
    rng = np.random.default_rng(seed)
    shift_m, turn_deg = rng.uniform(-0.1, 0.1, 3), rng.uniform(-1.5, 1.5, 3)
    poses = pose(), pose(0.5 * shift_m, 0.5 * turn_deg), pose(shift_m, turn_deg)
    pair = seen_pair(CAMERAS[model], [WALL, *some_boards(rng)], poses, seed)
    found, expected = search.find_layers(*pair), walked_everywhere(*pair)
    np.testing.assert_array_equal(found.slot, expected.slot)
    assert rows_of(found) == rows_of(expected)


def test_a_wall_is_not_walked_and_a_board_only_around_its_way():
    poses = pose(), pose((0.03, 0, 0)), pose((0.06, 0, 0))
    walks = np.empty((HEIGHT + 2 * BORDER, WIDTH + 2 * BORDER), np.uint8)
    before, after, _, *view = seen_pair(CAMERAS["pinhole"], [WALL], poses)
    assert (within_reach(before, after, *view, walks) == -1).all()
    assert not walks.any()
    board = Board(1.5, -0.1, -0.1, 0.2, 0.2)
    before, after, _, *view = seen_pair(CAMERAS["pinhole"], [WALL, board], poses)
    numbers = within_reach(before, after, *view, walks)
    assert sorted(numbers[numbers >= 0]) == list(range(numbers.max() + 1))
    rows, columns = np.nonzero(numbers >= 0)
    # It is 8 px wide, moves by 2.4 px, and 3 px at most are added on each side.
    assert 10 <= np.ptp(columns) <= 19
    assert 8 <= np.ptp(rows) <= 16


@given(st.integers(0, 2**32 - 1), st.floats(0, 0.2))
def test_distances_are_those_of_scipy(seed, share):
    marked = (np.random.default_rng(seed).random((17, 23)) < share).astype(np.uint8)
    marked[3, 5] = 1
    expected = ndimage.distance_transform_cdt(1 - marked, "chessboard")
    np.testing.assert_array_equal(distances(marked), expected)
