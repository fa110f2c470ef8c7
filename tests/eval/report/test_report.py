"""The report: one file that needs nothing else, and says what the numbers say."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from blank_pictures import blank_figures
from eventsweep.emvs.data.image_stores import Photo
from eventsweep.eval.report.html import page_text
from eventsweep.eval.report.overview import overview_png
from eventsweep.eval.report.ranking import (
    findings,
    fusion_order,
    mean_over_cases,
    order,
    standings_of,
    table,
)
from eventsweep.eval.report.run_data import _range_s
from eventsweep.eval.report.run_page import lead, run_page, write_report
from eventsweep.eval.results.table import tidy, together
from refusals import line_of
from report_data import METHODS, SHAPE, WellFormed, report_data, window_data
from score_rows import score_row


@pytest.fixture(scope="module")
def one_case():
    return page_text(run_page(report_data("desk")))


def changed(data, **changes):
    """Data whose only case has other windows, made of its first one by its name or by changes."""
    (case,) = data.cases
    return replace(data, cases=(replace(case, **changes),))


def with_methods(data, *methods):
    """Data of which every window has these methods, functions of its own ones."""
    windows = data.cases[0].windows
    return changed(data, windows=tuple(replace(w, methods=methods[0](w)) for w in windows))


def words_of(data):
    """The page of data, which is well-formed, with empty plots."""
    with blank_figures():
        text = page_text(run_page(data))
    WellFormed(text)
    return text


def test_the_page_is_well_formed_and_loads_nothing(one_case):
    page = WellFormed(one_case)
    assert page.sources
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    assert not re.search(r"url\(\s*['\"]?https?:|@import|<link|<script src", one_case)
    assert page_text(run_page(report_data("desk"))) == one_case  # same data, same page


SHOWN = (
    "1,234,567", "planes = 12", "ab" * 32, "3 px·m", "test &lt;scene&gt;",
    "1 of 3 windows are shown; all are scored.",
    '<details><summary>Configuration</summary><pre>planes = 12', *(
        f'alt="{kind} of {method}' for method in METHODS
        for kind in ("Depth [m]", "Confidence [votes]", "Error |e − g| [cm]")
    ),
)  # fmt: skip


def test_numbers_units_counts_provenance_and_every_picture_are_there(one_case):
    assert [words for words in SHOWN if words not in one_case] == []
    assert "<scene>" not in one_case
    assert one_case.count("tolerated error [cm]") == 3
    assert one_case.count("even in 1/depth") == len(METHODS)


def test_the_winner_and_its_depth_come_before_all_numbers(one_case):
    page = WellFormed(one_case)
    assert page.checked == ["case0-m0"]
    assert 'for="case0-m0">Alg1/H</label>' in one_case
    places = [page.ids.index(name) for name in ("ranking", "case0", "provenance")]
    assert places == sorted(places)
    top = one_case[one_case.index("<main>") : one_case.index('id="ranking"')]
    assert re.search(
        r'class="lead">Alg1/H is best: mean error [\d.]+ cm, then \S+ with [\d.]+ cm\. One seed '
        "does not show whether that holds for others", top,
    )  # fmt: skip
    assert top.index("Depth [m], Alg1/H") < top.index("Frame, camera 0")
    assert "<button" not in top


def test_a_map_without_scores_begins_with_how_much_it_found():
    data = report_data("desk", windows=2, truth=False)
    first = data.cases[0].windows[0].methods[0]
    points = np.mean([window.methods[0].mask.sum() for window in data.cases[0].windows])
    said = re.search(r'class="lead">([^<]*)', words_of(data))[1]
    assert said.startswith(f"{first.name} found depth at {points:,.0f} px (")
    assert said.endswith("% of the image), on average over 2 windows; not scored.")
    assert f"({100 * points / first.mask.size:.1f} % of" in said


def test_what_orders_the_table_is_among_its_first_columns(one_case):
    heads = re.findall(r"<th[^>]*>(.*?)</th>", one_case, re.S)
    assert [re.sub(r"<.*?>", " ", head).split()[0] for head in heads[:3]] == [
        "method", "points", "mean",
    ]  # fmt: skip


def verdict(*values):
    """Of methods a, b, c with these values per case, one seed each."""
    rows = tidy([
        score_row(f"case{k}", "all", method, "mean_error", value, "m", "lower")
        for method, found in zip("abc", values, strict=False) for k, value in enumerate(found)
    ])  # fmt: skip
    return lead(standings_of(rows, "mean_error"), rows, "mean_error")


def test_the_verdict_of_one_seed_says_who_is_best_by_how_much_and_of_what():
    assert verdict([0.3], [0.1], [0.2]).startswith("b is best: mean error 10.00 cm, then c with 20")
    assert verdict([0.1], [0.1], [0.2]).startswith(
        "a, b are best: mean error 10.00 cm, then c with"
    )
    assert verdict([0.1], [0.1]).startswith("a, b are best: mean error 10.00 cm. One seed does not")
    assert verdict([0.3, 0.2], [0.1, 0.1]).startswith(
        "b is placed first by mean error over 2 cases"
    )
    assert verdict([0.1]) == "a: mean error 10.00 cm, from one seed."
    assert verdict([math.nan], [math.nan]).startswith("No method has a mean error")


def test_many_windows_are_a_film_of_short_times_and_all_their_lengths_are_meant():
    data, clock_us = report_data("desk", windows=3), 1_700_000_000_000_000
    film = tuple(
        replace(w, t_us=clock_us + 100_000 * k, methods=w.methods[:1])
        for k, w in enumerate(data.cases[0].windows)
    )
    page = words_of(changed(data, windows=film[:1], film=film, clock_us=clock_us))
    names = re.findall(r'data-name="([^"]*)"', page)
    assert names == ["w000, 0.000 s", "w001, 0.100 s", "w002, 0.200 s"]
    assert page.count('type="range"') == 1
    assert "1700000" not in page
    assert _range_s([300_000, 300_000]) == "0.300 s"
    assert _range_s([300_000, 100_000, 200_000]) == "0.100 to 0.300 s"


def test_causes_are_drawn_as_categories_with_their_shares():
    data, causes = report_data("desk"), np.zeros(SHAPE, np.uint8)
    causes[:3], causes[3] = 3, 8
    caused = with_methods(data, lambda w: (replace(w.methods[0], causes=causes), *w.methods[1:]))
    page = words_of(caused)
    assert page.count("Cause of the error</b>") == 1
    legend = re.search(r'class="legend">(.*?)</p>', page)[1]
    assert re.findall(r"</i>([^<]*)<", legend) == ["occlusion 75 %", "other 25 %"]
    assert "Cause of the error" not in words_of(data)


def test_colours_tell_the_depths_apart_that_occur_however_far_the_planes_reach():
    window = replace(window_data("w000", 0), depth_range_m=(0.01, 1000.0))
    near_m, far_m = window.shown_range_m
    depths_m = window.truth.depth_m[window.truth.scored]
    within = (depths_m >= near_m) & (depths_m <= far_m)
    assert 0.98 < within.mean() <= 1
    assert near_m > 0.8 * depths_m.min()
    assert far_m < 1.2 * depths_m.max()
    assert replace(window, depth_range_m=(near_m, near_m * 1.01)).shown_range_m[0] == near_m
    blind = [replace(one, mask=np.zeros_like(one.mask)) for one in window.methods]
    nothing = replace(window, truth=None, methods=tuple(blind))
    assert nothing.shown_range_m == nothing.depth_range_m
    points = replace(window, truth=None).shown_range_m
    assert 0.01 < points[0] < points[1] < 1000


def test_the_overview_draws_the_first_of_the_ranked_methods_that_has_a_map():
    case = report_data("desk").cases[0]
    unranked, best = overview_png(case), overview_png(case, ranked=("Given/none", "Alg1/max"))
    assert overview_png(case, ranked=("Alg1/H",)) == unranked
    assert best != unranked


@pytest.mark.parametrize("name", ["Given/x", "Focus/H", "EMVS/cam0"])
def test_the_page_opens_on_whoever_has_rank_1_and_never_on_a_single_camera(name):
    data = report_data("desk")
    more = lambda w: (*w.methods, replace(w.methods[0], name=name, dsi_slice=None))  # noqa: E731
    rows = data.results.rows
    fused = rows[rows["method"] == "Alg1/H"]
    best = fused.assign(method=name, value=0.5 * fused["value"])
    rows = together([rows[rows["method"] != name], best])
    page = words_of(replace(with_methods(data, more), results=replace(data.results, rows=rows)))
    shown = "Alg1/H" if name.startswith("EMVS") else name
    assert WellFormed(page).checked == ["case0-m0"]
    assert f'for="case0-m0">{shown}</label>' in page


def test_a_method_without_map_or_confidence_has_all_but_their_pictures():
    silent = {"name": "Given/x", "confidence": np.full(SHAPE, np.nan)}
    more = lambda w: (*w.methods, replace(w.methods[0], **silent))  # noqa: E731
    page = words_of(with_methods(report_data("desk"), more))
    for words in ("Depth [m] of Given/x", "Error |e − g| [cm] of Given/x"):
        assert f'alt="{words}' in page
    assert 'alt="Confidence [votes] of Given/x' not in page
    assert "Given/x does not say how sure it is" in page
    assert "Confidence [votes]</b>" in page
    data = report_data("desk")
    rows = data.results.rows
    given = rows[rows["method"] == "Alg1/H"].assign(method="Given/x")
    results = replace(data.results, rows=together([rows, given]))
    page = page_text(run_page(replace(data, results=results)))
    assert 'alt="Depth [m] of Given/x' not in page
    svg = page[page.index("tolerated error [cm]") - 40_000 :]
    assert re.search(r"<text[^>]*>Given/x</text>", svg)
    assert "case0-precision-curve-4" in svg


def test_expected_errors_are_drawn_where_a_method_states_them_with_how_many_held():
    data = report_data("desk")
    window = data.cases[0].windows[0]
    known, other, *_ = window.methods
    error_m = np.abs(known.depth_m - window.truth.depth_m)
    scored = np.flatnonzero(known.mask & window.truth.scored)
    error_m.flat[scored[: len(scored) // 4]] *= 0.5
    stated = with_methods(data, lambda w: (replace(known, error_m=error_m), *w.methods[1:]))
    page = words_of(changed(stated, window_count=1))
    share = 100 * (1 - len(scored) // 4 / len(scored))
    assert f'alt="Expected error [cm] of {known.name}"' in page
    assert f"68 % of the errors. {share:.0f} % of the errors lie within." in page
    assert f"{other.name} is not calibrated." in page
    assert "Expected error" not in words_of(data)


def test_several_cases_have_ids_of_their_own_and_a_mean_says_whose_pixels():
    page = WellFormed(text := words_of(report_data("desk", "boxes", windows=2)))
    own = [name for name in page.ids if name.startswith("case")]
    assert len(own) == len(set(own))
    assert "mean of 2 cases" in text
    assert text.count("<summary>Window ") == 4
    text = words_of(report_data("desk", "boxes"))
    ranking = text[text.index('id="ranking"') : text.index('id="case0"')]
    assert re.search(r"order, on the [\d,]+ px a case that all methods report", ranking)
    assert " px a case" not in text[text.index('id="case0"') :]


def test_a_recording_without_truth_has_no_scores_and_a_folder_without_maps_no_page(tmp_path):
    text = words_of(report_data("slider", truth=False))
    assert "Ranking" not in text
    assert "Ground truth" not in text
    assert "1 of 3 windows are shown." in text
    assert 'alt="Depth [m] of Alg1/H' in text
    assert re.search(r"Alg1/H</b> · points \d+ px", text)
    assert "no map" in line_of(write_report, tmp_path)
    assert not list(tmp_path.iterdir())


def test_an_ordinary_cameras_picture_says_what_it_lost():
    data, image = report_data("desk"), np.full(SHAPE, 100, np.uint8)
    image[:6], image[23, :1] = 255, 0
    window = replace(data.cases[0].windows[0], photo=Photo(240_000, 250_000, 1.5, image))
    text = words_of(changed(data, windows=(window,)))
    for words in ("Ordinary camera", "10 ms exposure, -5 ms"):
        assert words in text
    assert "25.0 % of the pixels white, 0.1 % black" in text
    assert "Ordinary camera" not in words_of(data)


@pytest.fixture(scope="module")
def rows():
    data = report_data("desk")
    return data.rows_of("desk", "all")


def test_the_order_is_measured_the_best_marked_and_findings_say_so(rows):
    assert fusion_order(rows, "mean_error") == ["H", "A", "max"]
    assert [name for name, _ in order(rows, "delta_1")][-1] == "Alg1/max"
    got = table(rows, "mean_error")
    for position, column in enumerate(got.columns):
        values = [line.cells[position].value for line in got.lines]
        best = max(values) if column.direction == "higher" else min(values)
        marked = [line.cells[position].value for line in got.lines if line.cells[position].kind]
        assert set(marked) == {best}, column.name
    ordered = ["Alg1/H", "Alg1/A", "EMVS/cam0", "Alg1/max"]
    assert [line.method for line in table(rows, "mean_error").lines] == ordered
    sentences = findings(rows, "mean_error")
    assert re.search(
        r"mean error \[cm\], best first: H [\d.]+, A [\d.]+, max [\d.]+\.$", sentences[0]
    )
    assert "Alg1/H beside EMVS/cam0" in sentences[-2]
    assert sentences[-1].startswith("Alg1/max, Alg1/H, Alg1/A, EMVS/cam0 bring no confidence")
    assert re.search(r"mean error [\d.]+ cm against [\d.]+ cm \(−\d+ %\)", sentences[-2])
    assert "each on its own pixels" in sentences[-2]  # these rows are of before there were pairs


def test_ties_share_a_place_undefined_ones_are_last():
    tied = tidy(score_row("c", "all", f"Alg1/{m}", "rmse", 1.0, "m", "lower") for m in ("H", "G"))
    assert fusion_order(tied, "rmse") == ["H", "G"]
    assert fusion_order(tied[tied["method"] == "Alg1/H"], "rmse") == []
    values = dict(zip("abcdef", (1.0, 2.0, 2.0, 3.0, math.nan, math.nan), strict=True))
    tabled = of_methods({**values, "EMVS/cam0": 2.0})
    ranks = {one.method: (one.rank, one.place) for one in standings_of(tabled, "mean_error")}
    places = {"a": 1, "b": 3, "EMVS/cam0": 3, "c": 3, "d": 5, "e": 6.5, "f": 6.5}
    assert ranks == {method: (1, place) for method, place in places.items()}  # one seed
    values = {"Alg1/min": math.nan, "Alg1/H": 2.0, "Alg1/A": 1.0}
    tabled = of_methods(values)
    got = table(tabled, "mean_error")
    assert [line.method for line in got.lines] == ["Alg1/A", "Alg1/H", "Alg1/min"]
    assert [line.cells[0].kind for line in got.lines] == ["best", "", ""]
    assert got.lines[2].cells[0].text == "–"


def of_methods(values):
    """Mean errors of one case by method."""
    return tidy(score_row("c", "all", m, "mean_error", v, "m", "lower") for m, v in values.items())


def numbers(**values):
    """Rows of one case by method and metric, `Alg1_H__mean_error` for `Alg1/H`."""
    for name, value in values.items():
        method, metric = name.split("__")
        unit = "px" if metric.endswith("points") else "m"
        yield score_row(
            "c", "all", method.replace("_", "/"), metric, value, unit, "lower", support=7
        )


PAIR = {
    "Alg1_H__mean_error": 0.2, "EMVS_cam0__mean_error": 0.3,
    "Alg1_H__points": 900, "EMVS_cam0__points": 800, "EMVS_cam0__shared_points": 700,
    "EMVS_cam0__shared_mean_error": 0.25, "EMVS_cam0__harmonic_mean_error": 0.1,
}  # fmt: skip


def test_sentences_compare_on_the_pixels_of_both_and_a_prediction_has_its_own():
    (sentence,) = findings(tidy(numbers(**PAIR)), "mean_error")
    assert (
        "on the 700 px that both report: mean error 10.00 cm against 25.00 cm (−60 %)" in sentence
    )
    assert "own pixels: mean error 20.00 cm against 30.00 cm (−33 %)" in sentence
    assert "points 900 px against 800 px" in sentence
    given = {
        "Given_x__mean_error": 0.4, "Given_x__points": 100, "Given_x__shared_points": 60,
        "Given_x__shared_mean_error": 0.3, "Given_x__harmonic_mean_error": 0.15,
    }  # fmt: skip
    sentences = findings(tidy(numbers(**PAIR, **given)), "mean_error")
    (told,) = [one for one in sentences if one.startswith("Given/x")]
    assert "Given/x beside Alg1/H, on the 60 px" in told
    assert "30.00 cm against 15.00 cm (+100 %)" in told
    assert "on the 700 px" in sentences[0]


WINS = {**PAIR, "EMVS_cam0__mean_error": 0.1}
MOTION = {"rig__baseline": 0.1, "rig__lateral_travel": 0.25}


def why(**values):
    found = [s for s in findings(tidy(numbers(**values)), "mean_error") if "is ahead of Alg1" in s]
    return found[0] if found else ""


NEAR, SURE = {**MOTION, "rig__lateral_travel": 0.05}, {**WINS, "EMVS_cam0__shared_mean_error": 0.05}


@pytest.mark.parametrize(("values", "words", "there"), [
    (WINS, "not ahead on the 700 px that both report", True),
    (SURE, "it is also ahead on the 700 px that both report", True),
    ({**WINS, **MOTION}, "25.00 cm sideways", True), ({**WINS, **MOTION}, "10.00 cm apart", True),
    ({**WINS, **NEAR}, "sideways", False),
    ({**WINS, "EMVS_cam1__mean_error": 0.5},
     "EMVS/cam1 alone is worse than Alg1/H (50.00 cm)", True),
    ({**WINS, "EMVS_cam1__mean_error": 0.15}, "cam1", False),
    ({name: WINS[name] for name in ("Alg1_H__mean_error", "EMVS_cam0__mean_error")},
     "these numbers do not show why.\n", True),
])  # fmt: skip
def test_why_a_single_camera_is_ahead_follows_from_the_numbers(values, words, there):
    assert (words in f"{why(**values)}\n") == there
    assert why(**PAIR) == ""


def test_fusion_functions_stand_in_one_order_on_whatever_pixels():
    values = {"Alg1_H__mean_error": 0.2, "Alg1_A__mean_error": 0.1, "Alg1_G__mean_error": 0.3,
              "Alg1_H__common_mean_error": 0.05, "Alg1_A__common_mean_error": 0.09}  # fmt: skip
    first, common = findings(tidy(numbers(**values)), "mean_error")[:2]
    assert first.endswith("best first: A 10.00, H 20.00, G 30.00.")
    assert common == "In the same order, on common pixels: A 9.00, H 5.00."


def test_a_mean_over_cases_weighs_them_counts_all_and_keeps_undefined():
    rows = tidy(
        score_row(case, "all", "Alg1/H", metric, value, unit, "none", "all", points, 1.0, 2.0)
        for case, points in (("a", 30), ("b", 10))
        for metric, value, unit in (("cause_noise", 60.0, "%"), ("mean_error", 0.1, "m"))
    )
    causes = rows[rows["metric"] == "cause_noise"]
    single = causes.assign(metric="common_points", value=causes["support"].astype(float), unit="px")
    mean = mean_over_cases(together([rows, single]), "mean")
    assert set(mean["support"]) == {40}
    assert mean[["low", "high"]].isna().all(axis=None)
    (told,) = findings(mean, "mean_error", 2)
    assert told.startswith("Why 40 px of Alg1/H in 2 cases are off by more than a tenth (mean of")
    assert told.endswith("noise 60 %.")
    (alone,) = findings(rows[rows["case"] == "b"], "mean_error")
    assert alone == "Why 10 px of Alg1/H are off by more than a tenth: noise 60 %."
    values = {
        ("a", "Alg1/H"): 1.0, ("b", "Alg1/H"): 3.0, ("a", "Alg1/A"): 1.0,
        ("b", "Alg1/A"): math.nan, ("a", "mine"): 1.0,
    }  # fmt: skip
    rows = [score_row(c, "all", m, "rmse", v, "m", "lower") for (c, m), v in values.items()]
    found = mean_over_cases(tidy(rows), "mean")
    means = dict(zip(found["method"], found["value"], strict=True))
    assert means["Alg1/H"] == 2.0
    assert math.isnan(means["Alg1/A"])
    assert math.isnan(means["mine"])
