"""DERD-Net in training: its windows, its samples, and the same command."""

import numpy as np
import pytest

from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import confidence_mask, without_border
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.cli.main import main
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.progress import SILENT
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.methods.derd import DERD
from eventsweep.plugins.learned.networks.derd import DepthRange, derd_net, selecting
from eventsweep.plugins.learned.training import data, samples
from eventsweep.plugins.learned.training import sequences as training
from eventsweep.plugins.learned.training.config import TrainingConfig
from eventsweep.plugins.learned.training.samples import swept_window, window_config
from refusals import command_refused

TINY = training.TrainingSequence("planes", "oblique", training.FIRST_SEED + 900, "ideal", 0.1)
WINDOW = training.TrainingWindow(0.0, 0.1, seed=3)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("learning")
    data.simulated([TINY], folder, SILENT)
    return folder


def test_its_windows_are_those_of_the_same_list_with_nothing_wrong():
    for one in training.sequences("training"):
        found = samples.derd_windows(one)
        assert found
        assert {(w.planes, w.fusion) for w in found} == {(100, "H")}
        assert not any(w.imperfection for w in found)
        spans = {(w.start_s, w.duration_s) for w in training.windows(one)}
        assert {(w.start_s, w.duration_s) for w in found} <= spans


@pytest.mark.slow
def test_samples_are_columns_of_the_volume_and_their_true_place(folder, tmp_path):
    """Against the volume that the mapper writes, and the depth that Algorithm 1 reports."""
    sequence = EventSequence.open(folder / TINY.name)
    found = samples.derd_samples(sequence, WINDOW, 300)
    assert len(found) == 300
    names = ("Alg1/H",)
    config = window_config(WINDOW).model_copy(
        update={"methods": names, "save_dsi": True, "median_px": 1}
    )
    result = map_window(sequence, config, dsi_dir=tmp_path)
    volume, plain = np.load(tmp_path / "Alg1-H.npy"), result.depth_maps["Alg1/H"]
    inner = without_border(plain.mask, 3)
    truth = truth_of(sequence, result.view.t_us, EvalConfig())
    per_rho_px = truth.baseline_focal_px_m
    true_px = np.where(truth.scored, per_rho_px / truth.depth_m, np.nan)
    span = DepthRange.of(result.view.rho)
    np.testing.assert_allclose(found.near_px, per_rho_px / span.near_m, rtol=1e-4)
    np.testing.assert_allclose(found.far_px, per_rho_px / span.far_m, rtol=1e-4)
    for k in range(0, 300, 30):
        at = np.argwhere(np.isclose(true_px, found.true_px[k], rtol=1e-6, atol=0) & inner)
        assert len(at)
        columns = [volume[:, y - 3 : y + 4, x - 3 : x + 4] for y, x in at]
        off = [np.abs(found.columns[k] / 255 - one / one.max()).max() for one in columns]
        y, x = at[int(np.argmin(off))]
        assert min(off) < 0.06
        assert found.votes_px[k] == pytest.approx(per_rho_px / plain.depth_m[y, x], rel=1e-3)


@pytest.mark.slow
def test_its_pixels_are_those_of_algorithm_1(folder):
    """It learns at least the pixels that it is compared on."""
    sequence = EventSequence.open(folder / TINY.name)
    config = window_config(WINDOW)
    derd = config.derd.model_copy(update={"threshold_c": samples.LEAST_C})
    asked = selecting(config.model_copy(update={"derd": derd}))
    swept = swept_window(sequence, config, DERD.build("DERD/H"))
    value = swept.result.maxima["DERD/H"].value
    np.testing.assert_array_equal(confidence_mask(value, asked), confidence_mask(value, config))


@pytest.mark.parametrize("uniform_in", ["linear", "inverse"])
def test_the_network_is_taught_what_is_read_off_it(uniform_in):
    """A network that gives exactly what it is taught makes no error, in either kind of place."""
    torch = pytest.importorskip("torch", reason="torch is an extra, [train]")
    from eventsweep.plugins.learned.training.network import DerdNetwork

    near_m, far_m, depth_m = 0.5, 5.0, np.array([0.5, 0.8, 1.9, 4.9], np.float32)
    inputs = {
        "columns": torch.zeros(4, 100, 7, 7, dtype=torch.uint8),
        "true_px": torch.from_numpy(30 / depth_m),
        "near_px": torch.full((4,), 30 / near_m),
        "far_px": torch.full((4,), 30 / far_m),
    }
    net = DerdNetwork(uniform_in)
    wanted = DepthRange(near_m, far_m).place(depth_m, uniform_in)
    net.forward = lambda columns: torch.from_numpy(wanted)
    assert float(net.loss(inputs)) == pytest.approx(0, abs=1e-6)
    np.testing.assert_allclose(net.outcome(inputs).error_px, 0, atol=1e-3)
    net.forward = lambda columns: torch.from_numpy(wanted) + 0.1
    assert float(net.loss(inputs)) == pytest.approx(0.1, abs=1e-6)


def test_the_same_command_trains_it(tmp_path, monkeypatch, capsys):
    pytest.importorskip("torch", reason="torch is an extra, [train]")

    def few(part):
        seed = training.FIRST_SEED + 900 + (part == "calibration")
        return (training.TrainingSequence("planes", "oblique", seed, "ideal", 0.2),)

    monkeypatch.setattr(data, "sequences", few)
    out = tmp_path / "out"
    asked = ["train", "--network", "derd", "--out", str(out), "--candidates", "300", "--quiet"]
    assert main(asked) == 0
    net = derd_net(out / "derd.npz")
    assert (net.models, net.uniform_in) == (1, "inverse")
    manifest = net.weights.manifest
    assert (manifest["training"]["network"], manifest["training"]["batch"]) == ("derd", 64)
    assert {"all_beyond_1px", "votes_all_beyond_1px"} <= set(manifest["calibration_errors"])
    assert "precision" not in manifest
    page = (out / "report.html").read_text()
    assert "Training of DERD-Net" in page
    assert "by votes" in page
    assert "seems most reliable" not in page
    said = command_refused(capsys, *asked, "--uniform-in", "linear")
    assert "something else was trained here (another uniform_in)" in said


@pytest.mark.parametrize(
    ("told", "epochs", "batch", "rate"),
    [({}, 8, 256, 3e-3), ({"network": "derd"}, 3, 64, 1e-3),
     ({"network": "derd", "epochs": 5}, 5, 64, 1e-3)],
)  # fmt: skip
def test_each_network_has_defaults_of_its_own(told, epochs, batch, rate):
    config = TrainingConfig(**told)
    assert (config.epochs, config.batch, config.learning_rate) == (epochs, batch, rate)


def test_an_output_that_only_the_other_network_has_is_refused(tmp_path, capsys):
    said = command_refused(capsys, "train", "--out", tmp_path / "a", "--uniform-in", "inverse")
    assert "uniform_in inverse with network learned" in said
