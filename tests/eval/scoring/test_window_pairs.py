"""A window's pairs and causes on rigs of one, two and three cameras, with lenses and without."""

from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.windows import Window
from eventsweep.eval.config import EvalConfig, Settings
from eventsweep.eval.pipeline import map_recording, score_folder
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.method_scores import score_method
from eventsweep.eval.scoring.pairing import Estimate
from eventsweep.eval.scoring.run_folder import find_maps, sequence_of, truth_of
from eventsweep.eval.scoring.score import rig_rows, window_pairs
from eventsweep.sim.config import SimConfig
from eventsweep.sim.simulate import simulate

WIDTH, HEIGHT, FOCAL, BASELINE = 120, 90, 80.0, 0.1
BARREL = {"radtan": (-0.3, 0.08, 0.001, -0.001, 0.0)}
RIGS = {"one": (1, "pinhole"), "three": (3, "pinhole"), "radtan": (2, "radtan")}


def rig_of(cameras, model):
    lens = Camera(
        WIDTH, HEIGHT, FOCAL, FOCAL, (WIDTH - 1) / 2, (HEIGHT - 1) / 2, model, BARREL.get(model, ())
    )
    places = [np.eye(4) for _ in range(cameras)]
    for k, place in enumerate(places):
        place[0, 3] = k * BASELINE
    return Rig("test", (lens,) * cameras, tuple(places))


@pytest.fixture(scope="module", params=RIGS)
def mapped(request, tmp_path_factory):
    """A map folder of the scene `planes` seen by one of the rigs."""
    folder = tmp_path_factory.mktemp(request.param)
    config = SimConfig(duration_s=0.2, truth_times_s=(0.1,))
    simulate(scenes.load("planes"), rig_of(*RIGS[request.param]), config, 0, folder / "sequence")
    cameras = RIGS[request.param][0]
    single = tuple(f"EMVS/cam{k}" for k in range(cameras))
    methods = single if cameras == 1 else ("Alg1/H", *single)
    settings = Settings(map=MapperConfig(planes=40, methods=methods))
    map_recording(folder / "sequence", folder / "map", settings)
    return folder / "map", cameras


@pytest.fixture(scope="module")
def scored(mapped):
    """Its sequence and window, and its pairs beside true depth and depth that is 20 % too deep."""
    (stored,) = find_maps(mapped[0]).values()
    sequence, window = sequence_of(stored), stored.windows[0]
    truth = truth_of(sequence, window.info.t_ref_us, EvalConfig())
    true = Estimate(np.where(truth.scored, truth.depth_m, 1), truth.scored)
    given = {"true": true, "deep": true._replace(depth_m=1.2 * true.depth_m)}
    return truth, window_pairs(sequence, window, EvalConfig(), given)


def test_true_depth_is_perfect_in_every_region_and_every_bad_pixel_has_one_cause(scored):
    truth, pairs = scored
    got = {score.metric: score.value for score in score_method(pairs["true"])}
    assert truth.scored.mean() > 0.5
    assert (got["points"], got["completeness"]) == (np.count_nonzero(truth.scored), 100)
    assert got["mean_error"] == got["outlier_points"] == 0
    assert got["interior_completeness"] == got["edges_completeness"] == 100
    assert got["interior_points"] + got["boundary_points"] == got["points"]
    truth, pairs = scored
    deep = pairs["deep"]
    assert sum(deep.causes.values()) == np.count_nonzero(truth.scored) > 0
    for found in pairs.values():
        error = np.abs(found.own.estimate_m - found.own.truth_m) / found.own.truth_m
        assert sum(found.causes.values()) == np.count_nonzero(error > 0.1)
    # Most of a picture is plain: no events, whatever the rig.
    assert deep.causes["few_events"] > 0


def test_the_map_is_scored_and_half_of_it_is_right(mapped):
    folder, cameras = mapped
    rows = list(each(score_folder(folder, EvalConfig()).rows))
    found = {(row.method, row.metric): row.value for row in rows if row.window == "all"}
    methods = {method for method, _ in found}
    best = "EMVS/cam0" if cameras == 1 else "Alg1/H"
    assert {f"EMVS/cam{k}" for k in range(cameras)} <= methods
    assert found[best, "points"] > 50
    assert found[best, "median_error"] < 0.1
    assert np.isnan(found[best, "bad_published"]) == (cameras == 1)
    assert found[best, "outlier_points"] > 0
    causes = {name: v for (_, name), v in found.items() if name.startswith("cause_")}
    assert np.isnan(causes.pop("cause_moving"))  # without segmentation nobody can tell
    assert np.isfinite(list(causes.values())).all()


@pytest.mark.parametrize(("way", "travel_m"), [((1, 0, 0), 0.4), ((0, 0, 1), 0), ((3, 4, 9), 2.0)])
def test_travel_is_what_lies_across_the_view(way, travel_m):
    """By hand: 0.4 s at |way| m/s, from before the first pose on."""
    times_us = np.array([0, 200_000, 400_000])
    T_world_body = np.stack([np.eye(4)] * 3)
    T_world_body[:, :3, 3] = np.outer(times_us / 1e6, way)
    rig = rig_of(2, "pinhole")
    recording = SimpleNamespace(
        rig=rig, trajectory=Trajectory.from_matrices(times_us, T_world_body)
    )
    rows = list(each(rig_rows("c", recording, [Window(-50_000, 400_000, 200_000, ())])))
    got = {row.metric: row.value for row in rows}
    assert got["lateral_travel"] == pytest.approx(travel_m)
    assert got["baseline"] == pytest.approx(BASELINE)
    assert {row.method for row in rows} == {"rig"}
    single = SimpleNamespace(rig=rig_of(1, "pinhole"), trajectory=recording.trajectory)
    alone = rig_rows("c", single, [])
    assert list(alone["metric"]) == ["lateral_travel"]
