"""Results on disk: what is written is read back, and what cannot be read is refused."""

from __future__ import annotations

import csv
import json
import math

import pytest

from emvs.errors import InputError
from eval.results import Results, Row, read_results, write_results

ROWS = (
    Row("desk", "w000", "Alg1/H", "mean_error", 0.0625, "m", "lower"),
    Row("desk", "w000", "Alg1/min", "mean_error", math.nan, "m", "lower"),
    Row("desk", "all", "Alg1/H", "points", 12345.0, "px", "higher"),
)
CONFIGURATION = {"mapper": {"planes": 100, "fusions": ["H", "A"]}, "eval": {"limit_m": None}}
RESULTS = Results(ROWS, CONFIGURATION, seed=7, sequences={"desk": "ab" * 32})


def test_what_is_written_is_read_back(tmp_path):
    write_results(tmp_path, RESULTS)
    found = read_results(tmp_path)
    assert found.rows[0] == ROWS[0]
    assert found.rows[2] == ROWS[2]
    assert math.isnan(found.rows[1].value)
    assert (found.configuration, found.seed) == (CONFIGURATION, 7)
    assert (found.sequences, found.versions) == (RESULTS.sequences, RESULTS.versions)
    assert read_results(tmp_path / "results.json").platform == RESULTS.platform


def test_undefined_is_null_in_json_and_empty_in_csv(tmp_path):
    write_results(tmp_path, RESULTS)
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["rows"][1]["value"] is None
    with (tmp_path / "results.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert list(table[0]) == [
        "case", "window", "method", "metric", "value", "unit", "better",
        "region", "points", "low", "high",
    ]  # fmt: skip
    assert [row["value"] for row in table] == ["0.0625", "", "12345.0"]


def test_provenance_names_every_program_that_shapes_the_numbers(tmp_path):
    write_results(tmp_path, RESULTS)
    content = json.loads((tmp_path / "results.json").read_text())
    expected = {"eventsweep", "python", "numpy", "numba", "mujoco", "opencv-python-headless"}
    assert expected <= set(content["versions"])
    assert content["schema_version"] == 1
    assert content["platform"]


def test_same_results_same_bytes(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, RESULTS)
    for file in ("results.json", "results.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_no_rows_are_a_readable_file_too(tmp_path):
    write_results(tmp_path, Results(()))
    assert read_results(tmp_path).rows == ()


def test_nothing_but_the_results_is_left_behind(tmp_path):
    write_results(tmp_path, RESULTS)
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "results.csv"}


def _damage(path, damage):
    if damage == "missing":
        path.unlink()
    elif damage == "truncated":
        path.write_bytes(path.read_bytes()[:-40])
    elif damage == "empty":
        path.write_text("")
    elif damage == "list":
        path.write_text("[]")
    else:
        content = json.loads(path.read_text())
        damage(content)
        path.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("missing", "no such file"),
        ("truncated", "not complete JSON"),
        ("empty", "not complete JSON"),
        ("list", "schema version None"),
        (lambda content: content.update(schema_version=99), "schema version 99"),
        (lambda content: content["rows"][0].pop("unit"), r"rows\.0"),
        (lambda content: content["rows"][0].update(better="up"), r"rows\.0\.better"),
        (lambda content: content.update(surprise=1), "surprise"),
    ],
)
def test_a_damaged_file_is_refused_in_one_line(tmp_path, damage, message):
    write_results(tmp_path, RESULTS)
    _damage(tmp_path / "results.json", damage)
    with pytest.raises(InputError, match=message) as caught:
        read_results(tmp_path)
    assert "\n" not in str(caught.value)
