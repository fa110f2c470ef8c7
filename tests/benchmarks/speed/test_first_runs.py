"""What is measured of first runs is what the page says, and all that its processes take."""

import pytest

import first_runs
from eventsweep.emvs.errors import InputError
from table_code import ROOT


def test_the_recipe_is_the_page_s():
    lines = first_runs.recipe((ROOT / "docs/gate.md").read_text("utf-8")).splitlines()
    assert lines[0].startswith("eventsweep simulate")
    assert lines[-1].startswith("eventsweep gate")
    assert "--update" not in lines[-1]
    with pytest.raises(InputError, match="restore"):
        first_runs.recipe("## Gate your mapper in CI\n\n## Verdicts\n")


def test_processes_of_processes_count(tmp_path):
    busy = "import time\nwhile time.process_time() < 0.5: pass"
    assert first_runs.spent_s(f"sh -c 'python -c \"{busy}\"; true'", tmp_path) >= 0.5


def test_a_command_that_fails_is_no_measurement(tmp_path):
    with pytest.raises(InputError, match="exit code 2"):
        first_runs.spent_s("exit 2", tmp_path)


def test_a_warm_run_has_textures_and_no_results(tmp_path):
    for name in ("textures", "3f"):
        (tmp_path / "cache" / name).mkdir(parents=True)
    first_runs.forget_results(tmp_path)
    assert [entry.name for entry in (tmp_path / "cache").iterdir()] == ["textures"]
