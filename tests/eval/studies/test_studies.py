"""Studies: curves by hand, changed rigs and ways by geometry, and one study end to end."""

import math
import shutil
from dataclasses import asdict, replace

import mujoco
import numpy as np
import pandas as pd
import pytest

from eventsweep import scenes
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.utils.output_manifest import NAME, is_ours
from eventsweep.eval.cli.main import main
from eventsweep.eval.perturbations import Perturbation
from eventsweep.eval.results.results import Results
from eventsweep.eval.stages.changes import WAY_M, going_straight, lit, patterned, with_baseline
from eventsweep.eval.studies.curves import METRICS, curves, draw
from eventsweep.eval.studies.definitions import MARGIN_S, SECONDS, STUDIES, study_named
from eventsweep.eval.studies.run import (
    StudyFacts,
    StudyResult,
    case_at,
    file_names,
    study_suite,
    window_of,
    write_study,
)
from eventsweep.eval.studies.stored import read_study
from eventsweep.eval.suite.plan import suite_jobs
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig as named_rig
from killed import killed_at_every_step
from refusals import command_refused, line_of
from score_rows import score_row


def values_of(table, metric="mean_error"):
    """Values from {(case, seed): [one per amount]} for the amounts 0, 1, 2, ..."""
    columns = ("case", "seed", "amount", "method", "metric", "value", "unit")
    rows = [
        (case, seed, float(amount), "Alg1/H", metric, value, "m")
        for (case, seed), row in table.items()
        for amount, value in enumerate(row)
    ]
    return pd.DataFrame(rows, columns=columns)


def jobs_of(name, seeds=(0,), seconds=SECONDS):
    suite = study_suite(STUDIES[name], ["Alg1/H"], ["planes"], seeds, seconds)
    return suite_jobs(suite, tuple(suite.cases), seeds)


def curve_of(table, cases):
    amounts = tuple(float(k) for k in range(len(next(iter(table.values())))))
    return curves(values_of(table), amounts, ["Alg1/H"], cases)[0]


def test_a_curve_is_the_mean_over_cases_of_the_mean_over_seeds_or_nothing():
    curve = curve_of({("a", 0): [1, 2], ("a", 1): [3, 4], ("b", 0): [10, 20]}, ["a", "b"])
    np.testing.assert_allclose(curve.mean, [(2 + 10) / 2, (3 + 20) / 2])
    assert curve.samples.tolist() == [3, 3]
    # Case b has one seed, which does not say how much seeds differ.
    assert np.isnan([curve.low, curve.high]).all()
    found = {("a", 0): [1, 2], ("a", 1): [3, 6], ("b", 0): [10, 11], ("b", 1): [10, 11]}
    curve = curve_of(found, ["a", "b"])
    # Case a grows by 1 and 3: by 2 ± 12.7 (t of one degree); b by 1 with both; of two cases half.
    ends = 6 + 1.5 - 6.3531, 6 + 1.5 + 6.3531
    np.testing.assert_allclose((curve.low[1], curve.high[1]), ends, atol=1e-4)
    assert curve.low[0] == curve.high[0] == 6  # nothing differs from itself, however scenes do
    curve = curve_of({("a", 0): [1, 2], ("b", 0): [1, math.nan]}, ["a", "b"])
    assert np.isnan(curve.mean[1])
    assert np.isnan(curve.low[1])


@pytest.mark.parametrize("amounts", [1, None])
def test_one_seed_has_no_band_and_is_drawn(tmp_path, amounts):
    study = study_named("pose-noise")
    study = replace(study, amounts=study.amounts[:amounts])
    table = {("a", 0): [1.0 + k for k in range(len(study.amounts))]}
    found = curves(values_of(table), [float(k) for k in range(len(study.amounts))], ["Alg1/H"],
                   ["a"])  # fmt: skip
    assert np.isnan(found[0].low).all()
    found = [replace(one, amounts=study.amounts) for one in found]
    draw(study, found, tmp_path / "one.png", "a; 1 seed each")
    assert (tmp_path / "one.png").stat().st_size > 1000
    draw(study, found, tmp_path / "one.svg", "a; 1 seed each")
    assert "<dc:date>" not in (tmp_path / "one.svg").read_text()  # the same bytes in every run


@pytest.mark.parametrize(("values", "amount"), [
    ([1, 1.5, 2.5, 9], 1.5), ([1, 1.5, 2.0], None),
    ([1, math.nan, 1], 1), ([math.nan, 1, 9], None),  # no map is broken, no start says nothing
])  # fmt: skip
def test_a_method_breaks_where_it_passes_twice_its_first_value(values, amount):
    assert curve_of({("a", 0): values}, ["a"]).breaking_amount() == amount


@pytest.mark.parametrize("name", STUDIES)
def test_every_study_perturbs_nothing_at_first_and_something_then(name):
    study = study_named(name)
    assert len(set(study.amounts)) == len(study.amounts) >= 5
    changes = [study.change(amount) for amount in study.amounts]
    assert len({str(change) for change in changes}) == len(changes)
    for change in changes:
        Perturbation(**change.perturb)
        MapperConfig(**window_of(change, SECONDS)[1])
        SimConfig(**change.sim)
    first = changes[0]
    if first.perturb and name != "pose-rate":
        assert Perturbation(**first.perturb) == Perturbation()
    if first.perturb and name == "pose-rate":
        assert study.amounts[0] == SimConfig().pose_rate_hz


@pytest.mark.parametrize(
    ("name", "seconds"), [("window-length", 0.5), ("planes", 0.5), ("planes", 0.2)]
)
def test_windows_of_all_lengths_lie_about_the_stored_truth(name, seconds):
    for job in jobs_of(name, seconds=seconds):
        window = job.needs[1].parameters["map"]
        middle_s = window["start_s"] + window["duration_s"] / 2
        assert [pytest.approx(middle_s)] == job.needs[0].parameters["sim"]["truth_times_s"]
        assert name == "window-length" or window["start_s"] == pytest.approx(MARGIN_S)


def test_amounts_share_the_sequences_that_they_do_not_change():
    needs = {job.needs[0].name for job in jobs_of("pose-noise", (0, 1))}
    assert needs == {"simulate/planes.0/seed0", "simulate/planes.0/seed1"}
    changed = jobs_of("baseline")
    assert len({job.needs[0].name for job in changed}) == len(changed)


@pytest.mark.parametrize("baseline_m", [0.02, 0.4])
def test_a_rig_gets_the_baseline_and_keeps_all_else(baseline_m):
    rig = named_rig("tumvie-kb4")
    wide = with_baseline(rig, baseline_m)
    assert wide.baseline_m() == pytest.approx(baseline_m)
    np.testing.assert_array_equal(wide.T_body_cam[1][:3, :3], rig.T_body_cam[1][:3, :3])
    along = [r.T_body_cam[1][:3, 3] / r.baseline_m() for r in (rig, wide)]
    np.testing.assert_allclose(*along)
    assert wide.cameras == rig.cameras


@pytest.mark.parametrize("heading_deg", [0, 30, 90])
def test_a_straight_way_has_its_length_and_heading_and_never_turns(heading_deg):
    scene = scenes.load("planes")
    motion = going_straight(scene, heading_deg).motion(0.5, 0)
    poses = np.array([motion.T_world_body(t_s) for t_s in (0, 0.25, 0.5)])
    np.testing.assert_allclose(poses[1], scene.motion(0.5, 0).T_world_body(0.25))
    way_cam = poses[1][:3, :3].T @ (poses[2] - poses[0])[:3, 3]
    angle = np.deg2rad(heading_deg)
    np.testing.assert_allclose(
        way_cam, WAY_M * np.array([np.cos(angle), 0, np.sin(angle)]), atol=1e-12
    )
    np.testing.assert_array_equal(poses[0][:3, :3], poses[2][:3, :3])


def test_every_lamp_becomes_as_dim_as_asked():
    scene = scenes.load("desk")
    bright, dim = (one.spec().compile() for one in (scene, lit(scene, 0.1)))
    assert bright.nlight == dim.nlight > 0
    np.testing.assert_allclose(dim.light_diffuse, 0.1 * bright.light_diffuse, rtol=1e-6)
    for kind in ("ambient", "diffuse", "specular"):
        before, after = (np.array(getattr(m.vis.headlight, kind)) for m in (bright, dim))
        np.testing.assert_allclose(after, 0.1 * before, rtol=1e-6)
    assert isinstance(dim, mujoco.MjModel)


@pytest.mark.parametrize(("density", "size"), [(2, 2), (0.5, 0.5)])
def test_a_texture_is_repeated_or_cut_face_by_face_and_other_densities_are_refused(density, size):
    scene = scenes.load("mvsec-flying")
    before, after = scene.textures(), patterned(scene, density).textures()
    assert {k: (size * v.shape[0], size * v.shape[1], 3) for k, v in before.items()} == {
        k: v.shape for k, v in after.items()
    }
    face = before["drum_blue"].shape[1]  # six of them, one above the other
    second, scaled = before["drum_blue"][face : 2 * face], round(size * face)
    start = after["drum_blue"][scaled : scaled + face // 2, : face // 2]
    np.testing.assert_array_equal(start, second[: face // 2, : face // 2])
    for wrong in (0.0, -1.0, 1.5, 0.4):
        assert "texture_density" in line_of(patterned, scene, wrong)


@pytest.mark.parametrize("words", [
    "planes --case nowhere", "planes --method Alg9/H", "planes --seeds x",
    "window-length --seconds 0.15", "window-length --seconds 0.3",
])  # fmt: skip
def test_an_unknown_study_case_or_method_is_refused(tmp_path, capsys, words):
    assert "choose from pose-noise" in line_of(study_named, "nothing")
    command_refused(capsys, "study", *words.split(), "--out", tmp_path / "s", "--quiet")
    assert not (tmp_path / "s").exists()


@pytest.mark.slow
def test_delaying_one_camera_breaks_stereo_and_leaves_the_other_camera_alone(tmp_path):
    command = ["study", "camera-delay", "--case", "planes", "--seeds", "0", "--quiet"]
    places = ["--out", str(tmp_path / "s"), "--cache", str(tmp_path / "cache")]
    methods = ["--method", "Alg1/H", "--method", "EMVS/cam0"]
    assert main([*command, *places, *methods]) == 0
    result = read_study(tmp_path / "s" / "camera-delay.json")
    assert result.breaking()["EMVS/cam0"] is None
    assert result.breaking()["Alg1/H"] < 40
    assert not result.failures
    assert (tmp_path / "s" / "camera-delay.png").stat().st_size > 10_000


# --- what is left of a kill
def study_result(mean):
    study = study_named("pose-noise")
    rows = [
        score_row(case_at("desk", amount), "all", "Alg1/H", metric, mean, "m", "lower", seed=0)
        for amount in study.amounts
        for metric in METRICS
    ]
    about = StudyFacts(study.name, study.axis, study.unit, study.amounts, ["desk"], ["Alg1/H"])
    return StudyResult.of(Results(rows, {"study": asdict(about)}, seeds=(0,)))


@pytest.mark.slow
@pytest.mark.parametrize("before", [False, True])
def test_a_killed_study_is_whole_or_not_there_and_never_in_the_way(tmp_path, monkeypatch, before):
    monkeypatch.setattr(
        "eventsweep.eval.studies.run.draw",
        lambda study, curves, path, words: path.write_text(str(curves)),
    )
    old, new = study_result(1.0), study_result(2.0)
    names = file_names(study_named("pose-noise"))
    whole = []
    for one in (old, new):
        write_study(tmp_path, one)
        whole.append([(tmp_path / name).read_bytes() for name in names])

    def start():
        for path in tmp_path.iterdir():
            shutil.rmtree(path) if path.is_dir() else path.unlink()
        if before:
            write_study(tmp_path, old)

    def check(step):
        if (tmp_path / names[-1]).exists():
            found = [(tmp_path / name).read_bytes() for name in names]
            assert found in whole, f"half old, half new after step {step}"
        assert all(is_ours(path) for path in map(tmp_path.joinpath, names) if path.exists())
        write_study(tmp_path, new)  # was refused: figures without a marker
        assert sorted(path.name for path in tmp_path.iterdir()) == sorted([NAME, *names])
        start()

    start()
    assert killed_at_every_step(lambda: write_study(tmp_path, new), check) > 8
    assert [(tmp_path / name).read_bytes() for name in names] == whole[1]
