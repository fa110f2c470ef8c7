"""What studies write into the documentation: every number from a file, none typed."""

import json

from PIL import Image

import reproduction
import study_pages
from eventsweep.eval.results.results import Results, Sample, mapper_method
from eventsweep.eval.scoring.metrics import METRICS as KNOWN
from eventsweep.eval.suite.definition import load
from published_table import MONO, RATIOS, TABLE, H
from refusals import line_of
from score_rows import score_row

METRICS = dict.fromkeys(RATIOS, "e")


def study(folder, name="pose-noise", **changes):
    """A study's files as `eventsweep study` leaves them, with numbers to tell apart."""
    curve = {"unit": "m", "low": [0.1, None], "high": [0.2, None], "metric": "mean_error"}
    facts = {
        "study": name, "axis": "noise", "unit": "mm", "cases": ["desk", "boxes"], "seeds": [0, 1],
        "amounts": [0, 5], "breaks_at": {"Alg1/H": 3.25, "EMVS/cam0": None},
        "curves": [
            {**curve, "method": "Alg1/H", "mean": [0.123, 0.123 * (1 + 5 / 3.25)]},
            {**curve, "method": "EMVS/cam0", "mean": [0.2, 0.3456]},
        ],
        "failures": {}, "versions": {}, "cpu_s": 90.0, **changes,
    }  # fmt: skip
    (folder / f"{name}.json").write_text(json.dumps(facts))
    Image.new("RGB", (60, 30), "white").save(folder / f"{name}.png")


def docs(folder, mark):
    path = folder / "docs" / "page.md"
    path.parent.mkdir()
    path.write_text(f"before\n<!-- {mark}: begin -->\nold\n<!-- {mark}: end -->\nafter\n")
    return path


def test_the_page_has_every_study_with_its_figure_and_breaking_points(tmp_path):
    study(tmp_path, "planes")
    study(tmp_path, "pose-noise", failures={"map/desk/5": "it died"})
    path = docs(tmp_path, study_pages.MARK)
    study_pages.write(tmp_path, path)
    text = path.read_text()
    assert "old" not in text
    assert text.startswith("before\n")
    assert text.endswith("after\n")
    line = "mm | 3.25 | never (×1.7) |"
    for words in (f"| [`pose-noise`](#pose-noise) | {line}", "Together 3 CPU min.", "it died"):
        assert words in text
    assert text.index("### pose-noise") < text.index("### planes")
    with Image.open(tmp_path / "docs" / "images" / "study_pose-noise.png") as image:
        assert image.size == (60, 30)


def test_a_folder_without_studies_or_figures_and_a_page_without_marks_are_refused(tmp_path):
    path = docs(tmp_path, "another")
    assert "not a study" in line_of(study_pages.write, tmp_path, path)
    study(tmp_path)
    assert "needs the lines" in line_of(study_pages.write, tmp_path, path)
    (tmp_path / "pose-noise.png").unlink()
    assert "run the study again" in line_of(study_pages.write, tmp_path, path)


def flights(values, case="mvsec-flying", mapper="default"):
    """A result with, per method, one value of every metric for each seed."""
    seeds = range(len(next(iter(values.values()))))
    rows = [
        score_row(case, "all", mapper_method(method, mapper), metric, found[seed], "x", "lower",
                  seed=seed)
        for seed in seeds
        for method, found in values.items()
        for metric in (*RATIOS, "points")
    ]  # fmt: skip
    suite, _ = load(reproduction.SUITE)
    return Results(
        rows, samples=tuple(Sample(case, seed, metrics=METRICS) for seed in seeds),
        suite=suite.name, subset="all", digest=suite.digest,
        definition=suite.model_dump(mode="json"), cases={case: "x"}, seeds=tuple(seeds),
    )  # fmt: skip


def test_ratios_are_of_means_over_flights_and_turned_pairs_are_named():
    text = reproduction.report(flights({"Alg1/H": [1.0, 2.0], "EMVS/cam0": [2.0, 2.0]}))
    (line,) = [line for line in text.splitlines() if line.startswith("| published thresholds")]
    assert line.count("0.75 (0.50 to 1.00)") == len(RATIOS) + 1
    assert "| published | 0.59 | 0.66 | 0.35 |" in text
    errors = {"Alg1/H": [1.0], "EMVS/cam0": [3.0], "ESVO/own-rate": [4.0]}
    text = reproduction.report(flights(errors))
    (line,) = [line for line in text.splitlines() if line.startswith("- By mean error")]
    assert "2 of 3 pairs" in line
    assert "`ESVO/own-rate` and `EMVS/cam0`" in line


def test_the_suites_have_what_the_tables_show_and_the_ratios_are_those_quoted():
    suites = [load(name)[0] for name in (reproduction.SUITE, "mvsec-table-v3")]
    shown = {case for case, *_ in reproduction.SETTINGS}
    assert shown == {case for suite in suites for case in suite.cases}
    for suite in suites:
        has_what_is_shown(suite)
    ratios = [round(H.value(metric) / MONO.value(metric), 2) for metric in RATIOS]
    assert ratios == [0.59, 0.66, 0.35]


def has_what_is_shown(suite):
    assert set(RATIOS) < set(suite.metrics) <= {metric.name for metric in KNOWN}
    methods = suite.mappers["default"]["methods"]
    assert {line.ours for line in TABLE} <= set(methods)
    for case, of_h, of_mono, _ in reproduction.SETTINGS:
        if case not in suite.cases:
            continue
        for ending, method in ((of_h, "Alg1/H"), (of_mono, "EMVS/cam0")):
            mapper = ending.strip() or "default"
            if mapper not in suite.mappers:
                continue  # of the other suite's case of that name
            assert mapper in suite.cases[case].mappers
            assert method in suite.mappers[mapper]["methods"]
