"""The page of a ranking: what stands in it, offline, and what `eventsweep ranking` refuses."""

import json
import os
import re
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.utils.output_manifest import NAME, strangers
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.eval.cli.main import main
from eventsweep.eval.report import run_page
from eventsweep.eval.report.suite_pictures import METHODS_NAME
from eventsweep.plugins.ranking.entries import (
    DATA_NAME,
    RankingData,
    read_data,
)
from eventsweep.plugins.ranking.facts import SubmissionFacts
from eventsweep.plugins.ranking.pages import page as standings
from eventsweep.plugins.ranking.pages.method_page import page_names
from eventsweep.plugins.ranking.pages.page import HTML_NAME, ranking_page, write_ranking
from eventsweep.plugins.ranking.sources import Source, read_source
from killed import killed_at_every_step
from ranking_entries import CASES, entry
from refusals import command_refused, line_of

pytestmark = pytest.mark.usefixtures("blank_figures")

ERRORS = {"Alg1/H": 0.1, "EMVS/cam0": 0.2, "Focus/H": 0.05, "Given/Guess": 0.4}
STATED = {
    "method": "Guess", "authors": ["A. Author"], "licence": "MIT", "url": None,
    "cost": {"seconds_per_window": 0.5, "peak_memory_mb": 120.0, "hardware": "a <laptop>"},
}  # fmt: skip


def stored(folder, *entries, pictures=()):
    folder.mkdir()
    (folder / DATA_NAME).write_text(RankingData(entries=entries).to_text())
    if pictures:
        (folder / "pictures").mkdir()
        index = {}
        for method in pictures:
            file = f"{method.replace('/', '_')}-best.webp"
            (folder / "pictures" / file).write_bytes(b"RIFF" + folder.name.encode())
            index[method] = {"best": {"file": file, "case": "wall", "abs_rel": 1.5, "error_cm": 8}}
        (folder / "pictures" / METHODS_NAME).write_text(json.dumps(index))
    return folder


def with_guess(label, **changed):
    found = entry(label, ERRORS, **changed)
    cost = {m: one for m, one in found.cost.items() if m != "Given/Guess"}
    stated = {"Given/Guess": SubmissionFacts(**STATED)}
    return found.model_copy(update={"stated": stated, "cost": cost})


def ranked(path, *entries):
    """The page of entries."""
    write_ranking([Source(path, entries)], path / "out")
    return text_of(path / "out")


@pytest.fixture
def written(tmp_path):
    old = stored(tmp_path / "old", entry("v1", {"Alg1/H": 0.3}, archive="01"), pictures=["Alg1/H"])
    new = stored(tmp_path / "new", with_guess("v2", archive="01"), pictures=["Alg1/H", "Focus/H"])
    hidden = entry("secret", ERRORS, seeds=2, archive="02", part="hidden")
    unseen = stored(tmp_path / "unseen", hidden, pictures=["EMVS/cam0"])
    out = tmp_path / "page"
    words = [str(one) for one in (old, new, unseen)]
    assert main(["ranking", *words, "--out", str(out), "--quiet"]) == 0
    return out


def text_of(out):
    return (out / HTML_NAME).read_text()


def cells(page, method, section):
    """The texts of a method's line in the first table below a heading."""
    below = page[page.index(section) :]
    named = re.compile(rf"</span>(?:<a [^>]*>)?{re.escape(method)}<")
    (line,) = [x for x in re.findall(r"<tr>.*?</tr>", below)[:20] if named.search(x)][:1]
    return [re.sub(r"<[^>]+>", "", one) for one in re.findall(r"<td.*?</td>", line)]


def test_one_file_holds_every_part_and_nothing_is_loaded(written):
    page = text_of(written)
    assert not re.findall(r'(?:src|href)="(?!data:|#|ranking\.json|methods/)[^"]*"', page)
    assert "@import" not in page
    assert "url(" not in page.replace("url(#", "")
    assert '<meta name="viewport"' in page
    assert sorted(path.name for path in written.iterdir()) == [
        NAME, HTML_NAME, "methods", "pictures", DATA_NAME,
    ]  # fmt: skip
    page = text_of(written)
    for title in (
        "Hidden part", "Ranks by other metrics", "Error over coverage", "Conditions", "Scenes",
        "Accuracy against cost", "Why points are wrong", "History", "Provenance",
    ):  # fmt: skip
        assert f"<h2>{title}</h2>" in page
    assert page.count("<svg") == 4
    assert 'class="sorts' in page


def test_every_method_has_a_page_that_leads_back_by_relative_links(written, tmp_path):
    page = text_of(written)
    for method in ERRORS:
        (address,) = re.findall(rf'<a href="(methods/[^"]*)">{method}</a>', page)
        own = (written / address).read_text()
        assert f"<h1>{method}</h1>" in own
        assert re.search(r'class="lead">Rank [1-4] of 4: relative error [\d.]+ %\.', own)
        assert '<a href="../index.html">Ranking</a>' in own
        assert [case for case in CASES if f">{case}</td>" not in own] == []
    own = (written / "methods" / "Given_Guess.html").read_text()
    assert "A. Author" in own
    assert "a &lt;laptop&gt;" in own
    assert len(list((written / "methods").iterdir())) == len(ERRORS) + 1  # and the manifest
    out = tmp_path / "again"
    assert main(["ranking", str(written), "--out", str(out), "--site", "..", "--quiet"]) == 0
    assert '<a href="../ranking.html#entering">How to enter</a>' in text_of(out)
    assert '<a href="../../index.html">Home</a>' in (out / "methods" / "Alg1_H.html").read_text()
    assert "How to enter" not in text_of(written)


@given(st.lists(st.text(max_size=12), unique=True, max_size=8))
def test_pages_of_methods_have_names_of_their_own(methods):
    names = page_names(["a/b", "a b", *(one for one in methods if one not in ("a/b", "a b"))])
    found = [name.lower() for name in names.values()]
    assert len(set(found)) == len(found)
    assert [name for name in found if re.search(r"[^a-z0-9._-]", name)] == []


def test_the_tables_say_who_is_ahead_at_which_cost_under_which_condition_and_since_when(written):
    page = text_of(written)
    first = [cells(page, method, "<main>") for method in ERRORS]
    assert [line[1] for line in first] == ["2", "3", "1", "4"]
    assert first[2][2] == "1.00"
    assert "Focus/H is first." in page
    page = text_of(written)
    assert cells(page, "Given/Guess", "<main>")[-3:] == ["0.5 stated", "120 stated", "by A. Author"]
    assert cells(page, "Alg1/H", "<main>")[-3:-1] == ["0.1", "200"]
    line = cells(page, "Given/Guess", 'id="cost"')
    assert line[1:6] == ["–", "–", "0.500", "120", "a &lt;laptop&gt;"]
    page = text_of(written)
    below = page[page.index('id="conditions"') :]
    heads = re.findall(r"<b>([^<]+)</b>", below)[:5]
    assert heads == ["method", "light", "motion", "occlusion", "none of these"]
    assert "light: dark; motion: crowd; occlusion: crowd; none of these: wall." in below
    assert cells(page, "Focus/H", 'id="conditions"')[1:] == ["1.00"] * 4
    page = text_of(written)
    line = cells(page, "Alg1/H", 'id="history"')
    assert len(line) == 3
    assert float(line[1]) > float(line[2])


def test_of_a_hidden_part_no_seed_and_no_picture_is_shown(written):
    page = text_of(written)
    assert "ab" * 32 in page
    assert page.count("data:image/webp") == 1  # the best on top; methods' pages have theirs
    assert "EMVS_cam0-best.webp" not in {path.name for path in (written / "pictures").iterdir()}
    seeds = page[page.index(">seeds</td>") :]
    assert re.findall(r"<td[^>]*>([^<]*)</td>", seeds)[:3] == [
        "0, 1, 2, 3, 4", "0, 1, 2, 3, 4", "2 seeds",
    ]  # fmt: skip


def test_poses_from_events_have_a_table_with_directions_and_rank_no_method(tmp_path):
    own = {"ate_share": ("%", "lower"), "time_covered": ("%", "higher")}
    units = entry("x", ERRORS).units | own
    poses = {"track": {"ate_share": {"wall": (0.25,) * 5}, "time_covered": {"wall": (98.5,) * 5}}}
    source = stored(tmp_path / "new", entry("v1", ERRORS, poses=poses, units=units))
    out = tmp_path / "page"
    write_ranking([read_source(str(source))], out)
    page = text_of(out)
    heads, line = re.findall(r"<tr>.*?</tr>", page[page.index("<h2>Poses from events") :])[:2]
    assert re.findall(r"ATE of path.*?([↓↑]).*time covered.*?([↓↑])", heads) == [("↓", "↑")]
    assert re.sub(r"<[^>]+>", " ", line).split() == ["wall", "0.25", "98.50"]
    assert sorted(path.stem for path in (out / "methods").glob("*.html")) == sorted(
        method.replace("/", "_") for method in ERRORS
    )


def test_a_ranking_goes_on_from_its_own_data(written, tmp_path):
    newer = stored(tmp_path / "newer", entry("v3", {"Alg2/HcAt": 0.01}, archive="01"))
    again = tmp_path / "again"
    assert main(["ranking", str(written), str(newer), "--out", str(again), "--quiet"]) == 0
    assert [one.label for one in read_data(again).entries] == ["v1", "v2", "secret", "v3"]
    page = text_of(again)
    assert cells(page, "Alg2/HcAt", "<main>")[1] == "1"
    kept = {path.name for path in (again / "pictures").iterdir()}  # beside the data
    assert kept >= {"Alg1_H-best.webp", "Focus_H-best.webp"}
    assert main(["ranking", str(written), str(newer), "--out", str(again), "--quiet"]) == 0


@pytest.mark.parametrize("error_cm", [None, 10**999], ids=["missing", "too large"])
def test_damaged_pictures_are_left_out(tmp_path, error_cm):
    folder = stored(tmp_path / "in", entry("v1", ERRORS), pictures=["Alg1/H", "Focus/H"])
    index = json.loads((folder / "pictures" / METHODS_NAME).read_text())
    index["Alg1/H"]["best"]["error_cm"] = error_cm
    if error_cm is None:
        del index["Alg1/H"]["best"]["error_cm"]  # as an older version wrote it
    (folder / "pictures" / METHODS_NAME).write_text(json.dumps(index))
    assert main(["ranking", str(folder), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert "data:image/webp" not in text_of(tmp_path / "out")


@pytest.mark.parametrize("kind", ["pipe", "file", "folder", "name"])
def test_no_file_outside_of_a_result_reaches_the_page(tmp_path, kind):
    folder = stored(tmp_path / "in", entry("v1", ERRORS), pictures=["Alg1/H"])
    (tmp_path / "secret").write_bytes(b"RIFF: of the reader")
    picture = folder / "pictures" / "Alg1_H-best.webp"
    if kind == "folder":
        (folder / "pictures").rename(tmp_path / "elsewhere")
        (folder / "pictures").symlink_to(tmp_path / "elsewhere")
    else:
        picture.unlink()
        if kind == "pipe":
            os.mkfifo(picture)
        elif kind == "file":
            picture.symlink_to(tmp_path / "secret")
        else:
            index = (folder / "pictures" / METHODS_NAME).read_text()
            renamed = index.replace("Alg1_H-best.webp", "../../secret")
            (folder / "pictures" / METHODS_NAME).write_text(renamed)
    assert main(["ranking", str(folder), "--out", str(tmp_path / "out"), "--quiet"]) == 0
    assert "data:image/webp" not in text_of(tmp_path / "out")


def test_data_that_is_linked_from_outside_is_refused(tmp_path, capsys):
    folder = stored(tmp_path / "in", entry("v1", ERRORS))
    (folder / DATA_NAME).rename(tmp_path / "kept.json")
    (folder / DATA_NAME).symlink_to(tmp_path / "kept.json")
    said = command_refused(capsys, "ranking", folder, "--out", tmp_path / "out")
    assert "ranking.json: is a link" in said


def test_a_perfect_score_and_other_sequences_are_said(tmp_path):
    flagged = entry("v1", ERRORS, perfect={"Focus/H": ["wall seed 0", "wall seed 1"]})
    page = ranked(tmp_path, entry("v0", {"Alg1/G": 0.1}, drawn="elsewhere"), flagged)
    assert cells(page, "Focus/H", "<main>")[-1] == "perfect in 2 sequences: copied truth?"
    assert "v0: not comparable, other sequences: drawn anew against drawn anew." in page
    assert "Alg1/G" not in page


def test_one_seed_ranks_nobody(tmp_path):
    page = ranked(tmp_path, entry("v1", ERRORS, seeds=1))
    assert "One seed says nothing about others" in page
    assert {cells(page, method, "<main>")[1] for method in ERRORS} == {"1"}


def test_names_from_files_cannot_write_into_the_page(tmp_path):
    evil = "<script>alert(1)</script>"
    stated = {**STATED, "authors": [evil]}
    one = entry("v1", {evil: 0.1, "a": 0.2}, stated={evil: stated}, failures={evil: evil})
    page = write_ranking([Source(tmp_path, (one,))], tmp_path / "out")
    assert evil not in text_of(tmp_path / "out")
    assert ranking_page(page).title == "Ranking, tiny"


@pytest.mark.parametrize(("entries", "words"), [
    ([entry("a", ERRORS), entry("a", ERRORS)], "two results are called a"),
    ([entry("a", ERRORS, archive="1", part="hidden")], "only results of a hidden part"),
    ([entry("a", {})], "no method was run on every case"),
])  # fmt: skip
def test_what_cannot_be_ranked_is_one_line(tmp_path, entries, words):
    assert words in line_of(ranked, tmp_path, *entries)
    assert not (tmp_path / "out").exists()


def test_a_page_of_somebody_is_kept(tmp_path):
    stored(tmp_path / "in", entry("a", ERRORS))
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / HTML_NAME).write_text("mine")
    words = ["ranking", str(tmp_path / "in"), "--out", str(tmp_path / "out"), "--quiet"]
    assert main(words) == 0
    assert (tmp_path / "out" / f"{HTML_NAME}.kept-1").read_text() == "mine"


def test_the_summary_for_a_script(tmp_path, capsys):
    stored(tmp_path / "in", entry("a", ERRORS))
    out = str(tmp_path / "out")
    assert main(["ranking", str(tmp_path / "in"), "--out", out, "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert [one["method"] for one in facts["standings"]] == [
        "Focus/H", "Alg1/H", "EMVS/cam0", "Given/Guess",
    ]  # fmt: skip
    assert facts["not_ranked"] == facts["refused"] == {}
    assert set(CASES) == {"wall", "dark", "crowd"}


def test_methods_that_were_trained_on_our_scenes_say_so(tmp_path):
    page = ranked(tmp_path, entry("v1", {"Alg1/H": 0.2, "Learned/H": 0.1, "DERD/H": 0.15}))
    for method, trained in (("Alg1/H", False), ("Learned/H", True), ("DERD/H", True)):
        note = cells(page, method, "<main>")[-1]
        assert (note == "trained on other motions of these scenes") == trained


@pytest.mark.slow
def test_a_ranking_killed_anywhere_is_taken_up_and_leaves_nothing(tmp_path, monkeypatch):
    one, out = stored(tmp_path / "in", entry("v1", ERRORS), pictures=["Alg1/H"]), tmp_path / "out"
    sources = [Source(one, read_data(one).entries)]
    shown = standings._page_of(sources[0].entries, {})
    monkeypatch.setattr(standings, "_page_of", lambda *_: shown)
    monkeypatch.setattr(standings, "page_text", lambda _: "page")

    def call():
        write_ranking(sources, out)

    killed_at_every_step(call, lambda _: out.exists() and nothing_of_others(out))
    call()
    assert {path.name for path in out.iterdir()} == {
        HTML_NAME, DATA_NAME, "methods", "pictures", NAME,
    }  # fmt: skip
    assert {path.name for path in tmp_path.iterdir()} == {"in", "out"}


@pytest.mark.slow
def test_a_maps_page_killed_anywhere_is_taken_up_and_leaves_nothing(tmp_path, monkeypatch):
    out = tmp_path / "map"
    with atomic_dir(out) as made:
        (made / "map.json").write_text("{}")
    values = {
        "load_run": mock.Mock(cases=[mock.Mock()]), "_files": (), "page_text": "page",
        "overview_png": b"png", "ranked_methods": (), "run_page": None,
    }  # fmt: skip
    for name, value in values.items():
        monkeypatch.setattr(run_page, name, lambda *_, value=value, **__: value)
    killed_at_every_step(lambda: run_page.write_report(out), lambda _: nothing_of_others(out))
    written = {"map.json", "report.html", "overview.png", NAME}
    assert {path.name for path in out.iterdir()} == written
    assert [path.name for path in tmp_path.iterdir()] == ["map"]


def nothing_of_others(folder):
    assert strangers(folder) == []
