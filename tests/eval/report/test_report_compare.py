"""Results side by side: what was changed, what came of it, and how sure that is."""

import csv
import json
import re
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from eventsweep.emvs.config import MapperConfig
from eventsweep.eval.cli.main import main
from eventsweep.eval.report.compare import pictures as side_by_side
from eventsweep.eval.report.compare.page import (
    compare,
    comparison_page,
    lead_text,
    number_grids,
    settings_text,
    write_comparison,
)
from eventsweep.eval.report.compare.results import read_compared
from eventsweep.eval.report.html import page_text
from eventsweep.eval.results.results import JobNote, Results, Sample, write_results
from eventsweep.eval.scoring.metrics import PRIMARY
from eventsweep.eval.scoring.significance import holm, interval
from eventsweep.eval.suite import output
from eventsweep.sim.config import SimConfig
from refusals import command_refused, line_of
from report_data import WellFormed, report_data
from score_rows import score_row

METRICS = {"mean_error": ("m", "lower"), "bad_published": ("%", "lower"),
           "points": ("px", "higher"), "rmse": ("m", "lower"),
           "common_mean_error": ("m", "lower")}  # fmt: skip
FACTS = {"sequence": "sequence", "truth": "truth", "scene": "scene", "renderer": "gl"}


def configuration(case="desk", **values):
    """A run's, with some values of the mapper, `sim_` and `score_` ones too."""
    groups = {"sim": {}, "score": {}, "map": {}}
    for name, value in values.items():
        group, _, rest = name.partition("_")
        groups[group][rest] = value
    sim = SimConfig(**groups["sim"]).model_dump(mode="json")
    mapper = MapperConfig(**groups["map"]).model_dump(mode="json")
    return {"score": {"border_px": 0, **groups["score"]}, case: {"sim": sim, "map": mapper}}


def run_folder(path, factor=1.0, case="desk", **changes):
    """`results.json` of a run of one seed; `factor` changes its mean error."""
    results = report_data(case).results
    rows = results.rows
    rows.loc[rows["metric"] == "mean_error", "value"] *= factor
    path.mkdir(parents=True)
    changes.setdefault("configuration", configuration(case))
    about = {name: changes.pop(name) for name in ("seed", "metrics") if name in changes}
    samples = tuple(replace(sample, **about) for sample in results.samples)
    rows = rows.assign(seed=samples[0].seed)
    write_results(path, replace(results, rows=rows, samples=samples, **changes))
    return path


def suite_folder(path, values, *, mapper=None, facts=FACTS, windows=None, jobs=()):
    """`suite.json`; values: case -> method -> metric -> seed -> values of its windows."""
    starts = windows or [0.0, 0.1, 0.2]
    spec = {"scene": "none", "rig": "davis346", "mappers": ["default"], "sim": {}, "seconds": 1.0,
            "windows": [{"start_s": start, "duration_s": 0.1} for start in starts]}  # fmt: skip
    definition = {"cases": dict.fromkeys(values, spec), "mappers": {"default": mapper or {}},
                  "score": {}, "metrics": list(METRICS)}  # fmt: skip
    seeds = {seed for case in values.values() for method in case.values()
             for metric in method.values() for seed in metric}  # fmt: skip
    samples = [
        (Sample(case, seed, **facts), rows)
        for case, methods in values.items()
        for seed in sorted(seeds)
        if (rows := list(rows_of(case, seed, methods)))
    ]
    rows = [row for _, found in samples for row in found]
    samples = tuple(sample for sample, _ in samples)
    path.mkdir(parents=True)
    output.write(path, Results(
        rows, samples=samples, suite="s", subset="all", digest="d", definition=definition,
        seeds=tuple(seeds), jobs=jobs,
    ))  # fmt: skip
    return path


def rows_of(case, seed, methods):
    for method, metrics in methods.items():
        for metric, by_seed in metrics.items():
            for k, value in enumerate(by_seed.get(seed, ())):
                about = (case, f"w{k:03d}", method, metric, value, *METRICS[metric])
                yield score_row(*about, seed=seed)


def spread(seeds, shift=0.0, noise=0.01, windows=3, draw=0):
    """Values of windows per seed, and differences to those of `shift` 0 that vary by `noise`."""
    base, own = np.random.default_rng(1), np.random.default_rng([draw, int(shift != 0)])
    return {
        seed: tuple(0.2 + base.normal(0, 0.05, windows) + shift + own.normal(0, noise, windows))
        for seed in range(seeds)
    }


def compared(*folders):
    return compare(read_compared(folders))


def text_of(comparison):
    return page_text(comparison_page(comparison))


def compared_suites(path, *values, **last):
    """A comparison of suites; values: method -> metric -> seed -> values, of the case `desk`."""
    folders = [
        suite_folder(path / "abc"[k], {"desk": one}, **(last if k == len(values) - 1 else {}))
        for k, one in enumerate(values)
    ]
    return compared(*folders)


def mean_errors(*values):
    return [{"Alg1/H": {"mean_error": one}} for one in values]


def two_runs(path, factor=2.0, **changes):
    """Folders of a run and of one whose mean error is so many times as large."""
    return [run_folder(path / "a"), run_folder(path / "b", factor, **changes)]


def numbers(comparison, pair=0, **wanted):
    found = (*comparison.pairs[pair].means, *comparison.pairs[pair].cases)
    return [one for one in found if all(getattr(one, k) == v for k, v in wanted.items())]


def number(comparison, pair=0, **wanted):
    wanted = {"method": "Alg1/H", "metric": "mean_error", **wanted}
    (found,) = numbers(comparison, pair, **wanted)
    return found


# --- settings
def test_the_page_says_who_is_better_then_what_was_changed_and_ends_with_settings(tmp_path, capsys):
    folders = [
        run_folder(tmp_path / name, configuration=configuration(map_planes=planes))
        for name, planes in (("a", 100), ("b", 20))
    ]
    assert main(["compare", *map(str, folders), "--out", str(tmp_path / "out")]) == 0
    assert "map.planes 100 → 20" in capsys.readouterr().out
    text = (tmp_path / "out/compare.html").read_text()
    said = (
        '<p class="lead">b equals a', "b against a, desk: ", "planes 100 → 20", 'id="numbers0"',
        'id="settings"',
    )  # fmt: skip
    places = [text.index(what) for what in said]
    assert places == sorted(places)
    lines = list(csv.reader((tmp_path / "out/tables/settings.csv").open()))
    assert lines == [["setting", "a", "b"], ["map.planes", "100", "20"]]


def test_settings_of_simulator_and_scores_differ_too_and_have_units(tmp_path):
    versions = {"eventsweep": "0.1", "numpy": "9"}
    settings = configuration(sim_duration_s=2.0, map_min_depth_m=0.5)
    comparison = compared(
        run_folder(tmp_path / "a"),
        run_folder(tmp_path / "b", platform="elsewhere", versions=versions, configuration=settings),
    )
    found = {one.name: (one.unit, *one.texts) for one in comparison.differing}
    assert found["sim.duration_s"] == ("s", "unset", "2")
    assert (found["map.min_depth_m"], found["platform"][2]) == (("m", "unset", "0.5"), "elsewhere")
    assert found["numpy"][2] == "9"
    assert "map.planes" not in found
    assert "map.planes" in {one.name for one in comparison.settings}, "equal ones can be looked up"


def lead_of(path, *by_method):
    """The first line of a page; per method, values of two results."""
    both = [{m: {"mean_error": pair[k]} for m, pair in by_method} for k in (0, 1)]
    return lead_text(compared_suites(path, *both).pairs[0])


def scaled(values, factor, noise=0.0):
    """Each seed's values times about a factor."""
    return {s: tuple(v * (factor + noise * (-1) ** s) for v in of) for s, of in values.items()}


def test_the_first_line_says_who_is_better_and_by_how_much_in_the_middle(tmp_path):
    base = dict.fromkeys(range(6), (0.2, 0.2))
    better = [(f"m{k}", (base, scaled(base, 1 - share, 0.01)))
              for k, share in enumerate((0.1, 0.2, 0.6))]  # fmt: skip
    said = lead_of(tmp_path / "better", *better)
    half = 100 * 0.01 * np.sqrt(6 / 5) / np.sqrt(6) * stats.t.ppf(0.975, 5)
    assert said == (
        f"b is better than a: mean error −20.0 % ± {half:.1f} (median of 3 methods)."
    )  # fmt: skip
    worse = [better[0], ("z", (base, scaled(base, 1.3, 0.01)))]
    assert "is better than a in 1 number and worse in 1: " in lead_of(tmp_path / "both", *worse)
    assert lead_of(tmp_path / "worse", worse[1]).startswith("b is worse than a: mean error +30.0 %")
    same = lead_of(tmp_path / "same", ("m", (base, base)))
    assert same == "b equals a in every number that is judged."
    noisy = lead_of(tmp_path / "none", ("m", (base, scaled(base, 1.0, 0.3))))
    assert noisy.startswith("b shows no difference to a: mean error ")
    one = {0: (0.2,)}
    alone = lead_of(tmp_path / "one", ("m", (one, scaled(one, 1.5))))
    assert alone == "b against a: undecided, one seed: mean error +50.0 % (no interval)."


def test_what_cannot_be_compared_has_no_change(tmp_path):
    folders = [run_folder(tmp_path / "a"), run_folder(tmp_path / "b", versions={"eventsweep": "9"})]
    (pair,) = compared(*folders).pairs
    assert lead_text(pair) == "b cannot be compared with a."


def test_the_verdict_stands_beside_the_names(tmp_path):
    for names, first in (("ab", ["method"]), ("abc", ["method", "result"])):
        folders = [run_folder(tmp_path / names / n, 1.0 + k) for k, n in enumerate(names)]
        page = comparison_page(compared(*folders))
        grids = [block for section in page.sections for block in _grids(section.blocks)]
        tables = [grid for grid in grids if grid.heads[0].title == "method"]
        assert tables
        for grid in tables:
            titles = [f"{head.title} {head.unit}".strip() for head in grid.heads]
            assert titles[: len(first) + 2] == [*first, "verdict", "Δ %"]
            assert len({len(line) for line in grid.lines} | {len(titles)}) == 1
            at = len(first)
            assert all(
                line[at].text.startswith(("undecided", "equal", "not")) for line in grid.lines
            )


def _grids(blocks):
    for block in blocks:
        if block.kind == "grid":
            yield block
        yield from _grids(getattr(block, "blocks", ()))


def test_a_default_that_is_stated_is_no_difference(tmp_path):
    values = {"desk": {"Alg1/H": {"mean_error": spread(2)}}}
    folders = [
        suite_folder(tmp_path / name, values, mapper=mapper)
        for name, mapper in (("a", {"planes": 100}), ("b", None), ("c", {"planes": 50}))
    ]
    assert compared(*folders[:2]).differing == ()
    assert settings_text(compared(*folders[:2])) == "No setting differs."
    (planes,) = compared(*folders[1:]).differing
    assert planes.labelled_texts == ("100", "50")


def test_a_setting_that_one_case_alone_has_names_it(tmp_path):
    folders = []
    for name, planes in (("a", 100), ("b", 30)):
        both = {**configuration("desk"), "boxes": configuration("x", map_planes=planes)["x"]}
        results = report_data("desk", "boxes").results
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, replace(results, configuration=both))
        folders.append(tmp_path / name)
    (planes,) = compared(*folders).differing
    assert (planes.name, planes.cases, planes.texts) == ("map.planes", ("boxes",), ("100", "30"))


def test_a_suites_code_and_failures_are_named(tmp_path):
    values = {"desk": {"Alg1/H": {"mean_error": spread(2)}}}
    jobs = (JobNote("map/desk/seed0", code="abc"), JobNote("map/desk/seed1", failure="no room"))
    comparison = compared(
        suite_folder(tmp_path / "a", values, jobs=(JobNote("map/desk/seed0", code="def"),)),
        suite_folder(tmp_path / "b", values, jobs=jobs),
    )
    (code,) = comparison.differing
    assert (code.name, code.texts) == ("code of map", ("def", "abc"))
    assert "Failed in b: map/desk/seed1: no room" in comparison.pairs[0].only_in_one


# --- numbers
def test_seeds_and_windows_are_paired_and_the_interval_is_that_of_the_differences(tmp_path):
    first, other = spread(5), spread(5, 0.02, 0.004)
    one = number(compared_suites(tmp_path, *mean_errors(first, other)))
    groups = [np.subtract(other[seed], first[seed]) for seed in first]
    assert (one.low, one.high) == interval(groups)
    assert one.first == pytest.approx(np.mean(list(first.values())))
    assert one.change == pytest.approx(np.mean(groups))
    means = [np.mean(list(values.values()), axis=1) for values in (other, first)]
    assert one.p == pytest.approx(stats.ttest_rel(*means).pvalue)
    assert (one.verdict, one.seeds) == ("worse", 5)
    unpaired = stats.ttest_ind(*means).pvalue
    assert one.p < 0.05 < unpaired, "seeds differ by more than the results do"


@pytest.mark.parametrize(("metric", "shift", "verdict"), [
    ("mean_error", 0.05, "worse"), ("mean_error", -0.05, "better"),
    ("mean_error", 0.0, "no difference shown"), ("points", 0.05, "better"),
    ("rmse", 0.05, "not judged"),
])  # fmt: skip
def test_verdicts_follow_the_metrics_direction(tmp_path, metric, shift, verdict):
    values = [{"Alg1/H": {metric: one}} for one in (spread(6, 0, 0), spread(6, shift, 0.002))]
    assert number(compared_suites(tmp_path, *values), metric=metric).verdict == verdict


def test_equal_is_equal_and_not_merely_undecided(tmp_path):
    found = numbers(compared(*two_runs(tmp_path, 1.0)))
    assert {one.verdict for one in found if one.metric in PRIMARY} == {"equal"}


def test_many_numbers_need_more_to_be_called_different(tmp_path):
    comparison = compared_suites(tmp_path, *(
        {f"m{k}": {"mean_error": spread(4, shift, 0.008, draw=k)} for k in range(12)}
        for shift in (0.0, 0.02)
    ))  # fmt: skip
    found = numbers(comparison)
    assert [one.p_holm for one in found] == holm([one.p for one in found])
    lost = [one for one in found if one.p < 0.05 <= one.p_holm]
    assert lost, "a draw that shows nothing"
    assert {(one.verdict, one.why) for one in lost} == {
        ("no difference shown", "worse, but for the number of tests")
    }
    assert all(one.lost_to_correction for one in lost)
    assert f"({len(lost)} of these only for the number of tests" in text_of(comparison)


def test_one_seed_has_no_interval_and_decides_nothing(tmp_path, capsys):
    folders = two_runs(tmp_path)
    one = number(compared(*folders))
    assert np.isnan([one.low, one.high, one.p]).all()
    assert (one.verdict, one.words) == ("undecided", "undecided (one seed: worse here)")
    assert main(["compare", *map(str, folders), "--out", str(tmp_path / "out")]) == 0
    out = capsys.readouterr().out
    (line,) = [line for line in out.splitlines() if "Alg1/H" in line]
    assert "undecided, worse here" in line
    assert " – " in line
    assert "± 0" not in out


def test_one_seed_of_several_is_compared_with_itself_alone(tmp_path):
    values = spread(5)
    one_seed = {3: tuple(2 * value for value in values[3])}
    comparison = compared_suites(tmp_path, *mean_errors(values, one_seed))
    one = number(comparison)
    assert (one.seeds, one.verdict) == (1, "undecided")
    assert one.first == pytest.approx(np.mean(values[3]))
    assert "Only a has the seeds 0, 1, 2, 4." in comparison.pairs[0].only_in_one


def test_without_a_common_seed_nothing_is_paired(tmp_path):
    comparison = compared(*two_runs(tmp_path, seed=8))
    one = number(comparison)
    assert (one.verdict, one.why) == ("undecided", "no seed in common")
    assert one.change == pytest.approx(one.first)
    assert "nothing is paired" in comparison.pairs[0].data[0]
    assert lead_text(comparison.pairs[0]) == "b against a: undecided, no seed in common."


def test_means_weigh_cases_alike_and_their_seeds_stay_apart(tmp_path):
    cases = {"desk": (4, 0.01), "boxes": (6, 0.03)}
    folders = []
    for k, name in enumerate("ab"):
        spreads = {case: spread(n, k * shift, 0.002) for case, (n, shift) in cases.items()}
        values = {case: {"Alg1/H": {"mean_error": one}} for case, one in spreads.items()}
        folders.append(suite_folder(tmp_path / name, values))
    comparison = compared(*folders)
    mean = number(comparison, case="mean of 2 cases")
    singles = [number(comparison, case=case) for case in cases]
    assert mean.change == pytest.approx(np.mean([one.change for one in singles]))
    assert mean.low < mean.change < mean.high
    assert (comparison.pairs[0].headline, mean.verdict) == ((mean,), "worse")


# --- what can be compared, and what cannot
def test_what_is_common_is_compared_and_the_rest_is_named(tmp_path):
    h, g = ({"mean_error": spread(3)} for _ in range(2))
    comparison = compared(
        suite_folder(tmp_path / "a", {"desk": {"Alg1/H": h, "Alg1/G": g}, "boxes": {"Alg1/H": h}}),
        suite_folder(tmp_path / "b", {"desk": {"Alg1/H": h, "Own": h}, "stairs": {"Own": h}}),
    )
    assert {(one.case, one.method) for one in numbers(comparison)} == {("desk", "Alg1/H")}
    assert set(comparison.pairs[0].only_in_one) == {
        "Only a has the case boxes.", "Only a has the method Alg1/G.",
        "Only b has the case stairs.", "Only b has the method Own.",
    }  # fmt: skip


def test_windows_of_another_time_are_no_pair(tmp_path):
    values = spread(3)
    both = mean_errors(values, values)
    comparison = compared_suites(tmp_path, *both, windows=[0.0, 0.15, 0.2])
    mean = np.mean([[v[0], v[2]] for v in values.values()])
    assert number(comparison).first == pytest.approx(mean)
    assert comparison.pairs[0].only_in_one == (
        "Only a has the window w001 at 0.15 s.", "Only b has the window w001 at 0.2 s.",
    )  # fmt: skip


@pytest.mark.parametrize(("changes", "told"), [
    ({}, ()), ({"sequence": "x"}, ("not the same events, the same true depth",)),
    ({"sequence": "x", "truth": "y"}, ("not the same data", "another true depth")),
    ({"sequence": ""}, ("no hash shows",)),
])  # fmt: skip
def test_other_data_are_told(tmp_path, changes, told):
    both = mean_errors(spread(3), spread(3))
    comparison = compared_suites(tmp_path, *both, facts={**FACTS, **changes})
    sentences = comparison.pairs[0].data
    assert len(sentences) == bool(told)
    assert all(words in sentences[0] for words in told)
    assert all(sentence in text_of(comparison) for sentence in sentences)
    if changes.get("sequence"):
        assert "seeds and windows are paired, pixels are not" in sentences[0]


@pytest.mark.parametrize(("changes", "why"), [
    ({"configuration": configuration(score_border_px=5)}, "score.border_px"),
    ({"metrics": {"mean_error": "x"}}, "computes something else"),
    ({"versions": {"eventsweep": "9.9"}}, "9.9"),
])  # fmt: skip
def test_numbers_of_another_kind_show_no_difference(tmp_path, changes, why):
    first = {"metrics": {"mean_error": "w"}} if "metrics" in changes else {}
    folders = [run_folder(tmp_path / "a", **first), run_folder(tmp_path / "b", 2.0, **changes)]
    comparison = compared(*folders)
    one = number(comparison)
    assert one.verdict == "not comparable"
    assert why in one.why
    for line in table(comparison, "desk", "mean_error").lines:
        assert [cell.text for cell in line[3:8]] == ["–"] * 5


def test_common_pixels_of_other_methods_are_not_comparable(tmp_path):
    values = {metric: spread(2) for metric in ("common_mean_error", "mean_error")}
    both = {"Alg1/H": values}, {"Alg1/H": values, "Alg1/G": values}
    comparison = compared_suites(tmp_path, *both)
    assert number(comparison).verdict == "equal"
    assert number(comparison, metric="common_mean_error").verdict == "not comparable"


def test_an_undefined_window_is_left_out_of_both_and_counted(tmp_path):
    first, other = spread(2), spread(2, 0.1)
    other[1] = (np.nan, *other[1][1:])
    one = number(compared_suites(tmp_path, *mean_errors(first, other)))
    assert one.first == pytest.approx(np.mean([np.mean(first[0]), np.mean(first[1][1:])]))
    assert "undefined in 1 of 6 windows" in one.why


def other_case(path):
    run_folder(path, case="boxes")


def other_method(path):
    path.mkdir()
    row = score_row("desk", "all", "Own", "mean_error", 1.0, "m", "lower")
    write_results(path, Results((row,)))


@pytest.mark.parametrize(("make", "words"), [
    (other_case, "nothing to compare"), (other_method, "nothing to compare"), (lambda _: 0, ""),
], ids=["case", "method", "missing"])  # fmt: skip
def test_nothing_in_common_is_one_line_and_leaves_nothing(tmp_path, capsys, make, words):
    make(tmp_path / "b")
    folders = run_folder(tmp_path / "a"), tmp_path / "b"
    assert words in command_refused(capsys, "compare", *folders, "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_one_result_or_a_damaged_definition_is_refused_in_one_line(tmp_path):
    assert "1 result given, needs two" in line_of(read_compared, [run_folder(tmp_path / "one")])
    folder = suite_folder(tmp_path / "a", {"desk": mean_errors(spread(1))[0]})
    content = json.loads((folder / "suite.json").read_text())
    del content["definition"]["cases"]
    (folder / "suite.json").write_text(json.dumps(content))
    assert "definition is damaged" in line_of(read_compared, [folder, folder])


# --- the page
def table(comparison, title, metric):
    return number_grids(comparison)[title][metric]


def test_two_folders_of_one_name_are_told_apart(tmp_path):
    folders = [run_folder(tmp_path / parent / "run") for parent in ("a", "b")]
    assert [one.name for one in read_compared(folders)] == ["1: a/run", "2: b/run"]


def test_every_column_has_one_unit_and_cells_have_none(tmp_path):
    for grids in number_grids(compared(*two_runs(tmp_path))).values():
        for grid in grids.values():
            cells = [cell.text for line in grid.lines for cell in line[1:-1]]
            assert cells
            assert not [text for text in cells if re.search(r"[a-zA-Z%]", text)]


def test_tables_hold_the_same_numbers(tmp_path, capsys):
    folders = two_runs(tmp_path)
    write_comparison(folders, tmp_path / "out")
    assert all(path.name.isascii() for path in (tmp_path / "out/tables").iterdir())
    lines = list(csv.reader((tmp_path / "out/tables/desk-mean_error.csv").open()))
    assert lines[0] == ["method", "a [cm]", "b [cm]", "Δ [cm]", "Δ from [cm]", "Δ to [cm]",
                        "Δ [%]", "seeds", "p [Holm]", "verdict"]  # fmt: skip
    assert len(lines) > 3
    for _, first, second, change, low, high, share, seeds, p, verdict in lines[1:]:
        assert float(second) == pytest.approx(2 * float(first))
        assert (float(change), float(share)) == (pytest.approx(float(first)), pytest.approx(100))
        assert (low, high, seeds, p) == ("", "", "1", "")
        assert verdict == "undecided (one seed: worse here)"
    # Scripts get the same as people.
    words = [*map(str, folders), "--out", str(tmp_path / "json"), "--json"]
    assert main(["compare", *words]) == 0
    (pair,) = json.loads(capsys.readouterr().out)["pairs"]
    found = {(one["method"], one["metric"]): one for one in pair["numbers"]}
    one = found["Alg1/H", "mean_error"]
    assert (len(found), one["verdict"], one["low"]) == (len(pair["numbers"]), "undecided", None)
    assert one["change"] == pytest.approx(one["first"])


def test_several_results_have_a_line_each(tmp_path):
    folders = [run_folder(tmp_path / name, k + 1.0) for k, name in enumerate("abc")]
    comparison = compared(*folders)
    lines = table(comparison, "desk", "mean_error").lines
    methods = [(line[0].text, line[1].text) for line in lines]
    assert methods[:2] == [(methods[0][0], "b"), (methods[0][0], "c")]
    assert [lines[k][3].value / lines[k][2].value for k in (0, 1)] == pytest.approx([2, 3])
    text = text_of(comparison)
    WellFormed(text)
    assert "b against a" in text
    assert "c against a" in text


def test_the_page_is_whole_and_loads_nothing(tmp_path):
    folders = two_runs(tmp_path)
    write_comparison(folders, tmp_path / "out")
    text = (tmp_path / "out/compare.html").read_text()
    page = WellFormed(text)
    links = [source for source in page.sources if not source.startswith(("data:", "#"))]
    found = [(tmp_path / "out" / link).resolve() for link in links]
    assert found == [folder.resolve() / "results.json" for folder in folders]
    assert not re.search(r"https?://", text)
    assert len(page.ids) == len(set(page.ids))


def test_names_from_files_are_escaped(tmp_path):
    hostile = "<script>alert(1)</script>"
    rows = (score_row(hostile, "all", hostile, "mean_error", 1.0, "m", "lower"),)
    folders = [tmp_path / name for name in ("a<b>&'c", "plain")]
    for folder in folders:
        folder.mkdir()
        settings = {hostile: {"map": {hostile: folder.name}}, "more": hostile}
        about = {"versions": {hostile: hostile}, "platform": folder.name}
        write_results(folder, Results(rows, settings, **about))
    write_comparison(folders, tmp_path / "out")
    text = (tmp_path / "out/compare.html").read_text()
    WellFormed(text)
    assert "<script>alert" not in text
    assert "a<b>" not in text
    assert "&lt;script&gt;" in text


# --- pictures
def picture_data(monkeypatch, **cases):
    monkeypatch.setattr(side_by_side, "load_run", lambda folder: cases[folder.name])


def test_maps_lie_side_by_side_on_one_scale(tmp_path, monkeypatch):
    good = report_data("desk")
    (case,) = good.cases
    (window,) = case.windows
    worse = tuple(replace(one, depth_m=one.depth_m * 1.5) for one in window.methods[:2])
    bad = replace(window, depth_range_m=(0.25, 2.0), methods=worse)
    picture_data(monkeypatch, a=good, b=replace(good, cases=(replace(case, windows=(bad,)),)))
    results = read_compared(two_runs(tmp_path, 1.0))
    (section,), missing = side_by_side.picture_sections(results, ["desk"])
    assert missing == []
    _, choice = section.blocks
    assert choice.names == ("Alg1/H", "Alg1/max"), "what both have, the best first"
    (window,) = choice.blocks
    seen, first, _ = window.blocks
    depths, errors = (row.pictures for row in first.blocks)
    assert [picture.title for picture in errors] == ["a", "b"]
    scales = {(picture.scale.low, picture.scale.high) for picture in depths}
    assert scales == {(1 / 4.0, 1 / 0.25)}, "the range of both"
    assert errors[0].layers != errors[1].layers
    drawn = {(picture.layers[0].about, picture.title) for picture in seen.pictures}
    assert drawn == {(kind, "all results") for kind in ("Frame", "Events", "True depth [m]")}


def test_pictures_and_tables_begin_with_the_best_of_the_first_result(tmp_path, monkeypatch):
    data, worse = report_data("desk"), {"Alg1/H": 3.0, "Alg1/max": 0.5}
    rows = data.results.rows
    chosen = rows["metric"] == "mean_error"
    rows.loc[chosen, "value"] = [worse.get(method, 1.0) for method in rows["method"][chosen]]
    picture_data(monkeypatch, a=data, b=data)
    results = read_compared(two_runs(tmp_path, 1.0))
    (section,), _ = side_by_side.picture_sections(results, ["desk"])
    assert section.blocks[-1].names[0] == "Alg1/max"


def test_pictures_are_on_the_page_or_it_says_why_not(tmp_path, monkeypatch):
    runs = two_runs(tmp_path, 1.0)
    assert text_of(compared(*runs)).count("No pictures of") == 2  # without maps
    picture_data(monkeypatch, a=report_data("desk"), b=report_data("desk"))
    more = suite_folder(tmp_path / "c", {"desk": mean_errors(spread(1))[0]})
    for folders in (runs, [*runs, more]):
        text = text_of(compared(*folders))
        WellFormed(text)
        assert len(re.findall(r'alt="[ab], Error \|e − g\| \[cm\] of Alg1/H', text)) == 2
    assert "No pictures of c: a suite keeps numbers, no depth maps." in text
