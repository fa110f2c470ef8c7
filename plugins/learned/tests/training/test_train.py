"""`eventsweep train`: from nothing to weights, resumed, and refused in one line."""

import json
import sys

import numpy as np
import pytest

from eventsweep.emvs.utils import release
from eventsweep.eval.cli.main import main
from eventsweep.plugins.learned.networks.network import NAME, Architecture
from eventsweep.plugins.learned.networks.weights import read_weights
from eventsweep.plugins.learned.training import data
from eventsweep.plugins.learned.training.sequences import FIRST_SEED, TrainingSequence
from refusals import command_refused, untouched

FLAGS = ["--candidates", "80", "--batch", "32", "--quiet"]


@pytest.fixture
def few(monkeypatch):
    """Two short sequences instead of some dozen."""

    def sequences(part):
        seed = FIRST_SEED + 900 + (part == "calibration")
        return (TrainingSequence("planes", "oblique", seed, "ideal", 0.2),)

    monkeypatch.setattr(data, "sequences", sequences)


def test_without_torch_it_says_what_to_install(monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)
    for name in ("fit", "network"):
        monkeypatch.delitem(
            sys.modules, f"eventsweep.plugins.learned.training.{name}", raising=False
        )
    said = command_refused(capsys, "train", "--out", tmp_path / "a")
    assert release.install_extra("train") in said
    assert not (tmp_path / "a").exists()


def test_it_trains_and_a_stopped_run_ends_as_one_that_was_not(few, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra, [train]")
    one, other = tmp_path / "one", tmp_path / "other"
    assert main(["train", "--out", str(one), "--epochs", "3", *FLAGS]) == 0
    weights = read_weights(one / "learned.npz", NAME, Architecture().shapes())
    assert weights.manifest["training"]["epochs"] == 3
    assert weights.manifest["sequences"]["training"] == ["planes-oblique-0.2s-ideal-seed1900"]
    assert set(weights.manifest["precision"]) == {"Learned/H", "Learned/cam"}
    assert "Errors over epochs" in (one / "report.html").read_text()

    from eventsweep.plugins.learned.training.fit import Fitting

    def stopped(self, epoch, update, _epoch=Fitting._epoch):
        if epoch == 2:
            raise KeyboardInterrupt
        return _epoch(self, epoch, update)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Fitting, "_epoch", stopped)
        assert main(["train", "--out", str(other), "--epochs", "3", *FLAGS]) == 130
    assert not (other / "learned.npz").exists()
    assert main(["train", "--out", str(other), "--epochs", "3", *FLAGS]) == 0
    again = read_weights(other / "learned.npz", NAME, Architecture().shapes())
    for name, array in weights.arrays.items():
        np.testing.assert_allclose(again.arrays[name], array, atol=1e-4)

    said = command_refused(capsys, "train", "--out", one, "--epochs", "4", *FLAGS)
    assert "something else was trained here (another epochs)" in said
    (one / "checkpoint.pt").write_bytes(b"nothing")
    said = command_refused(capsys, "train", "--out", one, "--epochs", "3", *FLAGS)
    assert "cannot be resumed" in said


def test_a_folder_of_somebody_else_is_left_alone(few, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra, [train]")
    (tmp_path / "notes.txt").write_text("mine")
    with untouched(tmp_path):
        said = command_refused(capsys, "train", "--out", tmp_path, *FLAGS)
    assert "is not empty, and nothing was trained here" in said


def test_a_folder_trained_by_other_code_is_refused(few, tmp_path, capsys):
    pytest.importorskip("torch", reason="torch is an extra, [train]")
    from eventsweep.plugins.learned.training.config import TrainingConfig

    config = TrainingConfig(candidates=80, batch=32).model_dump(mode="json")
    (tmp_path / "training.json").write_text(json.dumps({"config": config, "code": "0"}))
    assert "by other code" in command_refused(capsys, "train", "--out", tmp_path, *FLAGS)
