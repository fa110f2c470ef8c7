"""The scoring stage of a suite's jobs: what its numbers are comparable to."""

from dataclasses import replace

from eventsweep.eval.gate.compare import Choice, Tolerances, compare
from eventsweep.eval.results.results import Results, Sample
from eventsweep.eval.results.series import measured_of
from eventsweep.eval.scoring import metric_versions as versions_of_metrics
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.scoring.outlier_causes import CAUSES
from score_rows import score_row

CAUSE_METRICS = {"outlier_points", *(f"cause_{cause}" for cause in CAUSES)}


def test_causes_have_versions_of_their_own_and_others_are_not_comparable(monkeypatch):
    """A change of what decides a cause changes the version of the causes, and nothing else."""
    before = metric_versions()
    monkeypatch.setattr(
        versions_of_metrics, "CAUSE_MODULES", ("eventsweep.eval.scoring.outlier_causes",)
    )
    after = metric_versions()
    assert {name for name in before if before[name] != after[name]} == CAUSE_METRICS
    # The same number under another definition of the causes is no longer the same number.
    row = score_row("wall", "all", "Alg1/H", "cause_occlusion", 40.0, "%", "none", seed=0)
    sample = Sample("wall", 0, "s", scene="scene", metrics={"cause_occlusion": "one"})
    old = Results(
        [row], samples=(sample,), suite="suite", definition={"metrics": ["cause_occlusion"]},
        cases={"wall": "c"}, seeds=(0,),
    )  # fmt: skip
    causes = Choice(metrics=("cause_occlusion",))
    new = replace(old, samples=(replace(sample, metrics={"cause_occlusion": "two"}),))
    (same,) = compare(measured_of(old).series, measured_of(old), Tolerances(), causes)
    (nothing, other) = compare(measured_of(old).series, measured_of(new), Tolerances(), causes)
    assert (same.status, other.status) == ("same", "not comparable")
    assert "none of the 1 numbers that decide could be compared" in nothing.why
