"""The README's numbers are those of the committed baseline."""

import shutil
from pathlib import Path

import pytest

from eventsweep.eval.gate.baseline import read_baseline
from markdown_blocks import with_block
from places import ROOT, needs_plugins
from readme_table import REAL, main, real_block, results_block
from refusals import line_of

README, BASELINE = ROOT / "README.md", ROOT / "reports" / "baseline.json"


@needs_plugins
@pytest.mark.parametrize(("typed", "times"), [("| Alg1/H | ", 1), ("Median errors are ", 1)])
def test_the_readme_is_not_stale_and_a_typed_number_is_noticed_and_cured(
    tmp_path, capsys, typed, times
):
    page = Path(shutil.copy(README, tmp_path / "README.md"))
    asked = [str(page), "--baseline", str(BASELINE)]
    assert main([*asked, "--check"]) == 0, capsys.readouterr().err
    page.write_text(page.read_text().replace(typed, f"{typed}1", times))
    assert main([*asked, "--check"]) == 1
    assert "stale" in capsys.readouterr().err
    assert main(asked) == 0
    assert page.read_text() == README.read_text()


def test_numbers_are_means_of_cases_and_seeds_and_of_the_real_recording():
    baseline = read_baseline(BASELINE)
    chosen = [s for s in baseline.series if (s.method, s.metric) == ("Alg1/H", "mean_error")]
    means = [sum(s.values.values()) / len(s.values) for s in chosen]
    line = next(x for x in results_block(baseline).splitlines() if x.startswith("| Alg1/H |"))
    assert f"{100 * sum(means) / len(means):.2f}" in line
    table = "\n".join(f"| `{m}` | 0.{k}1 | 1 | {k}.5 | x | y |" for k, m in enumerate(REAL))
    other = table.replace("0.", "7.")
    text = real_block(f"{other}\n<!-- real: begin -->\n{table}\n<!-- real: end -->\n{other}\n")
    assert "0.11 (Focus/H) and 0.21 (Learned/H) times that of Alg1/H" in text
    assert "0.5 % (Alg1/H), 1.5 % (Focus/H), 2.5 % (Learned/H)" in text
    assert "Alg1/H" in line_of(real_block, "nothing")


def test_only_what_stands_between_the_marks_changes():
    page = "a\n<!-- results: begin -->\nold\n<!-- results: end -->\nz\n"
    after = with_block(page, "results", "new\n")
    assert after == "a\n<!-- results: begin -->\n\nnew\n\n<!-- results: end -->\nz\n"
    assert with_block(after, "results", "new\n") == after
    assert "results: begin" in line_of(with_block, "nothing", "results", "x")
