"""The DERD-Net authors' weights: their files become ours, and nothing in them is executed."""

import numpy as np
import pytest

from eventsweep.eval.cli.main import main
from eventsweep.plugins.learned.networks.derd import LAYERS, derd_net
from eventsweep.plugins.learned.training import published
from lanes import in_blocks
from refusals import command_refused

torch = pytest.importorskip("torch", reason="torch is an extra, [train]")

BATCH = 40


class PixelwiseConvGRU(torch.nn.Module):
    """The published module as its code builds it: layers, their order and their names."""

    def __init__(self, outputs=1):
        super().__init__()
        nn = torch.nn
        conv = nn.Conv3d(1, 4, (3, 3, 3), padding=(1, 0, 0), stride=(2, 1, 1))
        self.conv3d = nn.Sequential(conv, nn.ReLU(), nn.Dropout(0))
        self.gru = nn.GRU(100, 100, num_layers=1, batch_first=True)
        dense = nn.Linear(100, 100), nn.ReLU(), nn.Dropout(0), nn.Linear(100, outputs)
        self.dense_output = nn.Sequential(*dense)

    def forward(self, columns):
        steps = self.conv3d(columns.unsqueeze(1)).transpose(1, 2).flatten(start_dim=2)
        return self.dense_output(self.gru(steps)[0][:, -1, :]).squeeze(-1)


def saved(path, seed=0, outputs=1):
    """A file as the authors' `save_model` writes it."""
    torch.manual_seed(seed)
    model = PixelwiseConvGRU(outputs)
    optimiser = torch.optim.AdamW(model.parameters())
    model(torch.rand(2, 100, 7, 7)).sum().backward()
    optimiser.step()
    state = {
        "model_state_dict": model.state_dict(),
        "optimizer_state_dict": optimiser.state_dict(),
    }
    torch.save(state, path)
    return model


def columns():
    return np.random.default_rng(3).random((BATCH, 100, 7, 7)).astype(np.float32)


def test_two_published_files_give_the_mean_of_what_they_give(tmp_path):
    even, odd = saved(tmp_path / "even.pth", 1), saved(tmp_path / "odd.pth", 2)
    files = (str(tmp_path / f"{name}.pth") for name in ("even", "odd"))
    flags = [one for file in files for one in ("--published", file)]
    out = tmp_path / "out"
    assert main(["train", "--out", str(out), *flags, "--quiet"]) == 0
    net = derd_net(out / "derd.npz")
    assert (net.models, net.uniform_in) == (2, "linear")
    with torch.no_grad():
        told = torch.from_numpy(columns())
        wanted = (even(told) + odd(told)) / 2
    np.testing.assert_allclose(net.places(in_blocks(columns()), BATCH), wanted, atol=1e-5)
    assert set(net.weights.manifest["published"]) == {"even.pth", "odd.pth"}
    assert sorted(one.name for one in out.iterdir()) == ["derd.json", "derd.npz"]


def test_a_plain_state_is_read_as_well_and_layers_have_the_published_names(tmp_path):
    model = saved(tmp_path / "a.pth")
    torch.save(model.state_dict(), tmp_path / "plain.pth")
    for name in ("a", "plain"):
        published.convert([tmp_path / f"{name}.pth"], tmp_path / name)
    one, other = (derd_net(tmp_path / name / "derd.npz") for name in ("a", "plain"))
    assert one.models == 1
    for name, array in one.weights.arrays.items():
        np.testing.assert_array_equal(other.weights.arrays[name], array)
    found = {name: tuple(one.shape) for name, one in PixelwiseConvGRU().state_dict().items()}
    assert found == dict(LAYERS)


class Evil:
    """Executed by whoever unpickles it."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (self.path.touch, ())


@pytest.mark.parametrize(("make", "words"), [
    (lambda path: saved(path, outputs=9),
     "weights of the 3 x 3 pixel variant; needs those of one pixel"),
    (lambda path: torch.save({"model_state_dict": torch.nn.Linear(3, 1).state_dict()}, path),
     "arrays differ from DERD-Net's: bias, conv3d.0.bias"),
    (lambda path: [saved(path), path.write_bytes(path.read_bytes()[:9000])],
     "cannot be read as a file of weights"),
    (lambda path: torch.save({"model_state_dict": Evil(path.with_name("executed"))}, path),
     "cannot be read as a file of weights (UnpicklingError"),
    (lambda path: torch.save([1, 2], path), "contains no model state"),
    (lambda path: torch.save({"model_state_dict": 3}, path), "contains no model state"),
    (lambda path: None, "cannot be read as a file of weights (FileNotFoundError"),
    (lambda path: path.mkdir(), "is a folder; needs a regular file"),
])  # fmt: skip
def test_other_files_get_one_line_and_leave_nothing(make, words, tmp_path, capsys):
    path, out = tmp_path / "a.pth", tmp_path / "out"
    make(path)
    said = command_refused(capsys, "train", "--out", out, "--published", path, "--quiet")
    assert words in said
    assert not out.exists()
    assert not (tmp_path / "executed").exists()


def test_what_makes_no_sense_is_refused(tmp_path, capsys):
    saved(tmp_path / "a.pth")
    one = ["--published", str(tmp_path / "a.pth")]
    asked = ["train", "--out", str(tmp_path / "out"), "--quiet", *one]
    assert "3 published files: at most 2" in command_refused(capsys, *asked, *one, *one)
    said = command_refused(capsys, *asked, "--epochs", "3")
    assert "published weights are not trained: leave out epochs" in said
    assert main(asked) == 0
    assert "derd.npz: exists already" in command_refused(capsys, *asked)
