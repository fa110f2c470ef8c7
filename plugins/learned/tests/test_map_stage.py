"""The mapping stage's key: the weights of learned methods, and their code."""

import shutil

import pytest

from eventsweep.emvs.depth.precision import PRECISION
from eventsweep.emvs.errors import InputError
from eventsweep.eval.jobs.code_version import closure
from eventsweep.eval.jobs.job import Job, code_of
from eventsweep.eval.stages import map as stage
from eventsweep.plugins.learned.networks.weights import packaged

FAMILIES = {"Learned": "learned", "DERD": "derd"}


def parameters(*methods, **values):
    return {"map": {"methods": methods, **values}}


def names(*methods, **values):
    return [path.name for path in stage.code(parameters(*methods, **values))[1]]


def test_the_networks_code_belongs_to_the_key_of_who_runs_them():
    """The core reaches it by an entry point, which no search for imports finds."""
    assert stage.code(parameters("Alg1/H"))[0] == ()
    reached = closure(stage.code(parameters("Learned/H"))[0])
    assert "eventsweep.plugins.learned.networks.network_kernels" in reached


@pytest.mark.parametrize(("family", "name"), FAMILIES.items())
def test_weights_that_ship_belong_to_the_key_of_their_methods(family, name):
    both = [f"{name}.npz", f"{name}.json"]
    assert names("Alg1/H", f"{family}/H") == [*both, PRECISION.name]
    assert names("Alg1/H", "all", "baselines") == [PRECISION.name]


@pytest.mark.parametrize(("family", "name"), FAMILIES.items())
def test_weights_of_ones_own_change_the_key_when_they_change(family, name, tmp_path):
    for suffix in (".npz", ".json"):
        shutil.copy(packaged(name).with_suffix(suffix), tmp_path / f"mine{suffix}")
    asked = parameters(f"{family}/H", **{f"{name}_weights": str(tmp_path / "mine.npz")})
    files = stage.code(asked)[1]
    assert files[:2] == (tmp_path / "mine.npz", tmp_path / "mine.json")
    job = Job("m", "eventsweep.eval.stages.map", asked, ())
    before = code_of(job)
    assert code_of(job) == before
    for file in files[:2]:
        file.write_bytes(file.read_bytes() + b" ")
        after = code_of(job)
        assert after != before
        before = after


@pytest.mark.parametrize("missing", [".npz", ".json"])
def test_weights_that_are_not_there_get_one_line(missing, tmp_path):
    for suffix in {".npz", ".json"} - {missing}:
        (tmp_path / f"mine{suffix}").write_bytes(b"")
    with pytest.raises(InputError, match=f"mine{missing}: no such file") as error:
        stage.code(parameters("DERD/H", derd_weights=str(tmp_path / "mine.npz")))
    assert "\n" not in str(error.value)
