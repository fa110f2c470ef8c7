"""Results on disk: what is written is read back, and what cannot be read is refused."""

import csv
import json
import math
import re

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.eval.results.results import Results, Sample, read_results, write_results
from eventsweep.eval.results.table import UNITS
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from places import ROOT
from programs import python
from refusals import line_of
from score_rows import score_row, texts

ROWS = (
    score_row("desk", "w000", "Alg1/H", "mean_error", 0.0625, "m", "lower"),
    score_row("desk", "w000", "Alg1/min", "mean_error", math.nan, "m", "lower"),
    score_row("desk", "all", "Alg1/H", "points", 12345.0, "px", "higher"),
)
CONFIGURATION = {"mapper": {"planes": 100, "fusions": ["H", "A"]}, "eval": {"limit_m": None}}
RESULTS = Results(ROWS, CONFIGURATION, (Sample("desk", 7, "ab" * 32),))


def test_what_is_written_is_read_back_and_the_same_bytes_each_time(tmp_path):
    write_results(tmp_path, Results(()))
    assert read_results(tmp_path).rows.empty
    write_results(tmp_path, RESULTS)
    found = read_results(tmp_path)
    assert found.rows.equals(RESULTS.rows)
    assert (set(found.rows["seed"]), found.configuration, found.seed) == ({7}, CONFIGURATION, 7)
    assert (found.sequences, found.versions) == (RESULTS.sequences, RESULTS.versions)
    assert read_results(tmp_path / "results.json").platform == RESULTS.platform
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, RESULTS)
    for file in ("results.json", "results.csv"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()


def test_undefined_is_null_in_json_and_empty_in_csv(tmp_path):
    write_results(tmp_path, RESULTS)
    assert {path.name for path in tmp_path.iterdir()} == {"results.json", "results.csv"}
    content = json.loads((tmp_path / "results.json").read_text())
    assert content["rows"][1]["value"] is None
    with (tmp_path / "results.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert list(table[0]) == [
        "case", "seed", "window", "method", "metric", "value", "unit", "direction",
        "region", "support", "low", "high",
    ]  # fmt: skip
    assert [row["value"] for row in table] == ["0.0625", "", "12345.0"]
    # Provenance names every program that shapes the numbers.
    expected = {"eventsweep", "python", "numpy", "numba", "mujoco", "opencv-python-headless"}
    assert expected <= set(content["versions"])
    assert content["schema_version"] == 3
    assert content["platform"]


def _damage(damage):
    """A function that changes what stands in a JSON file."""

    def change(path):
        content = json.loads(path.read_text())
        damage(content)
        path.write_text(json.dumps(content))

    return change


@pytest.mark.parametrize(("damage", "message"), [
    (lambda path: path.unlink(), "no such file"),
    (lambda path: path.write_text(" \n"), "is empty"),
    (lambda path: path.write_bytes(path.read_bytes()[:-40]), "not complete JSON"),
    (lambda path: path.write_text("[]"), "schema version None"),
    (_damage(lambda content: content.update(schema_version=99)), "schema version 99"),
    (_damage(lambda content: content.update(schema_version="a\x1b]0;b\x07")), "schema version 'a"),
    (_damage(lambda content: content["rows"][0].pop("unit")), "unit is nan, needs a text"),
    (_damage(lambda content: content["rows"][0].update(direction="up")), "direction is 'up'"),
    (_damage(lambda content: content.update(surprise=1)), "surprise"),
])  # fmt: skip
def test_a_damaged_file_is_refused_in_one_line(tmp_path, damage, message):
    write_results(tmp_path, RESULTS)
    damage(tmp_path / "results.json")
    assert message in line_of(read_results, tmp_path)


WORDS = st.text(max_size=8)
NUMBERS = st.floats(allow_nan=False)
SCORES = st.builds(
    score_row, WORDS, WORDS, WORDS, WORDS, st.floats(), st.sampled_from(UNITS),
    st.sampled_from(["lower", "higher", "none"]), WORDS,
    st.none() | st.integers(0, 2**53), st.none() | NUMBERS, st.none() | NUMBERS,
)  # fmt: skip


@given(st.lists(SCORES, max_size=8))
def test_a_table_gives_back_the_rows(rows):
    frame = Results(rows).to_dataframe()
    assert len(frame) == len(rows)
    assert texts(Results.from_dataframe(frame).rows) == texts(rows)
    numbers = ("value", "support", "low", "high", "seed")
    assert [str(frame[name].dtype) for name in numbers] == [
        "float64", "Int64", "float64", "float64", "Int64",
    ]  # fmt: skip


@pytest.mark.parametrize("version", [1, 2])
def test_files_of_earlier_versions_are_read(tmp_path, version):
    """A run had one seed for all; rows of the first had none, and columns had other names."""
    write_results(tmp_path, RESULTS)
    path = tmp_path / "results.json"
    content = json.loads(path.read_text()) | {"schema_version": version}
    (sample,) = content.pop("samples")
    content |= {"seed": 7, "sequences": {"desk": sample["sequence"]}, "metrics": {"rmse": "x"}}
    for row in content["rows"] if version == 1 else ():
        del row["seed"]
        row["better"], row["points"] = row.pop("direction"), row.pop("support")
    path.write_text(json.dumps(content))
    old = read_results(tmp_path)
    assert old.rows.equals(RESULTS.rows)
    assert (old.seed, old.sequences) == (7, RESULTS.sequences)
    assert (old.metrics, old.configuration) == ({"rmse": "x"}, CONFIGURATION)


def test_a_table_keeps_the_order_and_takes_provenance():
    frame = RESULTS.to_dataframe()
    again = Results.from_dataframe(
        frame.iloc[::-1], configuration=CONFIGURATION, seed=7, sequences=RESULTS.sequences,
        metrics={"rmse": "12"},
    )  # fmt: skip
    assert texts(again.rows) == texts([row | {"seed": 7} for row in ROWS[::-1]])
    assert (again.configuration, again.seed, again.sequences) == (
        RESULTS.configuration, 7, RESULTS.sequences,
    )  # fmt: skip
    assert (again.metrics, again.versions) == ({"rmse": "12"}, RESULTS.versions)
    short = Results.from_dataframe(frame[["case", "window", "method", "metric", "value", "unit",
                                          "direction"]])  # fmt: skip
    assert texts(short.rows) == texts(ROWS)


def test_what_pandas_reads_of_the_csv_is_such_a_table(tmp_path):
    cells = ("a", "all", "m", "rmse", 0.1 + 0.2, "m", "lower", "edge", 12, 0.1, 1 / 3)
    rows = (*ROWS, score_row(*cells))
    write_results(tmp_path, Results(rows))
    table = pd.read_csv(tmp_path / "results.csv")
    assert texts(Results.from_dataframe(table).rows) == texts(rows)


@pytest.mark.parametrize(("change", "message"), [
    (lambda f: f.drop(columns=["unit", "value"]),
     "lacks value, unit: needs each of these once: case"),
    (lambda f: f.assign(colour="red"), r"has \['colour'\]: needs"),
    (lambda f: f.assign(**{"two\nlines": 1}), r"has \['two\\nlines'\]: needs"),
    (lambda f: f.assign(unit=[pd.Series([1, 2])] * 3), "unit is .*, needs a text"),
    (lambda f: pd.concat([f, f["unit"]], axis=1), r"has \['unit', 'unit'\]: needs"),
    (lambda f: f.assign(unit="mm"), r"row 0 of the table: unit is 'mm', needs one of m, %"),
    (lambda f: f.assign(unit=3), "unit is 3, needs a text"),
    (lambda f: f.assign(direction="up"), "direction is 'up', needs one of lower, higher, none"),
    (lambda f: f.assign(case=None), "case is .*, needs a text"),
    (lambda f: f.assign(method=[["a"]] * 3), r"method is \['a'\], needs a text"),
    (lambda f: f.assign(value="1.5"), "value is '1.5', needs a number"),
    (lambda f: f.assign(value=True), "value is True, needs a number"),
    (lambda f: f.assign(support=-1), "support is -1, needs a whole number of pixels"),
    (lambda f: f.assign(support=1.5), "support is 1.5, needs a whole number"),
    (lambda f: f.assign(low=["x" * 500] * 3), "low is 'x+[.][.][.], needs a number or nothing"),
    (lambda f: f.to_dict(), "a dict: needs a DataFrame"),
])  # fmt: skip
def test_a_table_of_something_else_is_refused_in_one_line(change, message):
    said = line_of(Results.from_dataframe, change(RESULTS.to_dataframe()))
    assert re.search(message, said)
    assert len(said) < 250


def test_every_unit_that_is_written_is_known():
    baseline = ROOT / "reports" / "baseline.json"
    series = json.loads(baseline.read_text())["series"]
    written = {metric.unit for metric in ALL_METRICS.values()} | {one["unit"] for one in series}
    assert written <= set(UNITS)


def test_pandas_is_imported_only_where_there_is_a_table():
    code = "import sys, eventsweep.eval.results.results; sys.exit('pandas' in sys.modules)"
    assert python("-c", code).returncode == 0
