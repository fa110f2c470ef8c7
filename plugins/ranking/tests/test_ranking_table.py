"""The table on the page of the ranking is that of the committed data."""

import shutil
from pathlib import Path

from eventsweep.eval.suite.definition import load
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import read_data
from eventsweep.plugins.ranking.tracks import SEMI_DENSE
from places import ROOT, numbers_in, page
from ranking_table import DATA, main, ranking_block

PAGE, FOLDER = page("ranking.md"), ROOT / DATA


def test_the_page_is_not_stale_and_a_typed_number_is_noticed_and_cured(tmp_path, capsys):
    copy = Path(shutil.copy(PAGE, tmp_path / "page.md"))
    asked = [str(copy), "--data", str(FOLDER)]
    assert main([*asked, "--check"]) == 0, capsys.readouterr().err
    before, mark, after = copy.read_text().partition("<!-- ranking: begin -->")
    copy.write_text(before + mark + after.replace("| Alg1/min | ", "| Alg1/min | 1"))
    assert main([*asked, "--check"]) == 1
    assert "stale" in capsys.readouterr().err
    assert main(asked) == 0
    assert copy.read_text() == PAGE.read_text()


def test_every_method_has_its_line_in_the_order_of_the_ranks_and_the_page_is_of_the_data():
    own = [one for one in read_data(FOLDER).entries if one.track == SEMI_DENSE]
    public, hidden = summary.parts(own)
    lines = ranking_block(FOLDER).splitlines()[2:]
    wanted = [(one.method, str(one.rank)) for one in summary.ranked(public).standings]
    cells = [line.strip("| ").split(" | ") for line in lines[: len(wanted)]]
    assert [(line[0], line[1]) for line in cells] == wanted
    assert hidden is not None
    page = (FOLDER / "index.html").read_text(encoding="utf-8")
    assert all(entry.label in page for entry in own)
    assert all(method in page for method in own[0].values)


def test_the_page_counts_the_cases_and_seeds_of_its_suite():
    pattern = r"on the (\w+) cases\s+and (\w+) of the (\w+) seeds of `suite-v3`"
    suite, _ = load("suite-v3")
    drawn = read_data(FOLDER).entries[0].seeds
    assert numbers_in(PAGE, pattern) == [len(suite.cases), len(drawn), len(suite.seeds)]
