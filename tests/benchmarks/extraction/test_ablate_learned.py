"""The ablation: depth and reliability apart, networks that are not shown all, what is trained."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import ablate_learned
from ablate_learned import PARTS, best, main, outcome, rows, table
from ablated_networks import VARIANTS, Budget, Masked, Variant, masked, train, train_missing
from ablated_networks import trained as trained_network
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import without_border
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils import release
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.run_folder import truth_of
from eventsweep.plugins.learned.networks.network import (
    CHANNELS,
    CUES,
    DEPTH,
    NAME,
    SIDE_PX,
    Architecture,
    Network,
)
from eventsweep.plugins.learned.networks.network import network as shipped
from eventsweep.plugins.learned.networks.weights import Weights, write_weights
from eventsweep.plugins.learned.training import data
from eventsweep.plugins.learned.training.config import TrainingConfig
from eventsweep.plugins.learned.training.samples import Samples, show
from eventsweep.plugins.learned.training.sequences import FIRST_SEED, TrainingSequence, sequences
from lanes import as_rays
from naive_network import judged
from study_learned import METHODS, most_reliable, numbers
from study_samples import SampleSpec

SECONDS = 0.2
RIM_PX = SIDE_PX // 2  # where the network has no patch
CONFIG = MapperConfig(planes=40, border_px=RIM_PX)
TINY = Budget(candidates=40, epochs=2, batch=16)
BY_NAME = {one.name: one for one in VARIANTS}


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    one = TrainingSequence("planes", "oblique", FIRST_SEED + 900, "ideal", SECONDS)
    folder = tmp_path_factory.mktemp("ablation")
    with data._renderer() as renderer:  # torch and a software renderer crash each other
        renderer.submit(data.simulate_sequence, one, folder / one.name).result()
    return EventSequence.open(folder / one.name)


def random_arrays(seed=0):
    rng = np.random.default_rng(seed)
    shapes = Architecture().shapes()
    return {n: rng.normal(0, 0.2, size).astype(np.float32) for n, size in shapes.items()}


def random_samples(count, seed=1):
    rng = np.random.default_rng(seed)
    codes = rng.integers(1, 200, (count, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX), np.uint8)
    floats = rng.uniform(1, 20, (5, count)).astype(np.float32)
    cues = rng.normal(size=(count, len(CUES))).astype(np.float32)
    true, focus, centre, sample, reliability = floats
    return Samples(true, codes, cues, sample, centre, focus, reliability)


def naive_depths(shown):
    """Both depths, px, and both errors, px, candidate by candidate, from kept votes."""
    count, _, height, width = shown.kept.codes.shape
    whole = np.empty((len(shown.chosen), 3, DEPTH, SIDE_PX, SIDE_PX))
    for m, (y, x, n, stride) in enumerate(pixels(shown.chosen)):
        assert SIDE_PX // 2 <= y < height - SIDE_PX // 2
        assert SIDE_PX // 2 <= x < width - SIDE_PX // 2
        at = np.array([[y], [x], [n], [stride]])
        cameras = shown.kept.patches(*at, DEPTH, SIDE_PX)[:, 0, ..., 0].astype(np.float64)
        with np.errstate(divide="ignore"):
            fused = count / (1 / cameras).sum(axis=0)
        whole[m] = np.array([fused, cameras[0], cameras[1:].mean(axis=0)]) / fused.max()
    offset, log_error = judged(shipped().weights.arrays, whole, shown.chosen.cues, 2)
    own = shown.disparity_px[shown.chosen.centres] - offset * shown.chosen.sample_px
    return np.clip(own, *sorted(shown.disparity_px[[0, -1]])), np.exp(log_error)


def pixels(chosen):
    return zip(chosen.rows, chosen.columns, chosen.centres, chosen.strides, strict=True)


@pytest.mark.slow
def test_each_part_of_the_network_is_what_its_row_says(sequence):
    """Against the definition of the network, at some candidates."""
    shown = show(sequence, CONFIG, ablate_learned.METHOD)
    picked = np.arange(0, len(shown.chosen), len(shown.chosen) // 60)
    shown = replace(shown, chosen=shown.chosen[picked], reliability=shown.reliability[picked])
    own, error = naive_depths(shown)
    focus, taken = shown.chosen.focus_px, error.argmin(axis=1)
    depth = np.where(taken == 0, own, focus)
    assert 0 < taken.sum() < len(taken)  # both depths are taken somewhere
    wanted = [
        (focus, shown.reliability),
        (depth, np.sqrt(depth / 10) / error.min(axis=1)),
        (focus, np.sqrt(focus / 10) / error[:, 1]),
        (depth, shown.reliability),
        (own, np.sqrt(own / 10) / error[:, 0]),
    ]
    found = dict(rows(shown, {}))
    assert list(found) == ["`Focus/H`", *PARTS]
    for name, expected in zip(found, wanted, strict=True):
        for one, other in zip(found[name], expected, strict=True):
            np.testing.assert_allclose(one, other, rtol=2e-3, err_msg=name)


def test_whole_rows_are_what_the_mapper_reports(sequence):
    """`Alg1/H`, `Focus/H` and `Learned/H` from one sweep, against each from the mapper's own."""
    found = outcome(sequence, {}, CONFIG)
    result = map_window(sequence, CONFIG.model_copy(update={"methods": METHODS[:3]}))
    truth = truth_of(sequence, result.view.t_us, EvalConfig())
    points = result.depth_maps["Alg1/H"].points
    for name, title in zip(METHODS[:3], ("Alg1/H", "`Focus/H`", "`Learned/H`"), strict=True):
        one = result.depth_maps[name]
        inside = without_border(one.reliability > 0, RIM_PX)
        known = replace(one, reliability=np.where(inside, one.reliability, 0))
        wanted = numbers(
            one.depth_m, most_reliable(known, truth.baseline_focal_px_m, points), truth
        )
        for metric in ("points", "median_error", "mean_error", "bad_published", "blocks"):
            assert found[title][metric] == pytest.approx(wanted[metric], rel=2e-3), title
    lines = table([found, found]).splitlines()
    assert [line.split(" | ")[0] for line in lines[2:]] == [f"| {name}" for name in found][1:]


def test_the_most_reliable_candidates_are_kept(sequence):
    shown = show(sequence, CONFIG, ablate_learned.METHOD)
    rank = np.random.default_rng(0).permutation(len(shown.chosen)).astype(np.float32)
    depth_m, mask = best(shown, (shown.chosen.focus_px, rank), 50)
    wanted = sorted(range(len(rank)), key=lambda m: -rank[m])[:50]
    places = {(int(shown.chosen.rows[m]), int(shown.chosen.columns[m])) for m in wanted}
    assert {(int(y), int(x)) for y, x in np.argwhere(mask)} == places
    per_rho = shown.disparity_px[7] / shown.view.rho[7]
    for m in wanted[:5]:
        found = depth_m[shown.chosen.rows[m], shown.chosen.columns[m]]
        assert found == pytest.approx(per_rho / shown.chosen.focus_px[m], rel=1e-4)


@pytest.mark.parametrize(
    ("name", "array", "blind"),
    [("fused", "patch.weight", np.s_[:, 1:]), ("votes", "hidden.weight", np.s_[:, 24 : 24 + 13])],
)
def test_what_is_hidden_has_no_weight(name, array, blind):
    """A network that is not shown an input is the same network with weights of 0 for it."""
    arrays = random_arrays()
    rng = np.random.default_rng(2)
    shares = rng.gamma(0.5, 0.5, (40, len(CHANNELS), DEPTH, SIDE_PX, SIDE_PX)).astype(np.float32)
    cues = rng.normal(size=(40, len(CUES))).astype(np.float32)
    before = shares.copy(), cues.copy()
    found = Masked(Weights(arrays, {}, None), variant=BY_NAME[name]).judge(as_rays(shares), cues)
    np.testing.assert_array_equal(shares, before[0])
    np.testing.assert_array_equal(cues, before[1])
    every = Network(Weights(arrays, {}, None)).judge(as_rays(shares), cues)
    deaf = arrays | {array: arrays[array].copy()}
    deaf[array][blind] = 0
    wanted = Network(Weights(deaf, {}, None)).judge(as_rays(shares), cues)
    np.testing.assert_allclose(found[1], wanted[1], atol=1e-4)
    assert np.abs(found[1] - every[1]).max() > 0.1


def test_training_is_shown_as_little():
    plain = random_samples(9)
    fused, votes = masked(plain, BY_NAME["fused"]), masked(plain, BY_NAME["votes"])
    np.testing.assert_array_equal(fused.codes[:, 0], plain.codes[:, 0])
    assert plain.codes[:, 1:].all()
    assert not fused.codes[:, 1:].any()
    np.testing.assert_array_equal(fused.cues, plain.cues)
    np.testing.assert_array_equal(votes.codes, plain.codes)
    assert not votes.cues.any()
    np.testing.assert_array_equal(votes.true_px, plain.true_px)


@pytest.mark.parametrize("variant", VARIANTS, ids=lambda one: one.name)
def test_every_network_is_shown_as_many_samples(variant):
    known, chosen = sequences("training"), variant.sequences()
    config = variant.config(Budget())
    samples = config.candidates * len(chosen)
    assert samples * variant.share == pytest.approx(Budget().candidates * len(known), rel=2e-3)
    assert config.epochs == Budget().epochs * variant.share
    assert len(chosen) == {"ideal": 27, "sequences": 14}.get(variant.name, len(known))
    assert {one.sensor for one in chosen} == set(variant.sensors)
    assert config.candidates <= TrainingConfig().candidates  # of each window there are no more


@pytest.fixture
def study(sequence, monkeypatch):
    """The study with one sample, which is there already; nothing is drawn."""
    one = (SampleSpec("planes", "oblique", SECONDS),)
    monkeypatch.setattr(ablate_learned, "SETS", {"held-out": one, "noisy": one})
    monkeypatch.setattr(ablate_learned, "load_sequence", lambda *_, **__: sequence)
    monkeypatch.setattr(ablate_learned, "MapperConfig", lambda: CONFIG)


def keep(folder, variant, budget):
    from ablated_networks import _asked, _path

    folder.mkdir(exist_ok=True)
    about = {"ablation": _asked(variant, budget)}
    write_weights(_path(folder, variant, budget), NAME, random_arrays(), about)


def test_without_torch_what_is_trained_is_evaluated(study, monkeypatch, tmp_path, capsys):
    monkeypatch.setitem(sys.modules, "torch", None)
    out, page, marks = tmp_path / "out", tmp_path / "page.md", "<!-- learned-ablation: {} -->"
    text = f"a\n{marks.format('begin')}\nold\n{marks.format('end')}\nz\n"
    page.write_text(text)
    for variant in VARIANTS[:2]:
        keep(out, variant, Budget())
    asked = ["--out", str(out), "--sets", "noisy"]
    assert main([*asked, "--samples", str(tmp_path)]) == 0
    said = capsys.readouterr()
    assert (
        "not trained yet: fused, votes, quarter, sequences, ideal; training needs torch" in said.err
    )
    assert release.install_extra("train") in said.err
    assert "| on a small budget |" in said.out
    assert "| without noisy sensors |" not in said.out

    assert main([*asked, "--page", str(page)]) == 2
    assert "say --samples FOLDER" in capsys.readouterr().err
    assert page.read_text() == text
    for variant in VARIANTS:
        keep(out, variant, Budget())
    assert main([*asked, "--page", str(page)]) == 0
    assert "| without noisy sensors |" in page.read_text()
    assert "old" not in page.read_text()


def test_weights_of_another_variant_are_refused(tmp_path):
    keep(tmp_path, Variant("base", "as it is", cues=False), TINY)
    with pytest.raises(InputError, match="trained in another way; choose another folder"):
        trained_network(tmp_path, VARIANTS[0], TINY)


def test_networks_are_trained_once_and_never_see_what_is_hidden(tmp_path, monkeypatch, capsys):
    """Weights of what is hidden get no gradient: the decay of weights alone scales them."""
    torch = pytest.importorskip("torch", reason="torch is an extra, [train]")
    from eventsweep.plugins.learned.training.network import Network as TorchNetwork

    few = TrainingSequence("planes", "oblique", FIRST_SEED, "ideal", SECONDS)
    monkeypatch.setattr(data, "sequences", lambda part: (few,))
    variant, samples = BY_NAME["fused"], tmp_path / "samples"
    with pytest.raises(InputError, match="no such samples; make them with `eventsweep train"):
        train(tmp_path, variant, tmp_path, TINY)
    for k, part in enumerate(data.PARTS):
        (samples / part).mkdir(parents=True)
        for window in range(4):
            random_samples(50, seed=8 * k + window).save(
                samples / part / f"{few.name}-{window}.npz"
            )
    train(tmp_path, variant, tmp_path, TINY)
    net = trained_network(tmp_path, variant, TINY)
    assert net.weights.manifest["samples"] == 160
    assert len(net.weights.manifest["history"]) == TINY.epochs
    torch.manual_seed(variant.seed)
    first = TorchNetwork(Architecture()).arrays()["patch.weight"]
    scale = net.weights.arrays["patch.weight"] / first
    assert np.ptp(scale[:, 1:]) < 1e-4
    assert np.ptp(scale[:, 0]) > 1e-2

    monkeypatch.setattr("ablated_networks.VARIANTS", (variant,))
    assert train_missing(tmp_path, None, TINY)
    assert capsys.readouterr().err.count("not trained") == 0
