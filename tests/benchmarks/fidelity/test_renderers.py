"""Changes between graphics libraries are those that were put in, and the page states them."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from eventsweep.emvs.errors import InputError
from eventsweep.eval.suite.results import Sample, SampleFacts
from eventsweep.plugins.ranking.entries import RENDERERS_DIFFER_PERCENT
from places import ROOT
from renderers import compare, seed_change, text

FACTS = SampleFacts("same", "", "", "a library", {}, {}, {})


def result(factor=1.0, sequence="same", cases=("wall", "dark"), seeds=(0, 1)):
    """Two methods; `factor` multiplies the errors of the first one in the first case."""
    rows = [
        (case, method, seed, (1 + seed) * (factor if (k, m) == (0, 0) else 1.0))
        for k, case in enumerate(cases)
        for m, method in enumerate(("a", "b"))
        for seed in seeds
    ]
    frame = pd.DataFrame(rows, columns=["case", "method", "seed", "value"])
    samples = [
        Sample(case, s, replace(FACTS, sequence=sequence if s == seeds[0] else "same"))
        for case in cases
        for s in seeds
    ]
    rows = frame.assign(window="all", metric="mean_error")
    return SimpleNamespace(suite="tiny", cases=cases, seeds=seeds, rows=rows, samples=samples)


def test_a_change_of_one_method_in_one_case_is_found():
    same = compare(result(), result())
    assert (same.equal, same.sequences, same.each.max(), same.means.max()) == (4, 4, 0, 0)
    found = compare(result(), result(1.21, "other"))
    assert (found.equal, found.sequences) == (2, 4)
    assert np.allclose(sorted(found.each), [0] * 6 + [0.21] * 2)
    assert np.allclose(found.means, [1.21**0.5 - 1, 0])
    assert np.allclose(seed_change(result()), [1, 1])  # the second seed's errors are twice as large


def test_the_table_has_a_line_for_each_result():
    lines = text({"EGL": result(), "GPU": result(1.21, "other")}).splitlines()
    assert "| EGL: a library | 4 of `tiny` | – | – | 1e+02 |" in lines
    assert "| GPU: a library | 2 of 4 | 0, 21 | 10 |  |" in lines


def test_results_without_a_common_case_are_refused():
    with pytest.raises(InputError, match="no case, method and seed in common"):
        compare(result(), result(cases=("hall",)))


def test_the_product_states_the_largest_change_that_was_measured():
    page = (ROOT / "plugins" / "ranking" / "ranking.md").read_text("utf-8")
    block = page.split("<!-- renderers: begin -->")[1].split("<!-- renderers: end -->")[0]
    changes = re.findall(r"\| ([0-9.e-]+) \|  \|$", block, re.MULTILINE)
    assert len(changes) >= 3
    assert max(map(float, changes)) <= RENDERERS_DIFFER_PERCENT
