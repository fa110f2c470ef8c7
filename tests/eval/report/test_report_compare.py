"""Results side by side: differences where they mean something, and only there."""

from __future__ import annotations

import csv
import re
from dataclasses import replace

import pytest

from emvs.errors import InputError
from eval.cli.main import main
from eval.report.compare_page import compare_runs, comparison_page, read_runs, write_comparison
from eval.scoring.results import write_results
from eval.suite.series import Key
from report_data import WellFormed, report_data

KEY = Key("desk", "Alg1/H", "mean_error")


def _changed(results, factor):
    rows = tuple(
        replace(row, value=row.value * factor) if row.metric == "mean_error" else row
        for row in results.rows
    )
    return replace(results, rows=rows)


@pytest.fixture
def results():
    return report_data("desk").results


def _folders(tmp_path, *found):
    folders = [tmp_path / f"run{k}" for k in range(len(found))]
    for folder, one in zip(folders, found, strict=True):
        folder.mkdir()
        write_results(folder, one)
    return folders


def _verdict(folders, key=KEY):
    return compare_runs(read_runs(folders)).verdicts[0][key]


def test_a_result_beside_itself_is_the_same(tmp_path, results):
    found = compare_runs(read_runs(_folders(tmp_path, results, results)))
    assert {one.status for one in found.verdicts[0].values()} == {"same"}


@pytest.mark.parametrize(("factor", "status"), [(2.0, "worse"), (0.5, "better")])
def test_a_change_has_a_direction_and_a_size(tmp_path, results, factor, status):
    verdict = _verdict(_folders(tmp_path, results, _changed(results, factor)))
    assert verdict.status == status
    assert verdict.change == pytest.approx((factor - 1) * verdict.baseline)


def test_another_sequence_is_not_comparable(tmp_path, results):
    other = replace(results, sequences={"desk": "cd" * 32})
    assert _verdict(_folders(tmp_path, results, other)).status == "not comparable"


def test_what_is_missing_on_another_sequence_is_not_gone(tmp_path, results):
    fewer = replace(results, rows=tuple(r for r in results.rows if r.metric != "rmse"))
    key = KEY._replace(metric="rmse")
    assert _verdict(_folders(tmp_path, results, fewer), key).status == "gone"
    other = replace(fewer, sequences={"desk": "cd" * 32})
    (tmp_path / "other").mkdir()
    found = _folders(tmp_path / "other", results, other)
    assert {one.status for one in compare_runs(read_runs(found)).verdicts[0].values()} == {
        "not comparable"
    }
    assert _verdict(found, key).why.startswith("other sequences")


def test_another_version_is_not_comparable_and_says_which(tmp_path, results):
    other = replace(results, versions={**results.versions, "eventsweep": "9.9"})
    verdict = _verdict(_folders(tmp_path, results, other))
    assert verdict.status == "not comparable"
    assert "9.9" in verdict.why


def test_what_is_not_comparable_shows_no_difference(tmp_path, results):
    other = replace(_changed(results, 2.0), sequences={"desk": "cd" * 32})
    page = comparison_page(compare_runs(read_runs(_folders(tmp_path, results, other))))
    desk = next(section for section in page.sections if section.title == "desk")
    for line in desk.tables[desk.names.index("mean error")].lines:
        assert [cell.text for cell in line[3:]] == ["–", "–", "not comparable"]


def test_the_page_is_whole_and_loads_nothing(tmp_path, results):
    folders = _folders(tmp_path, results, _changed(results, 2.0), _changed(results, 0.9))
    text = write_comparison(folders, tmp_path / "out").read_text()
    page = WellFormed(text)
    assert all(source.startswith(("data:", "#")) for source in page.sources)
    assert not re.search(r"https?://", text)
    assert len(page.ids) == len(set(page.ids))
    assert "run1 against run0" in text


def test_names_from_files_are_escaped(tmp_path, results):
    hostile = "<script>alert(1)</script>"
    rows = tuple(replace(row, case=hostile, method=hostile) for row in results.rows[:3])
    rows = tuple(replace(row, metric=f"{row.metric}") for row in rows)
    other = replace(results, rows=results.rows + rows, versions={hostile: hostile})
    folders = _folders(tmp_path, results, other)
    named = folders[1].rename(tmp_path / "a<b>&'c")
    text = write_comparison([folders[0], named], tmp_path / "out").read_text()
    WellFormed(text)
    assert "<script>alert" not in text
    assert "a<b>" not in text
    assert "&lt;script&gt;" in text


def test_tables_hold_the_same_numbers(tmp_path, results):
    folders = _folders(tmp_path, results, _changed(results, 2.0))
    write_comparison(folders, tmp_path / "out")
    assert all(path.name.isascii() for path in (tmp_path / "out/tables").iterdir())
    lines = list(csv.reader((tmp_path / "out/tables/desk-mean_error.csv").open()))
    assert lines[0] == ["method", "run0 [cm]", "run1 [cm]", "Δ [cm]", "Δ [%]", "verdict"]
    for _, first, second, change, share, verdict in lines[1:]:
        assert float(second) == pytest.approx(2 * float(first))
        assert float(change) == pytest.approx(float(first))
        assert float(share) == pytest.approx(100)
        assert verdict == "worse"


def test_two_folders_of_one_name_are_told_apart(tmp_path, results):
    for parent in ("a", "b"):
        (tmp_path / parent / "run").mkdir(parents=True)
        write_results(tmp_path / parent / "run", results)
    names = [run.name for run in read_runs([tmp_path / "a/run", tmp_path / "b/run"])]
    assert names == ["1: a/run", "2: b/run"]


def test_one_result_is_refused(tmp_path, results):
    with pytest.raises(InputError, match="1 result given, needs two"):
        read_runs(_folders(tmp_path, results))


def test_a_missing_result_leaves_nothing_behind(tmp_path, results, capsys):
    folders = _folders(tmp_path, results)
    out = tmp_path / "out"
    assert main(["compare", str(folders[0]), str(tmp_path / "none"), "--out", str(out)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not out.exists()
