"""The page holds every statement, measured; the verb writes it, also of some of the cases."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from eventsweep.eval.cli.main import main
from eventsweep.plugins.paper.page import CHAPTERS
from eventsweep.plugins.paper.statements import Verdict

PAGE = Path(__file__).parents[3] / "docs" / "paper.md"
STATEMENTS = [statement for chapter in CHAPTERS for statement in chapter.statements]


@pytest.fixture(scope="module")
def rows() -> dict[tuple[str, str], list[str]]:
    """Per place and claim, the cells of the page's row."""
    lines = (line for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| "))
    cells = ([cell.strip() for cell in line.strip("|").split("|")] for line in lines)
    return {(row[0], row[1]): row for row in cells if len(row) == 5}


@pytest.mark.parametrize("statement", STATEMENTS, ids=lambda one: one.claim[:30])
def test_every_statement_has_a_row_with_a_measured_value(statement, rows):
    _, _, published, measured, verdict = rows[statement.place, statement.claim]
    assert published == (statement.published or "–")
    assert any(sign.isdigit() for sign in measured)
    assert verdict.strip("*") in {one.value for one in Verdict if one is not Verdict.NOT_MEASURED}


def test_no_row_is_of_a_statement_that_is_gone(rows):
    known = {(one.place, one.claim) for one in STATEMENTS}
    verdicts = {f"**{one.value}**" for one in Verdict}
    assert {key for key, row in rows.items() if row[4] in verdicts} == known


@pytest.mark.slow
def test_some_cases_make_a_page_that_says_what_is_missing(tmp_path, capsys):
    out = tmp_path / "paper"
    assert main(["paper", "--out", str(out), "--case", "planes-0", "--seeds", "0", "--json"]) == 0
    verdicts = json.loads(capsys.readouterr().out)["verdicts"]
    assert verdicts == {Verdict.NOT_MEASURED.value: len(STATEMENTS)}
    text = (out / "paper.md").read_text("utf-8")
    assert "6dof was not run" in text
    assert {path.name for path in out.iterdir()} >= {"suite.json", "suite.csv", "paper.md"}


def test_a_folder_that_is_there_is_refused_before_anything_runs(tmp_path, capsys):
    (tmp_path / "paper.md").write_text("mine")
    assert main(["paper", "--out", str(tmp_path)]) == 2
    assert (tmp_path / "paper.md").read_text() == "mine"
    assert "paper.md" in capsys.readouterr().err
