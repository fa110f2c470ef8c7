"""The page of studies: every number of their files, and no trust in them."""

import base64
import json
import math
import re
from dataclasses import asdict, replace

import numpy as np
import pytest

from eventsweep.eval.cli.main import main
from eventsweep.eval.figures.colormaps import INK
from eventsweep.eval.report.study_page import _growth, _lead, as_page, write_study_report
from eventsweep.eval.results.results import Results
from eventsweep.eval.results.table import tidy
from eventsweep.eval.studies.curves import draw
from eventsweep.eval.studies.definitions import study_named
from eventsweep.eval.studies.run import StudyFacts, StudyResult
from eventsweep.eval.studies.stored import find_studies, read_study
from refusals import command_refused, line_of
from report_data import WellFormed
from score_rows import score_row


def _study(**changes):
    curve = {"method": "Alg1/H", "unit": "m", "samples": [2, 2]}
    numbers = {"mean": [0.1, None], "low": [0.08, None], "high": [0.12, None]}
    return {
        "study": "pose-noise", "axis": "white noise of every pose", "unit": "mm",
        "cases": ["desk"], "seeds": [0, 1], "amounts": [0, 5], "changes": {},
        "breaks_at": {"Alg1/H": 5.0, "EMVS/cam0": None},
        "curves": [
            {**curve, "metric": "mean_error", **numbers},
            {**curve, "metric": "mean_error", **numbers, "method": "EMVS/cam0", "mean": [1, 1.5]},
        ],
        "failures": {"map/desk/5": "it died"}, "versions": {"eventsweep": "0.1.0"}, **changes,
    }  # fmt: skip


def _write(folder, name="pose-noise", **changes):
    path = folder / f"{name}.json"
    path.write_text(json.dumps(_study(**changes)))
    return path


def _page(folder, **changes):
    _write(folder, **changes)
    return write_study_report(folder).read_text()


def test_numbers_bands_and_breaking_points_are_there(tmp_path):
    text = _page(tmp_path)
    WellFormed(text)
    assert [words for words in ("10.00 ± 2.00", ">never<", "it died") if words not in text] == []
    assert "http" not in text
    curve = {**_study()["curves"][0], "low": [None, None], "high": [None, None]}
    text = _page(tmp_path, seeds=[0], curves=[curve])  # one seed shows no band
    assert "10.00" in text
    assert "±" not in text.replace("and ± in the tables", "")


def _stored(values, amounts=(100.0, 10.0, 1.0)):
    """A study of one method and two cases; values by (case, seed), one per amount."""
    about = StudyFacts("event-share", "share", "%", amounts, ("a", "b"), ("Alg1/H",))
    rows = [
        score_row(f"{case}.{a:g}", "all", "Alg1/H", "mean_error", value, "m", "lower", seed=seed)
        for (case, seed), of_case in values.items()
        for a, value in zip(amounts, of_case, strict=True)
    ]  # fmt: skip
    results = Results(tidy(rows), {"study": asdict(about)}, suite="event-share", seeds=(0, 1))
    return StudyResult.of(results)


def test_growth_is_the_median_of_each_sample_over_its_own_first_value():
    values = {("a", 0): (1, 2, 4), ("a", 1): (2, 2, math.nan), ("b", 0): (10, 50, 20),
              ("b", 1): (10, 30, 20)}  # fmt: skip
    (line,) = _growth(_stored(values)).lines
    assert [cell.text for cell in line[1:]] == [
        "1.00 (1.00–1.00)", "2.50 (1.00–5.00)", "2.00 (2.00–4.00)"
    ]  # fmt: skip
    lost = _growth(_stored({(case, 0): (math.nan, 1, 2) for case in "ab"}))
    assert lost is None or [cell.text for cell in lost.lines[0][1:]] == ["–"] * 3


def test_the_first_line_says_where_methods_break_the_first_to_break_first(tmp_path):
    study = _stored({(case, seed): (1, 3, 4) for case in "ab" for seed in (0, 1)})
    assert (
        _lead(study)
        == "event-share: the mean error reaches 2 times the unperturbed one at 55 % (Alg1/H)."
    )
    text = _page(tmp_path)
    said = "2 times the unperturbed one at 5 mm (Alg1/H), at no amount tried (EMVS/cam0)."
    assert re.search(rf'<p class="lead">pose-noise: .*{re.escape(said)}</p>', text)
    two = _stored({(case, seed): (1, 1, 1) for case in "ab" for seed in (0, 1)})
    assert _lead(two).endswith("2 times the unperturbed one at no amount tried (Alg1/H).")


def test_a_figure_says_what_its_bands_are_and_names_its_axes(tmp_path):
    study = study_named("event-share")
    values = {(case, seed): (1, 3 + seed, 4) for case in "ab" for seed in (0, 1)}
    found = [replace(c, amounts=study.amounts[:3]) for c in _stored(values).curves]
    study = replace(study, amounts=study.amounts[:3])
    draw(study, found, tmp_path / "a.svg", "a")
    text = (tmp_path / "a.svg").read_text()
    labels = "mean error [cm]", "bad pixels [", "95 % interval of the", f"[{study.unit}]"
    assert [label for label in labels if label not in text] == []
    alone = [replace(c, low=np.full(3, math.nan), high=np.full(3, math.nan)) for c in found]
    draw(study, alone, tmp_path / "b.svg", "a")
    assert "interval" not in (tmp_path / "b.svg").read_text()


def test_a_figure_is_an_image_in_the_pages_ink_in_which_nothing_runs(tmp_path):
    ground = '<g id="patch_1"><path style="fill: #ffffff"/></g>'
    shown = as_page(f'<?xml?><svg width="3">{ground}<text fill="{INK}"/></svg>')
    assert INK not in shown
    assert 'fill="currentColor"' in shown
    assert shown.index("prefers-color-scheme: dark") < shown.index("<g id")
    assert as_page("<svg><text/></svg>") == "<svg><text/></svg>"
    drawing = b"<svg xmlns='http://www.w3.org/2000/svg'><script>alert(1)</script></svg>"
    (tmp_path / "pose-noise.svg").write_bytes(drawing)
    text = _page(tmp_path)
    assert "alert(1)" not in text
    assert base64.b64encode(drawing).decode() in text


def test_names_are_escaped(tmp_path):
    hostile = "<img src=x onerror=alert(1)>"
    names = dict.fromkeys(("study", "axis", "unit"), hostile)
    both = {hostile: hostile}
    names |= {"cases": [hostile], "breaks_at": {hostile: None}, "failures": both, "versions": both}
    text = _page(tmp_path, **names)
    assert "<img src=x" not in text
    assert "&lt;img src=x" in text


def test_only_studies_are_found(tmp_path):
    (tmp_path / "results.json").write_text("{}")
    (tmp_path / "broken.json").write_text("{")
    (tmp_path / "list.json").write_text("[1]")
    path = _write(tmp_path)
    assert find_studies(tmp_path) == [path]


@pytest.mark.parametrize(("changes", "words"), [
    ({"amounts": [0, 5, 9]}, "has 2 values for 3 amounts"), ({"cases": 3}, "cases"),
    ({"curves": [{"method": "x"}]}, "curves.0.metric"),
])  # fmt: skip
def test_a_damaged_study_is_refused_in_a_line(tmp_path, changes, words):
    assert words in line_of(read_study, _write(tmp_path, **changes))


def test_the_command_finds_out_what_a_folder_holds(tmp_path, capsys):
    _write(tmp_path)
    assert main(["report", str(tmp_path)]) == 0
    page = WellFormed((tmp_path / "report.html").read_text(encoding="utf-8"))
    links = [source for source in page.sources if not source.startswith(("#", "data:"))]
    assert links == ["pose-noise.json"]  # of what a study leaves, what lies there
    assert "for runs" in command_refused(capsys, "report", tmp_path, "--tables")
