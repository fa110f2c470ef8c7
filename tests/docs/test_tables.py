"""Tables that tools write are those of the code and of the committed baseline: none is typed."""

import re
import shutil

import pytest

import readme_table
import settings_table
import stale_tables
from eventsweep.emvs.config import MapperConfig
from eventsweep.eval.config import EvalConfig, TrajectoryConfig
from eventsweep.eval.gate.baseline import read_baseline
from markdown_blocks import with_block
from measured import entries
from places import ROOT, needs_plugins
from readme_table import REAL, real_block, results_block
from refusals import line_of

BASELINE = ROOT / "reports" / "baseline.json"


def readme_in(folder):
    page = shutil.copy(ROOT / "README.md", folder / "README.md")
    return page, readme_table.main, [str(page), "--baseline", str(BASELINE)]


def settings_in(folder):
    for name in {key.partition("#")[0] for key in settings_table.TABLES}:
        if settings_table.is_there(ROOT / name):
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(ROOT / name, folder / name)
    return folder / "docs" / "mapper.md", settings_table.main, [str(folder)]


@pytest.mark.parametrize(("copied", "typed"), [
    pytest.param(readme_in, "| Alg1/H | ", marks=needs_plugins),
    pytest.param(readme_in, "Median errors are ", marks=needs_plugins),
    (settings_in, "| `planes` | "),
])  # fmt: skip
def test_a_page_is_not_stale_and_a_typed_number_is_noticed_and_cured(
    tmp_path, capsys, copied, typed
):
    page, main, arguments = copied(tmp_path)
    fresh = page.read_text()
    assert main([*arguments, "--check"]) == 0, capsys.readouterr().err
    page.write_text(fresh.replace(typed, f"{typed}1", 1))
    assert main([*arguments, "--check"]) == 1
    assert f"{page.name}: its table is stale" in capsys.readouterr().err
    assert main(arguments) == 0
    assert page.read_text() == fresh


@pytest.mark.parametrize("model", [MapperConfig, EvalConfig, TrajectoryConfig])
def test_a_table_has_a_line_for_every_setting(model):
    lines = settings_table.settings_block(model).splitlines()[2:]
    assert [line.split("`")[1] for line in lines] == list(model.model_fields)
    assert all(len(re.findall(r"(?<!\\)\|", line)) == 5 for line in lines)


def test_numbers_are_means_of_cases_and_seeds_and_of_the_real_recording():
    baseline = read_baseline(BASELINE)
    found = [s for s in baseline.series if (s.method, s.metric) == ("Alg1/H", "mean_error")]
    chosen = [s for s in found if s.case != "desk-imperfect"]
    means = [sum(s.values.values()) / len(s.values) for s in chosen]
    line = next(x for x in results_block(baseline).splitlines() if x.startswith("| Alg1/H |"))
    assert f"{100 * sum(means) / len(means):.2f}" in line
    lines = results_block(baseline).splitlines()
    ranks = [int(line.split(" | ")[1]) for line in lines if re.match(r"\| \w+/", line)]
    assert ranks == sorted(ranks)
    assert {1, 2} <= set(ranks)
    table = "\n".join(f"| `{m}` | 0.{k}1 | 1 | {k}.5 | x | y |" for k, m in enumerate(REAL))
    other = table.replace("0.", "7.")
    text = real_block(f"{other}\n<!-- real: begin -->\n{table}\n<!-- real: end -->\n{other}\n")
    assert "0.11 (Focus/H) and 0.21 (Learned/H) times that of Alg1/H" in text
    assert "0.5 % (Alg1/H), 1.5 % (Focus/H), 2.5 % (Learned/H)" in text
    assert "Alg1/H" in line_of(real_block, "nothing")


def test_what_is_mapped_with_wrong_poses_is_a_column_of_its_own():
    baseline = read_baseline(BASELINE)
    about = {"case": "desk-imperfect", "identity": "other"}
    kept = [s for s in baseline.series if s.case != "desk-imperfect"]
    wrong = [s.model_copy(update=about) for s in kept if s.case == "desk" and "/H" in s.method]
    exact, both = (
        results_block(baseline.model_copy(update={"name": "suite-v5", "series": (*kept, *more)}))
        for more in ((), wrong)
    )
    mean = next(s.mean for s in wrong if (s.method, s.metric) == ("Focus/H", "mean_error"))
    lines = zip(exact.splitlines(), both.splitlines(), strict=True)
    added = {b.split(" | ")[0]: b.removeprefix(a.removesuffix("|")) for a, b in lines if "|" in a}
    assert added["| Focus/H"] == f"| **{100 * mean:.2f}** |"
    assert added["| EMVS/cam0"] == "| – |"


def test_only_what_stands_between_the_marks_changes_and_without_marks_nothing(tmp_path, capsys):
    page = "a\n<!-- results: begin -->\nold\n<!-- results: end -->\nz\n"
    after = with_block(page, "results", "new\n")
    assert after == "a\n<!-- results: begin -->\n\nnew\n\n<!-- results: end -->\nz\n"
    assert with_block(after, "results", "new\n") == after
    assert "results: begin" in line_of(with_block, "nothing", "results", "x")
    assert settings_table.main([str(tmp_path)]) == 2
    assert "no such file" in capsys.readouterr().err


@needs_plugins
def test_the_page_lists_the_tables_that_are_older_than_their_code(capsys):
    assert stale_tables.main(["--check"]) == 0, capsys.readouterr().err


@needs_plugins
def test_every_generated_block_has_its_code_and_its_line_in_the_list():
    blocks = sorted(stale_tables.blocks())
    assert blocks == sorted(stale_tables.declared())
    assert blocks == sorted(entries(ROOT))
