"""A suite's sequences, frozen: packed, used instead of simulating, and never mixed with others."""

import json
import os
import shutil
import subprocess
import sys

import numpy as np
import pytest

from blank_pictures import blank_pictures
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.eval.cli.main import main
from eventsweep.eval.perturbations import Perturbation, perturbed
from eventsweep.eval.report.compare.differences import compare_results
from eventsweep.eval.report.compare.results import read_compared
from eventsweep.eval.results.results import read_results
from eventsweep.eval.results.series import measured_of
from eventsweep.eval.results.table import each
from eventsweep.eval.suite.definition import read as read_definition
from eventsweep.plugins.ranking.archive import SequenceArchive, hidden_seed, read_secret
from eventsweep.plugins.ranking.archives.fetch import verify
from eventsweep.plugins.ranking.archives.manifest import read
from places import HELPERS, ROOT
from refusals import command_refused, line_of
from small_suite import WHOLE, case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

SUITE = suite_text(
    case("wall", WHOLE),
    case("crooked", WHOLE, imperfection={"focal_percent": 3, "pose_walk_mm": 9}),
    seeds=[0, 1],
    more='[subsets.quick]\ncases = ["wall"]\nseeds = [0]\n',
)
NUMBERS = ("--workers", "1", "--no-speed", "--quiet")


@pytest.fixture(scope="module", autouse=True)
def blank():
    with blank_pictures():
        yield


@pytest.fixture(scope="module")
def made(tmp_path_factory, jobs_in_this_process):
    """The suite's file, its cache, its archive, and its result without one."""
    folder = tmp_path_factory.mktemp("archive")
    file, cache = folder / "pair.toml", folder / "cache"
    file.write_text(SUITE)
    arguments = ["--cache", str(cache), "--workers", "1", "--quiet"]
    assert main(["archive", "make", str(file), "--out", str(folder / "frozen"), *arguments]) == 0
    assert run(file, cache, folder / "drawn") == 0
    return file, cache, folder / "frozen", folder / "drawn"


def suite_of(file, cache, out, *more):
    return ["suite", file, "--out", out, "--cache", cache, *NUMBERS, *more]


def run(*places):
    return main([*map(str, suite_of(*places))])


def values(folder):
    return {
        (row.case, row.seed, row.window, row.method, row.metric): row.value
        for row in each(read_results(folder).rows)
    }


def same(first, second):
    assert first.keys() == second.keys()
    np.testing.assert_array_equal([*first.values()], [*second.values()])


# Arguments are those of `eventsweep`.
WITHOUT_PICTURES = """
import sys
from blank_pictures import blank_pictures
from eventsweep.eval.cli.main import main
if __name__ == "__main__":
    with blank_pictures():
        sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.slow
def test_mapping_an_archive_needs_no_graphics_and_gives_the_same_numbers(made, tmp_path):
    """An empty cache, in a process in which nothing could be drawn."""
    file, _, frozen, drawn = made
    arguments = ["--archive", str(frozen), "--out", str(tmp_path / "out"), *NUMBERS]
    arguments += ["--seeds", "0", "--case", "wall"]
    environment = {
        **os.environ, "MUJOCO_GL": "none at all", "EVENTSWEEP_CACHE": str(tmp_path / "c"),
    }  # fmt: skip
    environment["PYTHONPATH"] = os.pathsep.join([str(ROOT), str(HELPERS)])
    (tmp_path / "program.py").write_text(WITHOUT_PICTURES)
    program = [sys.executable, str(tmp_path / "program.py"), "suite", str(file), *arguments]
    subprocess.run(program, env=environment, check=True)
    first = {key: value for key, value in values(drawn).items() if key[:2] == ("wall", 0)}
    assert first
    same(values(tmp_path / "out"), first)
    result = read_results(tmp_path / "out")
    assert {job.name.split("/")[0] for job in result.jobs} == {"unpack", "map", "score"}
    assert result.archive.version == read(frozen).version
    assert read_results(drawn).archive is None
    assert [one.scene for one in result.samples] == [
        one.scene for one in read_results(drawn).samples if (one.case, one.seed) == ("wall", 0)
    ]


@pytest.mark.slow
def test_an_archive_made_again_is_the_same_bytes_and_its_maps_are_those_of_drawn_ones(
    made, tmp_path
):
    file, cache, frozen, drawn = made
    assert run(file, cache, tmp_path / "out", "--archive", frozen) == 0
    again = [job.name for job in read_results(tmp_path / "out").jobs if not job.found]
    assert {name.split("/")[0] for name in again} == {"unpack"}
    same(values(tmp_path / "out"), values(drawn))
    assert len(list((tmp_path / "out" / "pictures").glob("*.png"))) == 2
    file, _, frozen, _ = made
    arguments = ["--cache", str(tmp_path / "c"), "--workers", "1", "--quiet", "--case", "wall"]
    assert main(["archive", "make", str(file), "--out", str(tmp_path / "a"), *arguments]) == 0
    for path in (tmp_path / "a").glob("*.tar.zst"):
        assert path.read_bytes() == (frozen / path.name).read_bytes()


def test_what_an_archive_and_its_list_say_of_it(made, capsys, tmp_path):
    file, _, frozen, _ = made
    capsys.readouterr()
    assert main(["archive", "verify", str(frozen), "--json"]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["sequences"] == ["wall/seed0", "wall/seed1", "crooked/seed0", "crooked/seed1"]
    assert facts["bytes"] == sum(path.stat().st_size for path in frozen.glob("*.tar.zst"))
    assert facts["licence"] == "CC-BY-4.0"
    manifest = read(frozen)
    assert manifest.subsets == {"quick": (("wall",), (0,))}
    assert manifest.renderer
    assert manifest.digest == read_definition(file).digest
    capsys.readouterr()
    words = ["--list-cases", "--json", "--archive", str(made[2]), "--cache", str(made[1])]
    assert main(["suite", str(made[0]), *words]) == 0
    listed = json.loads(capsys.readouterr().out)["sequences"]
    assert {one["case"]: one["imperfection"] for one in listed} == {
        "wall": None,
        "crooked": {"focal_percent": 3, "pose_walk_mm": 9},
    }
    _, _, frozen, _ = made
    archive = SequenceArchive(frozen)
    assert archive.seeds(["wall"], [0, 1, 2, 3]) == (0, 1)
    assert archive.seeds(["wall"], [1]) == (1,)


@pytest.mark.slow
def test_a_sequence_drawn_anew_is_not_comparable(made, tmp_path):
    """Of other bytes: here another seed's sequence in its place, as another library would draw."""
    file, cache, frozen, drawn = made
    other = shutil.copytree(frozen, tmp_path / "other")
    content = json.loads((other / "archive.json").read_text())
    by_place = {(one["case"], one["seed"]): one for one in content["sequences"]}
    for name in ("file", "sha256", "bytes", "sequence", "files"):
        pair = by_place["wall", 0], by_place["wall", 1]
        pair[0][name], pair[1][name] = pair[1][name], pair[0][name]
    (other / "archive.json").write_text(json.dumps(content))
    for out, archive in (("a", frozen), ("b", other)):
        assert run(file, cache, tmp_path / out, "--archive", archive, "--case", "wall") == 0
    verdicts = {}
    for name, pair in {"drawn": (drawn, tmp_path / "b"), "two": (tmp_path / "a", tmp_path / "b"),
                       "equal": (drawn, tmp_path / "a")}.items():  # fmt: skip
        (found,) = compare_results(read_compared(pair))
        verdicts[name] = {one.verdict for one in found.cases}
        whys = {one.why for one in found.cases}
        assert any("other sequences: " in why for why in whys) == (name != "equal")
    assert verdicts["drawn"] == verdicts["two"] == {"not comparable"}
    assert "not comparable" not in verdicts["equal"]
    identities = [
        {
            one.identity
            for one in measured_of(read_results(folder)).series.values()
            if one.case == "wall"
        }
        for folder in (drawn, tmp_path / "a", tmp_path / "b")
    ]
    assert not identities[0] & identities[1]
    assert not identities[1] & identities[2]


def test_what_a_method_may_read_is_told_as_the_mapper_is(made, tmp_path):
    """Whole where a case is exact; of an imperfect one the geometry is wrong, and no truth."""
    _, _, frozen, _ = made
    out = tmp_path / "recordings"
    assert main(["archive", "unpack", str(frozen), "--out", str(out), "--quiet"]) == 0
    exact = Sequence.open(out / "wall/seed1")
    exact.verify()
    assert len(exact.truth_times_us(0))
    crooked = open_recording(out / "crooked/seed1")
    amount = Perturbation(focal_percent=3, pose_walk_mm=9)
    told = perturbed(exact, amount, 1)  # the same scene and seed as the other case
    assert crooked.rig.cameras[0].fx_px == pytest.approx(1.03 * exact.rig.cameras[0].fx_px)
    assert crooked.rig.to_json() == told.rig.to_json()
    at_us = np.arange(0, 40_000, 5000)
    np.testing.assert_allclose(crooked.trajectory.at(at_us), told.trajectory.at(at_us), atol=1e-9)
    assert np.abs(crooked.trajectory.at(at_us) - exact.trajectory.at(at_us)).max() > 1e-4
    for camera in (0, 1):
        mine, theirs = (one.events(camera, 0, 50_000) for one in (crooked, exact))
        for name in ("x", "y", "t_us", "p"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
    assert not len(crooked.truth_times_us(0))


# The hidden part
@pytest.fixture(scope="module")
def hidden(made, tmp_path_factory):
    """The archive of whoever ranks, and what is published of it."""
    folder = tmp_path_factory.mktemp("hidden")
    (folder / "secret").write_bytes(b"a secret of more than 16 bytes")
    arguments = ["--cache", str(made[1]), "--workers", "1", "--quiet", "--seeds", "0-1"]
    for name, more in (("own", []), ("given", ["--no-truth"])):
        where = ["--out", str(folder / name), "--secret", str(folder / "secret")]
        assert main(["archive", "make", str(made[0]), *where, *arguments, *more]) == 0
    return folder


@pytest.mark.slow
def test_hidden_motions_are_others_and_nobody_can_tell_which(made, hidden):
    _, _, frozen, _ = made
    own, given = read(hidden / "own"), read(hidden / "given")
    assert {one.sequence for one in own.sequences}.isdisjoint(
        one.sequence for one in read(frozen).sequences
    )
    secret = (hidden / "secret").read_bytes()
    seeds = [hidden_seed(secret, "pair", case, k) for case in ("wall", "crooked") for k in (0, 1)]
    assert len(set(seeds)) == 4
    assert all(seed < 1 << 63 for seed in seeds)
    assert hidden_seed(b"another secret", "pair", "wall", 0) not in seeds
    assert own.secret_sha256 == given.secret_sha256 != ""
    published = (hidden / "given" / "archive.json").read_text()
    assert secret.decode() not in published
    assert not any(str(seed) in published for seed in seeds)


@pytest.mark.slow
def test_what_is_published_of_it_holds_no_truth_and_no_seed(hidden, tmp_path):
    out = tmp_path / "recordings"
    assert main(["archive", "unpack", str(hidden / "given"), "--out", str(out), "--quiet"]) == 0
    assert main(["archive", "unpack", str(hidden / "own"), "--out", str(tmp_path / "own"),
                 "--quiet"]) == 0  # fmt: skip
    for number in (0, 1):
        sequence = Sequence.open(out / "wall" / f"seed{number}")
        assert not len(sequence.truth_times_us(0))
        assert (sequence.manifest.seed, sequence.manifest.configuration) == (number, {})
        theirs = Sequence.open(tmp_path / "own" / "wall" / f"seed{number}")
        mine, exact = sequence.events(0, 0, 50_000), theirs.events(0, 0, 50_000)
        np.testing.assert_array_equal(mine.t_us, exact.t_us)
        np.testing.assert_array_equal(mine.x, exact.x)
        crooked = open_recording(out / "crooked" / f"seed{number}")
        told = open_recording(tmp_path / "own" / "crooked" / f"seed{number}")
        assert crooked.rig.to_json() == told.rig.to_json()
        np.testing.assert_allclose(
            crooked.trajectory.positions_m, told.trajectory.positions_m, atol=1e-9
        )


@pytest.mark.slow
def test_only_who_has_the_truth_can_score(made, hidden, tmp_path, capsys):
    file, cache, _, _ = made
    assert run(file, cache, tmp_path / "out", "--archive", hidden / "own") == 0
    result = read_results(tmp_path / "out")
    assert (result.archive.part, result.seeds, len(result.samples)) == ("hidden", (0, 1), 4)
    secret = (hidden / "secret").read_bytes()
    text = (tmp_path / "out" / "suite.json").read_text()
    assert not any(str(hidden_seed(secret, "pair", "wall", k)) in text for k in (0, 1))
    asked = suite_of(file, cache, tmp_path / "no", "--archive", hidden / "given")
    assert "contains no ground truth" in command_refused(capsys, *asked)


@pytest.mark.parametrize(("content", "words"), [
    (None, "cannot be read"), (b"short", "too few for a secret"), (b" " * 99, "0 bytes"),
])  # fmt: skip
def test_a_secret_that_is_none_is_one_line(tmp_path, content, words):
    if content is not None:
        (tmp_path / "secret").write_bytes(content)
    assert words in line_of(read_secret, tmp_path / "secret")


# What goes wrong
def test_what_an_archive_lacks_is_one_line(made, tmp_path, capsys):
    file, cache, frozen, _ = made
    part = shutil.copytree(frozen, tmp_path / "part")
    (part / "wall-seed1.tar.zst").unlink()
    other = tmp_path / "other.toml"
    other.write_text(SUITE.replace("contrast_threshold_pos = 0.4", "contrast_threshold_pos = 0.3"))
    for definition, archive, more, words in (
        (file, part, ("--case", "wall"), "wall-seed1.tar.zst: is missing: fetch wall"),
        (file, frozen, ("--seeds", "7"), "no sequence of wall with seed 7"),
        (other, frozen, (), "a different definition"),
        (file, tmp_path, (), "no archive.json"),
    ):
        asked = suite_of(definition, cache, tmp_path / "out", "--archive", archive, *more)
        assert words in command_refused(capsys, *asked)
        assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_suite_of_other_methods_can_use_the_same_archive(made, tmp_path):
    _, cache, frozen, _ = made
    more = tmp_path / "more.toml"
    more.write_text(SUITE.replace('"EMVS/cam0"]', '"EMVS/cam0", "Alg1/G"]'))
    assert run(more, cache, tmp_path / "out", "--archive", frozen, "--case", "wall") == 0
    methods = set(read_results(tmp_path / "out").rows["method"])
    assert "Alg1/G" in methods


def test_a_damaged_file_of_an_archive_fails_one_case(made, tmp_path):
    file, _, frozen, _ = made
    spoilt = shutil.copytree(frozen, tmp_path / "spoilt")
    path = spoilt / "wall-seed0.tar.zst"
    path.write_bytes(path.read_bytes()[:-100])
    assert run(file, tmp_path / "c", tmp_path / "out", "--archive", spoilt, "--seeds", "0") == 1
    result = read_results(tmp_path / "out")
    assert [sample.case for sample in result.samples] == ["crooked"]
    assert "damaged archive" in result.failures[0].failure
    line_of(verify, spoilt)
