"""Results on disk: what is written is read back, and what cannot be read is refused."""

from __future__ import annotations

import csv
import json
import math
import subprocess
import sys

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.errors import InputError
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.results import UNITS, Results, Row, read_results, write_results
from places import ROOT

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


WORDS = st.text(max_size=8)
NUMBERS = st.floats(allow_nan=False)
SCORES = st.builds(
    Row, WORDS, WORDS, WORDS, WORDS, st.floats(), st.sampled_from(UNITS),
    st.sampled_from(["lower", "higher", "none"]), WORDS,
    st.none() | st.integers(0, 2**62), st.none() | NUMBERS, st.none() | NUMBERS,
)  # fmt: skip


def told(rows):
    """Rows as text, in which NaN equals NaN."""
    return [repr(row) for row in rows]


@given(st.lists(SCORES, max_size=8))
def test_a_table_gives_back_the_rows(rows):
    frame = Results(tuple(rows)).to_dataframe()
    assert len(frame) == len(rows)
    assert told(Results.from_dataframe(frame).rows) == told(rows)
    assert [str(frame[name].dtype) for name in ("value", "points", "low", "high")] == [
        "float64", "Int64", "float64", "float64",
    ]  # fmt: skip


def test_a_table_keeps_the_order_and_takes_provenance():
    frame = RESULTS.to_dataframe()
    again = Results.from_dataframe(
        frame.iloc[::-1], configuration=CONFIGURATION, seed=7, sequences=RESULTS.sequences,
        metrics={"rmse": "12"},
    )  # fmt: skip
    assert told(again.rows) == told(ROWS[::-1])
    assert (again.configuration, again.seed, again.sequences) == (
        RESULTS.configuration, 7, RESULTS.sequences,
    )  # fmt: skip
    assert (again.metrics, again.versions) == ({"rmse": "12"}, RESULTS.versions)
    short = Results.from_dataframe(frame[["case", "window", "method", "metric", "value", "unit",
                                          "better"]])  # fmt: skip
    assert told(short.rows) == told(ROWS)


def test_what_pandas_reads_of_the_csv_is_such_a_table(tmp_path):
    rows = (*ROWS, Row("a", "all", "m", "rmse", 0.1 + 0.2, "m", "lower", "edge", 12, 0.1, 1 / 3))
    write_results(tmp_path, Results(rows))
    table = pd.read_csv(tmp_path / "results.csv")
    assert told(Results.from_dataframe(table).rows) == told(rows)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda f: f.drop(columns=["unit", "value"]), "lacks value, unit: needs each once of case"),
        (lambda f: f.assign(colour="red"), r"has \['colour'\]: needs"),
        (lambda f: f.assign(**{"two\nlines": 1}), r"has \['two\\nlines'\]: needs"),
        (lambda f: f.assign(unit=[pd.Series([1, 2])] * 3), "unit is .*, needs one of"),
        (lambda f: pd.concat([f, f["unit"]], axis=1), r"has \['unit', 'unit'\]: needs"),
        (lambda f: f.assign(unit="mm"), r"row 0 of the table: unit is 'mm', needs one of m, %"),
        (lambda f: f.assign(unit=3), "unit is 3, needs one of"),
        (lambda f: f.assign(better="up"), "better is 'up', needs one of lower, higher, none"),
        (lambda f: f.assign(case=None), "case is .*, needs a text"),
        (lambda f: f.assign(method=[["a"]] * 3), r"method is \['a'\], needs a text"),
        (lambda f: f.assign(value="1.5"), "value is '1.5', needs a number"),
        (lambda f: f.assign(value=True), "value is True, needs a number"),
        (lambda f: f.assign(points=-1), "points is -1, needs a whole number of pixels"),
        (lambda f: f.assign(points=1.5), "points is 1.5, needs a whole number"),
        (lambda f: f.assign(low=["x" * 500] * 3), "low is 'x+[.][.][.], needs a number or nothing"),
        (lambda f: f.to_dict(), "a dict: needs a DataFrame"),
    ],
)
def test_a_table_of_something_else_is_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as caught:
        Results.from_dataframe(change(RESULTS.to_dataframe()))
    assert "\n" not in str(caught.value)
    assert len(str(caught.value)) < 250


def test_every_unit_that_is_written_is_known():
    baseline = ROOT / "reports" / "baseline.json"
    series = json.loads(baseline.read_text())["series"]
    written = {metric.unit for metric in ALL_METRICS.values()} | {one["unit"] for one in series}
    assert written <= set(UNITS)


def test_pandas_is_imported_only_when_it_is_asked_for():
    code = "import sys, eventsweep.eval.scoring.results; sys.exit('pandas' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
