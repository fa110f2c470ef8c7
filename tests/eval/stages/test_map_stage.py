"""The mapping stage's key: everything that decides a depth map, weights and tables included."""

import pytest

from eventsweep.emvs import baselines
from eventsweep.emvs.baselines import BY_NAME
from eventsweep.emvs.depth.precision import PRECISION
from eventsweep.eval.jobs.code_version import closure
from eventsweep.eval.stages import map as stage


def parameters(*methods, **values):
    return {"map": {"methods": methods, **values}}


def names(*methods, **values):
    return [path.name for path in stage.code(parameters(*methods, **values))[1]]


def test_the_table_of_precision_belongs_to_every_key():
    assert names("Alg1/H", "all", "baselines") == [PRECISION.name]


@pytest.mark.parametrize("name", BY_NAME)
def test_a_baselines_code_belongs_to_the_key_of_who_runs_it(name):
    """It is imported by a computed name, which no search for imports finds."""
    modules = stage.code(parameters("Alg1/H", name))[0]
    place = {"SGM": "sgm", "ESVO": "esvo", "GTS": "gts", "Frames": "sgm"}[name.split("/")[0]]
    assert modules == (f"{baselines.__name__}.{place}",)
    assert f"{baselines.__name__}.pixels_kernels" in closure(modules)


def test_groups_have_the_code_of_all_their_baselines():
    each = {one.estimate.__module__ for one in BY_NAME.values()}
    assert set(stage.code(parameters("all", "baselines"))[0]) == each
    assert stage.code(parameters("all"))[0] == ()
