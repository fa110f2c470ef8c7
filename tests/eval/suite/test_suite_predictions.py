"""Depth maps of others join a whole suite: listed, checked, hashed, scored, ranked and shown."""

import json
import shutil

import numpy as np
import pytest

from blank_pictures import blank_pictures
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.eval.cli.main import main
from eventsweep.eval.results.results import read_results
from eventsweep.eval.results.table import each
from eventsweep.eval.scoring.pairing import OF_ALL_METHODS
from eventsweep.eval.stages import predict as predict_stage
from refusals import command_refused, line_of
from small_suite import case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

MAPPERS = {
    "default": {"methods": ["Alg1/H", "EMVS/cam0"], "planes": 30},
    "coarse": {"methods": ["Alg1/H"], "planes": 10, "reference": "end"},
}
SUITE = suite_text(
    case("wall", mappers=["default", "coarse"]),
    case("late", [(0.01, 0.02)], mappers=["coarse"]),
    mappers=MAPPERS,
)


@pytest.fixture(scope="module")
def suite(tmp_path_factory, jobs_in_this_process):
    """A suite that ran once without predictions: its file, the cache, what must be predicted."""
    folder = tmp_path_factory.mktemp("suite")
    (folder / "pair.toml").write_text(SUITE)
    cache = folder / "cache"
    with blank_pictures():
        assert run(folder, cache, folder / "out") == 0
    return folder / "pair.toml", cache, read_results(folder / "out")


def asked(folder, cache, out, *more):
    where = ["suite", folder / "pair.toml", "--out", out, "--cache", cache]
    return [*where, "--workers", "1", "--no-speed", "--quiet", *more]


def run(*places):
    return main([*map(str, asked(*places))])


def listed(file, cache, capsys):
    capsys.readouterr()
    assert main(["suite", str(file), "--list-cases", "--json", "--cache", str(cache)]) == 0
    return json.loads(capsys.readouterr().out)


def predict(content, folder, spoil=lambda depth_m: depth_m):
    """Writes what an outsider would, from the list alone: here the truth, a little off."""
    for one in content["sequences"]:
        sequence = Sequence.open(one["sequence"])
        for window in one["windows"]:
            path = folder / window["file"]
            path.parent.mkdir(parents=True, exist_ok=True)
            depth_m = sequence.truth_view_depth_m(0, window["t_ref_us"]) * 1.01
            np.savez(path, depth_m=spoil(np.where(np.isfinite(depth_m), depth_m, np.nan)))
    return folder


@pytest.fixture
def theirs(suite, tmp_path, capsys):
    return predict(listed(suite[0], suite[1], capsys), tmp_path / "theirs")


def test_the_list_is_that_of_the_maps_and_needs_nothing_simulated(suite, tmp_path, capsys):
    file, cache, result = suite
    content = listed(file, cache, capsys)
    assert content["digest"] == result.digest
    for one in content["sequences"]:
        camera = Sequence.open(one["sequence"]).rig.cameras[0].undistorted()
        assert one["camera"] == camera.to_json()
        times_us = [window["t_ref_us"] for window in one["windows"]]
        assert set(times_us) <= set(Sequence.open(one["sequence"]).truth_times_us(0).tolist())
        assert [window["file"] for window in one["windows"]] == [
            f"{one['case']}/seed{one['seed']}/{t_us}.npz" for t_us in times_us
        ]
    files = {window["file"] for one in content["sequences"] for window in one["windows"]}
    assert files == {"wall/seed0/10000.npz", "wall/seed0/30000.npz", "late/seed0/30000.npz"}
    nothing = listed(file, tmp_path / "absent", capsys)
    assert not (tmp_path / "absent").exists()
    assert {one["sequence"] for one in nothing["sequences"]} == {None}
    for one in (content, nothing):
        for sequence in one["sequences"]:
            del sequence["sequence"]
    assert nothing == content
    assert main(["suite", str(suite[0]), "--list-cases", "--cache", str(suite[1])]) == 0
    out = capsys.readouterr().out
    assert out.count("/seedN/") == 3
    assert "3 depth maps" in out
    assert "2 of 2 sequences are simulated" in out


@pytest.mark.slow
def test_a_prediction_is_scored_ranked_and_shown(suite, theirs, tmp_path):
    """As good as it was made: one hundredth off everywhere; built-in numbers stay the same."""
    file, cache, before = suite
    out = tmp_path / "out"
    assert run(file.parent, cache, out, "--prediction", f"mine={theirs}") == 0
    result = read_results(out)
    assert result.samples == before.samples
    own, alone = (
        rows[(rows["method"] != "Given/mine") & ~rows["region"].isin(OF_ALL_METHODS)]
        for rows in (result.rows, before.rows)
    )
    assert own.reset_index(drop=True).equals(alone.reset_index(drop=True))
    for sample in result.samples:
        rows = result.rows[result.rows["case"] == sample.case]
        mine = list(each(rows[(rows["seed"] == sample.seed) & (rows["method"] == "Given/mine")]))
        relative = {row.window: row.value for row in mine if row.metric == "abs_rel"}
        assert relative == pytest.approx(dict.fromkeys(relative, 1.0), abs=1e-3)
        assert {"shared_mean_error", "harmonic_mean_error"} <= {row.metric for row in mine}
        assert not any(row.metric.startswith("equal_") for row in mine)  # without confidence
    assert set(result.predictions) == {"Given/mine"}
    lines = (out / "suite.csv").read_text().splitlines()
    assert any(line.startswith("wall,0,all,Given/mine,mean_error,") for line in lines)
    assert sorted(path.name for path in (out / "pictures").glob("*.png")) == [
        "late.png", "wall.png",
    ]  # fmt: skip
    assert main(["report", str(out), "--quiet"]) == 0
    page = (out / "report.html").read_text()
    assert page.count("data:image/png;base64,") == 2
    assert result.predictions["Given/mine"] in page
    best = page.index("Given/mine")  # the first line of the table over all cases
    assert best < page.index("Alg1/H")


@blank_pictures()
def test_all_methods_of_a_window_are_compared_on_the_same_pixels(suite, tmp_path, capsys):
    """A prediction of the right half of the image, surest where it is nearest."""
    file, cache, before = suite
    theirs = predict(listed(file, cache, capsys), tmp_path / "theirs", right_half)
    for path in theirs.rglob("*.npz"):
        depth_m = np.load(path)["depth_m"]
        np.savez(path, depth_m=depth_m, confidence=np.nan_to_num(1 / depth_m))
    assert run(file.parent, cache, tmp_path / "out", "--prediction", f"mine={theirs}") == 0
    rows = read_results(tmp_path / "out").rows
    for name, group in rows[rows["region"].isin(OF_ALL_METHODS)].groupby(["case", "window"]):
        points = group[group["metric"].isin(("common_points", "equal_points"))]
        first = points[~points["method"].str.endswith(" coarse") | (name[0] == "late")]
        assert set(first["method"]) >= {"Given/mine"}
        assert len(first) == 2 * first["method"].nunique()
        if name[1] != "mean":
            assert (first.groupby("metric")["value"].nunique() == 1).all()
    of_wall = (rows["case"] == "wall") & (rows["window"] == "all")
    common = rows[of_wall & (rows["metric"] == "common_points")].set_index("method")["value"]
    alone = before.rows[(before.rows["case"] == "wall") & (before.rows["window"] == "all")]
    alone = alone[alone["metric"] == "common_points"].set_index("method")["value"]
    assert 0 < common["Alg1/H"] < alone["Alg1/H"]
    assert common["Alg1/H coarse"] == alone["Alg1/H coarse"]


def right_half(depth_m):
    depth_m[:, :120] = np.nan
    return depth_m


@pytest.mark.slow
@blank_pictures()
def test_several_predictions_resume_and_only_what_changed_is_scored_again(suite, theirs, tmp_path):
    file, cache, _ = suite
    other = shutil.copytree(theirs, tmp_path / "other")
    given = ("--prediction", f"a={theirs}", "--prediction", other)
    assert run(file.parent, cache, tmp_path / "one", *given) == 0
    found = {job.name: job.found for job in read_results(tmp_path / "one").jobs}
    assert {name for name, done in found.items() if not done} == {
        f"{job}/seed0{name}" for case in ("wall", "late")
        for job, name in ((f"predict/{case}", "/Given/a"), (f"predict/{case}", "/Given/other"),
                          (f"beside/{case}", ""))
    }  # fmt: skip
    moved = shutil.move(other, tmp_path / "elsewhere")
    np.savez(theirs / "late" / "seed0" / "30000.npz", depth_m=np.full((180, 240), 2.0))
    given = ("--prediction", f"a={theirs}", "--prediction", f"other={moved}")
    assert run(file.parent, cache, tmp_path / "two", *given) == 0
    again = {job.name for job in read_results(tmp_path / "two").jobs if not job.found}
    assert again == {"predict/late/seed0/Given/a", "beside/late/seed0"}
    one, two = (read_results(tmp_path / name).predictions for name in ("one", "two"))
    assert one["Given/other"] == two["Given/other"]
    assert one["Given/a"] != two["Given/a"]


def lone(text):
    return lambda folder: (folder / "prediction.toml").write_text(text)


def put(depth_m, name="wall/seed0/10000.npz"):
    return lambda folder: np.savez(folder / name, depth_m=depth_m)


def spotted(value):
    depth_m = np.full((180, 240), 2.0)
    depth_m[3, 4:7] = value
    return depth_m


FIRST = "wall/seed0/10000.npz"
WRONG = {
    "missing case": (lambda folder: shutil.rmtree(folder / "late"), "late with seed 0"),
    "missing seed": (lambda folder: (folder / "late/seed0").rename(folder / "late/seed1"), "late"),
    "missing window": (lambda folder: (folder / "wall/seed0/30000.npz").unlink(), "30000 µs"),
    "unknown case": (lambda folder: (folder / "hall").mkdir(), "no case 'hall'"),
    "no seed": (lambda folder: (folder / "wall" / "first").mkdir(), "such as seed0"),
    "size": (put(np.ones((180, 241))), "180 rows and 241 columns"),
    "all NaN": (put(np.full((180, 240), np.nan)), "finite and positive"),
    "negative": (put(spotted(-1.0)), "3 of 43200 numbers are negative"),
    "millimetres": (put(np.full((180, 240), 2000.0)), "set scale"),
    "time": (lambda folder: (folder / FIRST).rename(folder / "wall/seed0/9999.npz"), "-1 µs away"),
    "damaged": (lambda folder: (folder / FIRST).write_bytes(b"PK"), "cannot be read"),
    "description": (lone("unit = 1"), "it may hold name"),
    "twice": (lambda folder: shutil.copy(folder / FIRST, folder / "wall/seed0/10000_b.npz"),
     "both for 10000"),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_a_wrong_prediction_is_one_line_before_anything_is_computed(
    suite, theirs, tmp_path, capsys, kind
):
    """With an empty cache, where the first job would be a simulation."""
    spoil, words = WRONG[kind]
    spoil(theirs)
    out, cache = tmp_path / "out", tmp_path / "cache"
    given = ("--prediction", f"mine={theirs}")
    assert words in command_refused(capsys, *asked(suite[0].parent, cache, out, *given))
    assert not out.exists()
    assert not list(cache.rglob("entry.json"))


@pytest.mark.parametrize(("given", "words"), [
    (["nowhere"], "nowhere: no such folder"), (["=theirs"], "needs NAME=DIR"),
    (["a=theirs", "a=theirs"], "two predictions are called Given/a"),
])  # fmt: skip
def test_what_is_asked_for_wrongly_is_one_line(
    suite, theirs, tmp_path, monkeypatch, capsys, given, words
):
    monkeypatch.chdir(tmp_path)
    more = [word for one in given for word in ("--prediction", one)]
    command = asked(suite[0].parent, suite[1], tmp_path / "out", *more)
    assert words in command_refused(capsys, *command)


@pytest.mark.parametrize(("flags", "words"), [
    ([], "add --list-cases"), (["--list-cases", "--out", "o"], "it only lists"),
])  # fmt: skip
def test_a_suite_needs_a_folder_unless_it_is_only_listed(suite, capsys, flags, words):
    assert words in command_refused(capsys, "suite", suite[0], *flags)


def test_a_file_that_changes_while_the_suite_runs_is_not_scored(theirs):
    """The job was planned with another file: its key would say what it is not."""
    files = {"10000": [FIRST, "0" * 64]}
    parameters = {"name": "Given/a", "description": {}, "files": files}
    said = line_of(predict_stage.opened, parameters, theirs)
    assert "was changed while the suite ran" in said
