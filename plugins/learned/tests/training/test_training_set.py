"""The training set: motions that nothing scores, windows with truth, samples that are exact."""

import numpy as np
import pytest

from check_cases import DEVELOPMENT, NEW
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.focus import estimate_in_focus
from eventsweep.emvs.methods.method import FOCUS
from eventsweep.eval.progress import SILENT
from eventsweep.eval.suite import definition as suites
from eventsweep.plugins.learned.networks.inputs import candidates
from eventsweep.plugins.learned.training import data, samples
from eventsweep.plugins.learned.training.config import TrainingConfig
from eventsweep.plugins.learned.training.sequences import (
    FIRST_SEED,
    TrainingSequence,
    TrainingWindow,
    sequences,
    windows,
)
from refusals import line_of
from study_samples import SETS


def test_training_has_what_it_should_and_nothing_of_calibration_or_of_what_is_scored():
    """Every motion of a suite or a study has a seed below the first of training."""
    scored = {one.seed for chosen in SETS.values() for one in chosen}
    for name in suites.overview():
        suite, _ = suites.load(name.split(":")[0])
        scored |= {*suite.seeds, *suite.spread_seeds}
    scored |= {base.seed for base in (*DEVELOPMENT, *NEW)}
    assert len(scored) > 8
    trained = [one.seed for part in data.PARTS for one in sequences(part)]
    assert max(scored) < FIRST_SEED <= min(trained)
    first, other = ({(one.scene, one.seed) for one in sequences(part)} for part in data.PARTS)
    assert min(len(first), len(other)) > 0
    assert not first & other
    names = [one.name for part in data.PARTS for one in sequences(part)]
    assert len(names) == len(set(names))
    # Ideal and noisy sensors, several rigs, forward and sideways, windows from 0.1 to 1 s.
    found = sequences("training")
    assert {one.sensor for one in found} == {"ideal", "davis346"}
    assert len({one.rig for one in found}) >= 5
    assert {"tumvie-run", "tumvie-skate", "dsec-street"} <= {one.scene for one in found}
    spans = [w.duration_s for one in found for w in windows(one)]
    assert min(spans) == pytest.approx(0.1)
    assert max(spans) == pytest.approx(1.0)


@pytest.mark.parametrize("part", data.PARTS)
def test_every_window_lies_in_its_sequence_and_its_middle_has_truth(part):
    for one in sequences(part):
        for window in windows(one):
            assert window.start_s >= 0
            assert window.start_s + window.duration_s <= one.seconds + 1e-9
            steps = (window.start_s + window.duration_s / 2) / 0.05
            assert abs(steps - round(steps)) < 1e-6 or window.duration_s == one.seconds


TINY = TrainingSequence("planes", "oblique", FIRST_SEED + 900, "ideal", 0.2)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    folder = tmp_path_factory.mktemp("learning")
    data.simulated([TINY], folder, SILENT)
    return EventSequence.open(folder / TINY.name)


@pytest.mark.slow
@pytest.mark.parametrize("fusion", ["H", "cam1"])
def test_samples_hold_what_the_volumes_hold(sequence, fusion, tmp_path):
    """Against volumes that the mapper writes: the votes around each sample, and the true depth."""
    window = TrainingWindow(0.0, 0.2, planes=30, fusion=fusion, seed=3)
    found = samples.samples(sequence, window, 200)
    assert len(found) == 200
    own, method = samples.window_config(window), FOCUS.build(f"Focus/{fusion}")
    swept = samples.swept_window(sequence, own, method)
    votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
    estimate = estimate_in_focus(votes, focus, swept.disparity_px, own)
    chosen = candidates(votes, focus, estimate, swept.disparity_px, own.border_px)
    name = "Alg1/H" if fusion == "H" else "EMVS/cam1"
    config = own.model_copy(update={"methods": (name,), "save_dsi": True})
    samples_volume = _volume(sequence, config, tmp_path, name)
    true_px = swept.true_px(sequence)[chosen.rows, chosen.columns]
    match = [
        np.flatnonzero((true_px == found.true_px[k]) & (chosen.focus_px == found.focus_px[k]))[0]
        for k in range(20)
    ]
    for k, m in enumerate(match):
        y, x, stride = chosen.rows[m], chosen.columns[m], chosen.strides[m]
        planes = chosen.centres[m] + stride * np.arange(-8, 9)
        there = (planes >= 0) & (planes < 30)
        patch = np.zeros((17, 7, 7), np.float32)
        patch[there] = samples_volume[planes[there], y - 3 : y + 4, x - 3 : x + 4]
        shares = samples.shares_of_codes()[found.codes[k, 0]]
        np.testing.assert_allclose(shares, patch / patch.max(), atol=0.15)


def _volume(sequence, config, folder, name):
    from eventsweep.emvs.mapper import map_window

    map_window(sequence, config, dsi_dir=folder)
    return np.load(folder / f"{name.replace('/', '-')}.npy")


@pytest.mark.slow
def test_a_window_told_wrongly_keeps_its_true_depth(sequence):
    plain = TrainingWindow(0.0, 0.2, planes=30, seed=3)
    told = TrainingWindow(0.0, 0.2, planes=30, imperfection={"stereo_pitch_deg": 2.0}, seed=3)
    exact, wrong = (samples.samples(sequence, w, 3000) for w in (plain, told))
    assert np.median(exact.compared_error_px) < 0.5 * np.median(wrong.compared_error_px)
    assert set(np.round(wrong.true_px, 2)) & set(np.round(exact.true_px, 2))


@pytest.mark.slow
def test_samples_are_written_and_read(sequence, tmp_path):
    found = samples.samples(sequence, TrainingWindow(0.0, 0.2, planes=30), 50)
    found.save(tmp_path / "a.npz")
    again = samples.Samples.load(tmp_path / "a.npz")
    for name in samples.Samples.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    joined = samples.Samples.joined([found, again[:10]])
    assert len(joined) == 60


def test_a_scene_that_nothing_shows_is_refused():
    said = line_of(data.chosen, "training", TrainingConfig(scenes=("nowhere",)))
    assert "no training sequence of nowhere: choose from boxes" in said
    assert MapperConfig().learned.weights is None
