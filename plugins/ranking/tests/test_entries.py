"""Results in small: kept, joined where their sequences are the same, refused where they are not."""

import json
import math

import pytest

from eventsweep.plugins.ranking import entries as ranking
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.sources import read_source
from ranking_entries import CASES, entry
from refusals import line_of


def test_what_is_written_is_read_undefined_numbers_too(tmp_path):
    data = ranking.RankingData(entries=(entry("one", {"a": 0.1}), entry("two", {"b": 0.2})))
    (tmp_path / ranking.DATA_NAME).write_text(data.to_text())
    assert ranking.read_data(tmp_path) == data
    assert read_source(str(tmp_path)).entries == data.entries
    assert read_source(str(tmp_path / ranking.DATA_NAME)).folder == tmp_path
    one = entry("one", {"a": 0.1}, seeds=2)
    values = {"a": {"mean_error": {"wall": (math.nan, 0.1)}}}
    one = one.model_copy(update={"values": values})
    (tmp_path / ranking.DATA_NAME).write_text(ranking.RankingData(entries=(one,)).to_text())
    (again,) = ranking.read_data(tmp_path).entries
    assert math.isnan(again.value("a", "mean_error", ranking.Unit("wall", 0)))
    assert again.value("a", "mean_error", ranking.Unit("wall", 1)) == 0.1
    assert math.isnan(again.value("a", "mean_error", ranking.Unit("hall", 0)))
    assert math.isnan(again.value("b", "mean_error", ranking.Unit("wall", 0)))


@pytest.mark.parametrize(("text", "words"), [
    ("{", "damaged"), ('{"schema_version": 9}', "schema"), ('{"schema_version": 1}', ""),
])  # fmt: skip
def test_damaged_data_is_one_line(tmp_path, text, words):
    (tmp_path / ranking.DATA_NAME).write_text(text)
    said = line_of(read_source, str(tmp_path))
    assert ranking.DATA_NAME in said
    assert words in said


def test_what_is_no_result_is_one_line(tmp_path):
    assert "not the result of a suite" in line_of(read_source, str(tmp_path))
    (tmp_path / ranking.DATA_NAME).write_text(
        ranking.RankingData(entries=(entry("one", {"a": 1.0}),)).to_text()
    )
    assert "labels of its own" in line_of(read_source, f"new={tmp_path}")


def test_the_newest_result_of_a_method_counts_and_other_sequences_do_not():
    old, new = entry("old", {"a": 0.1, "b": 0.2}), entry("new", {"a": 0.3, "c": 0.4})
    joined = ranking.join([old, new])
    assert {m: one.label for m, one in joined.owner.items()} == {"a": "new", "b": "old", "c": "new"}
    assert joined.refused == ()
    assert joined.complete() == ["a", "b", "c"]
    old = entry("old", {"a": 0.1}, drawn="elsewhere")
    new = entry("new", {"b": 0.2}, archive="0123")
    joined, told = ranking.join([old, new]), "other sequences: drawn anew against archive 0123"
    assert (list(joined.owner), joined.refused) == (["b"], (("old", f"not comparable, {told}"),))
    less = entry("less", {"c": 0.1}, seeds=2, archive="0123")
    some = ranking.join([less, new])  # the same sequences, fewer of them
    assert (some.refused, some.complete()) == ((), ["b"])
    other = entry("x", {"c": 1.0}, versions_of_metrics={"mean_error": "v2"})
    told = "not comparable, these metrics compute something else: mean_error"
    assert ranking.join([other, new]).refused[0] == ("x", told)


def test_what_another_library_rendered_from_the_same_definition_is_joined():
    """Not so what another definition or version gave, nor where nobody knows."""
    new = entry("new", {"b": 0.2}, archive="0123", source="v1")
    joined = ranking.join([entry("old", {"a": 0.1}, drawn="elsewhere", source="v1"), new])
    assert (list(joined.owner), joined.redrawn, joined.refused) == (["a", "b"], ("old",), ())
    assert joined.complete() == ["a", "b"]
    for source in ("v2", ""):
        other = ranking.join([entry("old", {"a": 0.1}, drawn="elsewhere", source=source), new])
        assert (list(other.owner), other.redrawn) == (["b"], ())
    assert (
        ranking.join([entry("old", {"a": 0.1}, source="v2"), new]).redrawn == ()
    )  # equal sequences


def test_who_lacks_a_case_is_not_ranked_and_some_cases_rank_nobody():
    one = entry("one", {"a": 0.1, "b": 0.2})
    for found in one.values["b"].values():
        del found["dark"]
    result = summary.ranked(ranking.join([one]))
    assert [s.method for s in result.standings] == ["a"]
    assert result.lacking == {"b": 1}
    one = entry("one", {"a": 0.1})
    cases = {**one.cases, "dark": one.cases["dark"].model_copy(update={"ranked": False})}
    assert ranking.join([one.model_copy(update={"cases": cases})]).cases == ("wall", "crowd")


def test_means_are_by_hand_and_error_over_coverage_beside_the_middle_method():
    joined = ranking.join([entry("one", {"a": 0.1}, spread=0.0)])
    assert summary.geometric(joined, "a", "abs_rel", tuple(CASES)) == pytest.approx(
        (0.1 * 0.2 * 0.3) ** (1 / 3), rel=1e-5
    )
    share, parts_of_it = summary.causes(joined, "a")
    assert share == pytest.approx(10)
    assert sum(parts_of_it.values()) == pytest.approx(100)
    joined = ranking.join([entry("one", {"a": 0.1, "b": 0.2, "c": 0.4}, spread=0.0)])
    curve = summary.coverage_curve(joined, "a", ["a", "b", "c"])
    assert curve[-1][1] == pytest.approx(0.5, rel=1e-4)
    assert [share for share, _ in curve[:-1]] == [1, 2, 5, 10, 20]
    middle = summary.coverage_curve(joined, "b", ["a", "b", "c"])
    assert middle[-1][1] == pytest.approx(1.0, rel=1e-4)


def test_parts_are_kept_apart_and_history_is_that_of_the_same_sequences():
    public = entry("p", {"a": 0.1}, archive="01")
    hidden = entry("h", {"a": 0.1}, archive="02", part="hidden")
    one, two = summary.parts([public, hidden])
    assert one.base is public
    assert two.base is hidden
    assert summary.parts([public])[1] is None
    old, other = entry("v1", {"a": 0.2}, spread=0.0), entry("v2", {"a": 9.0}, drawn="x")
    new = entry("v3", {"a": 0.1, "b": 0.3}, spread=0.0)
    entries = [old, other, new]
    found = summary.history(entries, ranking.join(entries))
    assert (found.labels, list(found.lines)) == (("v1", "v3"), ["a"])
    assert found.lines["a"][0] == pytest.approx(2 * found.lines["a"][1], rel=1e-4)


def test_a_mapper_that_differs_in_methods_only_leaves_its_name_out():
    mappers = {
        "default": {"methods": ["Alg1/H"], "planes": 9},
        "more": {"methods": ["SGM/ts", "Alg1/H"], "planes": 9},
        "coarse": {"methods": ["Alg1/G"], "planes": 3},
    }
    names = ("Alg1/H", "SGM/ts more", "Alg1/H more", "Alg1/G coarse", "x y")
    shown = ["Alg1/H", "SGM/ts", "Alg1/H more", "Alg1/G coarse", "x y"]
    assert [ranking.shown_name(name, mappers) for name in names] == shown


def test_an_entry_is_small():
    methods = {f"m{k}": 0.1 * (k + 1) for k in range(25)}
    text = ranking.RankingData(entries=(entry("one", methods),)).to_text()
    numbers = 25 * 3 * 5 * len(ranking.METRICS)
    assert len(text) < 12 * numbers
    assert json.loads(text)["ranked_by"] == "mean_error"
