"""Tracks beside a suite's: scores by case and seed are read, ranked apart, and never mixed."""

import json
import re
from dataclasses import replace

import pytest

from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import Results, Sample, write_results
from eventsweep.eval.results.table import POOLED, tidy
from eventsweep.eval.scoring.method_scores import ALL_METRICS
from eventsweep.eval.scoring.metrics import GEOMETRY_METRICS
from eventsweep.eval.scoring.trajectories.metrics import TRAJECTORY_METRICS
from eventsweep.plugins.ranking import summary
from eventsweep.plugins.ranking.entries import DATA_NAME, RankingData, RankingEntry
from eventsweep.plugins.ranking.sources import Scored, read_source, track_entries
from eventsweep.plugins.ranking.tracks import OTHERS
from ranking_entries import entry
from refusals import command_refused, line_of

pytestmark = pytest.mark.usefixtures("blank_figures")
BEST, WORST = "Good", "Bad"
KNOWN = dict(ALL_METRICS) | GEOMETRY_METRICS | TRAJECTORY_METRICS


def unit_of(metric):
    known = KNOWN[metric]
    return known.unit, known.direction


def results(track, case, seed, methods=(BEST, WORST), sequence=""):
    """Scores of methods, the first the best by every metric of the track."""
    rows = [
        {"case": case, "window": POOLED, "method": method, "metric": metric, "unit": unit,
         "direction": direction, "region": "all", "support": 9,
         "value": 50.0 + (k if direction == "lower" else -k) + seed / 7}
        for k, method in enumerate(methods)
        for metric in OTHERS[track].metrics
        for unit, direction in [unit_of(metric)]
    ]  # fmt: skip
    return Results(tidy(rows), samples=(Sample(case, sequence=sequence or f"{case}{seed}"),))


def scores(folder, *tracks, seeds=3, **changed):
    """A folder of scores, and the page's data beside it."""
    for track in tracks:
        for case in ("wall", "hall"):
            for seed in range(seeds):
                place = folder / track / case / f"seed{seed}"
                place.mkdir(parents=True)
                write_results(place, results(track, case, seed, **changed))
    return [str(folder / track) for track in tracks]


def data(folder, *entries):
    folder.mkdir()
    (folder / DATA_NAME).write_text(RankingData(entries=entries).to_text())
    return str(folder)


def test_every_track_has_its_verdict_section_and_ranks(tmp_path, capsys):
    given = scores(tmp_path / "scored", *OTHERS)
    suite = data(tmp_path / "suite", entry("v1", {"Alg1/H": 0.1, "Focus/H": 0.05}))
    out = tmp_path / "page"
    assert main(["ranking", suite, *given, "--out", str(out), "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    for name, track in OTHERS.items():
        ranks = {one["method"]: one["rank"] for one in said["tracks"][name]["standings"]}
        assert ranks == {BEST: 1, WORST: 2}, name
        page = (out / "index.html").read_text()
        assert f"{track.title}: {BEST} is first." in page
        section = page[page.index(f'id="{name}"') :]
        assert section.index(BEST) < section.index(WORST) < section.index("</section>")
    assert "Semi-dense depth: Focus/H is first." in page
    again = tmp_path / "again"
    assert main(["ranking", str(out), "--out", str(again), "--quiet"]) == 0
    assert (again / DATA_NAME).read_bytes() == (out / DATA_NAME).read_bytes()


@pytest.mark.parametrize("track", OTHERS)
def test_values_stand_where_their_case_and_seed_are(tmp_path, track):
    (given,) = scores(tmp_path, track)
    (found,) = read_source(f"mine={given}").entries
    assert (found.label, found.track, found.seeds) == (f"mine, {track}", track, (0, 1, 2))
    assert found.cases["wall"].sequences == ("wall0", "wall1", "wall2")
    metric = OTHERS[track].ranked_by
    for method, worse in ((BEST, 0), (WORST, 1)):
        sign = 1 if unit_of(metric)[1] == "lower" else -1
        wanted = tuple(round(50 + sign * worse + seed / 7, 4) for seed in range(3))
        assert found.values[method][metric]["hall"] == wanted


def test_old_data_know_no_track_and_are_a_suites(tmp_path):
    old = entry("v1", {"a": 0.1}).model_dump(mode="json")
    del old["track"]
    assert RankingEntry.model_validate(old) == entry("v1", {"a": 0.1})
    old["track"] = "chess"
    (tmp_path / DATA_NAME).write_text(json.dumps({"schema_version": 1, "entries": [old]}))
    assert "chess is not known" in line_of(read_source, str(tmp_path))


def test_a_hidden_part_enters_no_public_track():
    hidden = entry("x", {"a": 0.1}, archive="02", part="hidden").archive
    seen = Scored(0, results("dense", "wall", 0))
    unseen = [Scored(0, results("dense", "wall", 0, methods=("Secret",)))]
    (public,) = track_entries([seen], "public")
    (secret,) = (one.model_copy(update={"archive": hidden}) for one in track_entries(unseen, "h"))
    found = summary.of_tracks([public, secret])
    assert [one.method for one in found["dense"].standings] == [BEST, WORST]


def test_a_method_that_lacks_a_sequence_is_not_ranked_and_other_truths_are_refused(tmp_path):
    first, second = tmp_path / "first", tmp_path / "second"
    scores(first, "geometry")
    scores(second, "geometry", seeds=1, methods=("Late",))
    found = [one for at in (second, first) for one in read_source(str(at / "geometry")).entries]
    ranked = summary.of_tracks(
        [found[0].model_copy(update={"label": "late"}), found[1]]
    )["geometry"]  # fmt: skip
    assert list(ranked.by_method) == [BEST, WORST]
    assert set(ranked.joined.lacks("Late")) == {"wall", "hall"}
    other = tmp_path / "other"
    scores(other, "geometry", sequence="elsewhere")
    (moved,) = read_source(str(other / "geometry")).entries
    (_, why), = summary.of_tracks([moved, found[1]])["geometry"].joined.refused  # fmt: skip
    assert "other sequences" in why


def test_cases_that_the_suite_does_not_rank_by_count_in_no_track():
    definition = {
        "mappers": {"default": {}, "end": {}},
        "cases": {"wall": {"mappers": ["default"]}, "odd": {"mappers": ["end"]}},
    }
    found = [
        Scored(0, replace(results("dense", case, 0, methods), definition=definition))
        for case, methods in (("odd", ("Odd end",)), ("wall", (BEST, WORST)))
    ]
    ranked = summary.of_tracks(list(track_entries(found, "v1")))["dense"]
    assert list(ranked.by_method) == [BEST, WORST]


def test_a_track_in_which_no_method_has_every_case_says_so(tmp_path, capsys):
    for case, method in (("wall", BEST), ("hall", WORST)):
        place = tmp_path / "scored" / "dense" / case / "seed0"
        place.mkdir(parents=True)
        write_results(place, results("dense", case, 0, methods=(method,)))
    suite = data(tmp_path / "suite", entry("v1", {"Alg1/H": 0.1, "Focus/H": 0.05}))
    words = ("ranking", suite, str(tmp_path / "scored" / "dense"), "--out", str(tmp_path / "page"))
    assert main([*words]) == 0
    assert "dense: no method was run on every case, so none is ranked" in capsys.readouterr().out


def test_what_enters_no_track_is_refused(tmp_path, capsys):
    place = tmp_path / "scored" / "wall" / "seed0"
    place.mkdir(parents=True)
    full = results("geometry", "wall", 0)
    few = full.rows[full.rows["metric"] == "accuracy"]
    write_results(place, Results(few, samples=full.samples))
    assert "enter no track: needs one of recall_5pct" in line_of(
        read_source, str(tmp_path / "scored")
    )
    (given,) = scores(tmp_path / "good", "geometry")
    words = ("ranking", given, "--out", str(tmp_path / "page"))
    said = command_refused(capsys, *words)
    assert re.search("only results of other tracks: give one of a suite", said)
    assert not (tmp_path / "page").exists()
