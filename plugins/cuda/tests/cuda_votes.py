"""Votes and rays on a GPU, or its simulator: run by `test_cuda.py`, which says how."""

import itertools

import numpy as np
import pytest

import naive_sweep
import point_world
import volumes
from eventsweep.emvs.dsi import backprojection, rays
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.plugins.cuda import arrays, device
from eventsweep.plugins.cuda import backend as cuda_voting
from eventsweep.plugins.cuda.backprojection import CudaCaster, CudaProjector

if device.missing():
    pytest.skip(device.missing(), allow_module_level=True)

W, H = 9, 7
RHO = np.array([2, 0.9, 0.5], np.float32)
NEAREST = pytest.mark.parametrize("nearest", [False, True], ids=["bilinear", "nearest"])
LANE_ERROR = 3 * 2.0**-17  # of one vote in one cell


def made(a_u, b_u, a_v, b_v, c_z):
    columns = [np.asarray(column, np.float32) for column in (a_u, b_u, a_v, b_v, c_z)]
    return rays.Rays.of(columns, rays.RayCounts(len(columns[0])))


def random_rays(seed, n=40, c_z=-0.5):
    rng = np.random.default_rng(seed)
    return made(
        rng.uniform(-2, W + 1, n), rng.normal(0, 2, n), rng.uniform(-2, H + 1, n),
        rng.normal(0, 2, n), rng.normal(c_z, 0.6, n),
    )  # fmt: skip


def dsi(its_rays, rho, width_px, height_px, *, nearest=False):
    """Builds one camera's whole volume on the GPU, as `volumes.dsi` does on the CPU."""
    votes = cuda_voting.VoteVolume(1, len(rho), width_px, height_px, nearest=nearest)
    (counts,) = votes.cast([arrays.DeviceRays.of(its_rays)], arrays.up(rho), len(rho))
    return votes.on_host(len(rho))[0], counts


def at(u, v, n):
    """n rays that all meet every plane at (u, v)."""
    return made(np.full(n, u), np.zeros(n), np.full(n, v), np.zeros(n), np.full(n, -1))


@NEAREST
@pytest.mark.parametrize("c_z", [-0.5, 0.8])
def test_votes_equal_the_slow_twin_and_the_cpu(nearest, c_z):
    some = random_rays(1, c_z=c_z)
    volume, counts = dsi(some, RHO, W, H, nearest=nearest)
    cast = naive_sweep.nearest if nearest else naive_sweep.bilinear
    twin, counted, behind = naive_sweep.vote(*some.columns, RHO, W, H, cast)
    np.testing.assert_allclose(volume, twin, atol=1e-3)
    cpu, cpu_counts = volumes.dsi(some, RHO, W, H, nearest=nearest)
    np.testing.assert_allclose(volume, cpu, atol=1e-3)
    assert counts == cpu_counts
    assert (counts.counted, counts.behind) == (counted.sum(), behind.sum())
    assert counts.counted > 0
    assert counts.outside > 0


@NEAREST
def test_edges_poles_and_rays_from_nowhere(nearest):
    edges = [0.0, -0.0, 2.9999998, -1e-7, W - 1, np.nextafter(np.float32(W - 1), 0), H - 1,
             np.nextafter(np.float32(H - 1), 0), np.inf, np.nan, 1e30]  # fmt: skip
    columns = np.array(list(itertools.product(edges, [0.0, np.inf], edges, [0.0], [-1, 0.5])))
    some = made(*columns[::3].T)
    rho = RHO[:1]
    volume, counts = dsi(some, rho, W, H, nearest=nearest)
    cpu, cpu_counts = volumes.dsi(some, rho, W, H, nearest=nearest)
    np.testing.assert_allclose(volume, cpu, atol=1e-3)
    assert counts == cpu_counts
    assert counts.behind > 0


@NEAREST
def test_the_order_of_rays_changes_no_bit(nearest):
    some = random_rays(2)
    volume, counts = dsi(some, RHO, W, H, nearest=nearest)
    order = np.random.default_rng(0).permutation(len(some))
    shuffled = made(*(column[order] for column in some.columns))
    again, again_counts = dsi(shuffled, RHO, W, H, nearest=nearest)
    np.testing.assert_array_equal(volume, again)
    assert counts == again_counts


def test_fixed_votes_sum_to_whole_numbers_and_err_by_no_more_than_their_bound():
    some = random_rays(3)
    volume, counts = dsi(some, RHO, W, H)
    assert volume.sum(dtype=np.float64) == counts.counted
    exact = np.zeros((len(RHO), H, W))
    touched = np.zeros_like(exact)
    for (p, rho), k in itertools.product(enumerate(RHO), range(len(some))):
        u, v = some.a_u[k] + rho * some.b_u[k], some.a_v[k] + rho * some.b_v[k]
        if not (1 - some.c_z[k] * rho > 0 and 0 <= u < W - 1 and 0 <= v < H - 1):
            continue
        x, y = int(u), int(v)
        fx, fy = float(u) - x, float(v) - y
        exact[p, y : y + 2, x : x + 2] += np.outer([1 - fy, fy], [1 - fx, fx])
        touched[p, y : y + 2, x : x + 2] += 1
    assert np.all(abs(volume - exact) <= LANE_ERROR * touched + 1e-6)


@pytest.mark.filterwarnings("ignore:overflow encountered")
@pytest.mark.parametrize(("u", "v"), [(3, 2), (2.999999, 2), (3.5, 2.5)])
def test_a_lane_that_runs_over_is_found_and_cast_again(monkeypatch, u, v):
    monkeypatch.setattr(cuda_voting, "MOST_BITS", 28)  # 24 votes of 2^28 are more than 2^32
    scales = []
    cast = cuda_voting.VoteVolume._cast

    def spied(self, volume, its_rays, rho, planes, bits):
        scales.append(bits)
        cast(self, volume, its_rays, rho, planes, bits)

    monkeypatch.setattr(cuda_voting.VoteVolume, "_cast", spied)
    volume, counts = dsi(at(u, v, 80), RHO[:1], W, H)
    assert scales == [28, 24]
    assert counts.counted == 80
    np.testing.assert_allclose(volume, volumes.dsi(at(u, v, 80), RHO[:1], W, H)[0], atol=1e-3)


def test_no_scale_holds_too_many_votes_and_says_so(monkeypatch):
    monkeypatch.setattr(cuda_voting, "MOST_BITS", 28)
    monkeypatch.setattr(cuda_voting, "_FEWEST_BITS", 28)
    with pytest.raises(InputError, match=r"more than 16 votes in one voxel: choose voting nearest"):
        dsi(at(3, 2, 80), RHO[:1], W, H)


TURNING = Camera(6, 5, 6.0, 6.5, 2.4, 2.2, "radtan", (-0.2, 0.05, 0.001, -0.002))


def turning_world(n=60, seed=0, most_rad=0.8):
    trajectory = point_world.sideways()
    half_rad = np.linspace(-most_rad / 2, most_rad / 2, 6)
    turned = np.array([[0, np.sin(a), 0, np.cos(a)] for a in half_rad])
    trajectory = type(trajectory)(trajectory.t_us, trajectory.positions_m, turned)
    rng = np.random.default_rng(seed)
    t_us = np.sort(rng.integers(-20_000, 520_000, n))
    x, y = rng.integers(0, 6, n).astype(np.uint16), rng.integers(0, 5, n).astype(np.uint16)
    events = point_world.Events(x, y, t_us, rng.integers(0, 2, n).astype(np.uint8))
    recording = point_world.Recorded(point_world.stereo_rig(TURNING), trajectory, (events,) * 2)
    T_world_rv = trajectory.at(250_000)
    return recording, ReferenceView(250_000, T_world_rv, TURNING.undistorted(), RHO)


def rays_by_both(recording, view, camera):
    """Rays of the GPU and of the CPU, and the GPU's that vote, (5, N)."""
    events = recording.streams[camera]
    there = CudaCaster(recording, view, camera, packets=False)(events)
    here = backprojection.CpuCaster(recording, view, camera, packets=False)(events)
    cast = np.asarray(there.blocks[0].copy_to_host())
    return there, here, cast[:, ~np.isnan(cast[0])]


@pytest.mark.parametrize("camera", [0, 1])
def test_rays_equal_those_of_the_cpu(camera):
    there, here, voting = rays_by_both(*turning_world(), camera)
    assert there.counts == here.counts
    assert there.counts.without_pose > 0
    assert voting.shape[1] == len(there) == len(here)
    in_order = [np.lexsort(columns[::-1]) for columns in (voting, np.stack(here.columns))]
    np.testing.assert_allclose(
        voting[:, in_order[0]], np.stack(here.columns)[:, in_order[1]], rtol=1e-5, atol=1e-5
    )


@pytest.mark.parametrize("camera", [0, 1])
def test_without_a_turn_rays_equal_those_of_the_cpu_to_the_bit(camera):
    # Sine and cosine may differ by a rounding, and nothing else may.
    _, here, voting = rays_by_both(*turning_world(most_rad=0.0), camera)
    assert set(map(tuple, voting.T)) == set(map(tuple, np.stack(here.columns).T))


def test_packets_of_the_compatibility_setting_equal_those_of_the_cpu():
    recording, view = turning_world(1030)
    events = recording.streams[0]
    there = CudaCaster(recording, view, 0, packets=True)(events)
    here = backprojection.CpuCaster(recording, view, 0, packets=True)(events)
    assert there.counts == here.counts
    cast = np.asarray(there.blocks[0].copy_to_host())
    np.testing.assert_allclose(
        np.sort(cast[4][~np.isnan(cast[0])]), np.sort(here.c_z), rtol=1e-5, atol=1e-6
    )
    none = CudaCaster(recording, view, 0, packets=True)(events.slice(0, 100))
    assert none.counts == rays.RayCounts(100, dropped=100)


@pytest.mark.parametrize(("wrong", "words"), [("x", "outside the 6x5 sensor"), ("t", "sort")])
def test_wrong_events_get_the_line_that_the_cpu_gives(wrong, words):
    recording, view = turning_world()
    events = recording.streams[0]
    x, t_us = events.x.copy(), events.t_us.copy()
    if wrong == "x":
        x[7] = 6
    else:
        t_us[7] = t_us[20]
    bad = point_world.Events(x, events.y, t_us, events.p)
    with pytest.raises(InputError, match=words) as there:
        CudaCaster(recording, view, 0, packets=False)(bad)
    with pytest.raises(InputError, match=words) as here:
        backprojection.CpuCaster(recording, view, 0, packets=False)(bad)
    assert str(there.value) == str(here.value)


def test_events_per_pixel_equal_those_of_the_cpu():
    recording, _ = turning_world()
    events = recording.streams[0]
    there = CudaProjector().event_image(events, 6, 5)
    np.testing.assert_array_equal(there, backprojection.CpuProjector().event_image(events, 6, 5))
    assert there.dtype == np.uint32


def test_uploaded_events_are_sliced_here_and_there():
    recording, _ = turning_world()
    events = arrays.DeviceEvents.of(recording.streams[0])
    assert arrays.DeviceEvents.of(events) is events
    part = events.slice(5, 9).between(0, 10**9)
    for column, there in zip((part.x, part.y, part.t_us), part.there, strict=True):
        np.testing.assert_array_equal(column, there.copy_to_host())
