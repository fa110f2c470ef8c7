"""The mapping stage's key: everything that decides a depth map, weights and tables included."""

import shutil

import pytest

from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import BY_NAME
from eventsweep.emvs.depth.precision import PRECISION
from eventsweep.emvs.learned.weights import packaged
from eventsweep.eval.jobs.code_version import closure
from eventsweep.eval.jobs.job import Job, code_of
from eventsweep.eval.suite.stages import map as stage
from one_line import refused

FAMILIES = {"Learned": "learned", "DERD": "derd"}


def parameters(*methods, **values):
    return {"map": {"methods": methods, **values}}


def names(*methods, **values):
    return [path.name for path in stage.code(parameters(*methods, **values))[1]]


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
    job = Job("m", "eventsweep.eval.suite.stages.map", asked, ())
    before = code_of(job)
    assert code_of(job) == before
    for file in files[:2]:
        file.write_bytes(file.read_bytes() + b" ")
        after = code_of(job)
        assert after != before
        before = after


@pytest.mark.parametrize("name", BY_NAME)
def test_a_baselines_code_belongs_to_the_key_of_who_runs_it(name):
    """It is imported by a computed name, which no search for imports finds."""
    modules = stage.code(parameters("Alg1/H", name))[0]
    place = {"SGM": "sgm", "ESVO": "esvo", "GTS": "gts", "Frames": "sgm"}[name.split("/")[0]]
    assert modules == (f"{baselines.__name__}.{place}",)
    assert f"{baselines.__name__}.rectification_kernels" in closure(modules)


def test_groups_have_the_code_of_all_their_baselines():
    each = {one.estimate.__module__ for one in BY_NAME.values()}
    assert set(stage.code(parameters("all", "baselines"))[0]) == each
    assert stage.code(parameters("all"))[0] == ()


@pytest.mark.parametrize("missing", [".npz", ".json"])
def test_weights_that_are_not_there_get_one_line(missing, tmp_path):
    for suffix in {".npz", ".json"} - {missing}:
        (tmp_path / f"mine{suffix}").write_bytes(b"")
    asked = parameters("DERD/H", derd_weights=str(tmp_path / "mine.npz"))
    assert f"mine{missing}: no such file" in refused(stage.code, asked)
