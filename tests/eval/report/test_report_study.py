"""The page of studies: every number of their files, and no trust in them."""

import base64
import json

import pytest

from eventsweep.eval.cli.main import main
from eventsweep.eval.figures.colormaps import INK
from eventsweep.eval.report.study_page import as_page, write_study_report
from eventsweep.eval.studies.stored import find_studies, read_study
from refusals import command_refused, line_of
from report_data import WellFormed


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
    assert "±" not in text.replace("± is half of", "")


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
