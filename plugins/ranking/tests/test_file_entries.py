"""Entries of geometries and poses: made, checked without truth, refused in one line, and scored."""

import json

import numpy as np
import pytest

import eventsweep as es
from eventsweep.eval.cli.main import main
from eventsweep.plugins.geometry.ply import write_points
from eventsweep.plugins.ranking.archives.tarball import pack
from eventsweep.plugins.ranking.entry import ENTRY, read_entry
from eventsweep.plugins.ranking.sources import read_source
from eventsweep.plugins.ranking.submission import MANIFEST, PACKAGE, read_manifest
from refusals import command_refused
from small_suite import case, suite_text

pytestmark = pytest.mark.usefixtures("blank_figures")

CASES, SECONDS = ("wall", "late"), 0.04
SUFFIX = {"geometry": ".ply", "odometry": ".txt"}
FACTS = """
track = "{track}"
method = "Mine/fast"
authors = ["A. Author"]
licence = "CC-BY-4.0"

[cost]
seconds_per_sequence = 12
peak_memory_mb = 120
hardware = "a laptop"
"""


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    """The suite's sequences, as `archive unpack` lays them out."""
    out = tmp_path_factory.mktemp("recordings")
    config = es.SimConfig(duration_s=SECONDS, truth_times_s=(0.01, 0.03))
    for number, name in enumerate(CASES):
        es.simulate("planes", out / name / "seed0", config, seed=number)
    return out


def found(recordings, name, track, path):
    """What a method would find: true poses, pushed a little; points on the true surfaces."""
    sequence = es.open_recording(recordings / name / "seed0")
    if track == "geometry":
        camera, t_us = sequence.rig.cameras[0].undistorted(), int(sequence.truth_times_us(0)[0])
        depth_m = sequence.truth_view_depth_m(0, t_us)
        rays = np.concatenate([camera.bearing_table(), np.ones((*depth_m.shape, 1))], -1)
        known = np.isfinite(depth_m)
        T_world_cam = sequence.trajectory.at(t_us) @ sequence.rig.T_body_cam[0]
        points = (rays * depth_m[..., None])[known][::7] @ T_world_cam[:3, :3].T
        axes = (points + T_world_cam[:3, 3]).T
        write_points(path, dict(zip("xyz", map(np.ascontiguousarray, axes), strict=True)))
        return
    poses = sequence.trajectory
    off = 1e-3 * np.sin(np.arange(len(poses)))[:, None]
    columns = [poses.t_us[:, None] / 1e6, poses.positions_m + off, poses.quats_xyzw]
    np.savetxt(path, np.concatenate(columns, axis=1))


@pytest.fixture(params=SUFFIX)
def track(request):
    return request.param


@pytest.fixture
def place(tmp_path, recordings, track):
    (tmp_path / "pair.toml").write_text(suite_text(*map(case, CASES)))
    theirs = tmp_path / "theirs"
    for name in CASES:
        (theirs / name).mkdir(parents=True)
        found(recordings, name, track, theirs / name / f"seed0{SUFFIX[track]}")
    (theirs / "submission.toml").write_text(FACTS.format(track=track))
    return tmp_path


def words(place, verb, path, *more):
    given = ("submission", verb, path, "--suite", place / "pair.toml", *more)
    return [str(word) for word in given]


def entering(place):
    return words(place, "enter", place / "theirs", "--out", place / "submissions" / "mine")


def scoring(place, path, recordings):
    return words(place, "score", path, "--recordings", recordings, "--out", place / "scored")


def test_an_entry_is_made_checked_scored_and_ranked(place, track, recordings, capsys):
    assert main(entering(place)) == 0
    said = capsys.readouterr().out
    assert f"Mine/fast by A. Author, CC-BY-4.0: 2 files of the track {track} for pair are" in said
    assert "12 s per sequence" in said
    entry = place / "submissions" / "mine"
    assert read_entry(entry).suite == "pair"
    assert main(words(place, "check", entry)) == main(words(place, "check", place / "theirs")) == 0
    assert main(scoring(place, entry, recordings)) == 0
    (of_entry,) = read_source(f"theirs={place / 'scored'}").entries
    assert (of_entry.track, set(of_entry.cases), of_entry.seeds) == (track, {*CASES}, (0,))
    assert list(of_entry.values) == ["Mine_fast"]
    assert main([*scoring(place, place / "theirs", recordings), "--force"]) == 0
    (of_folder,) = read_source(f"theirs={place / 'scored'}").entries
    assert of_folder.values == of_entry.values


def test_scores_are_those_of_the_scoring_command(place, track, recordings):
    assert main(entering(place)) == 0
    assert main(scoring(place, place / "submissions" / "mine", recordings)) == 0
    file = place / "theirs" / "wall" / f"seed0{SUFFIX[track]}"
    own = place / "own" / "wall" / "seed0"
    given = "score", f"Mine_fast={file}", "--truth", recordings / "wall" / "seed0"
    assert main([*map(str, given), "--case", "wall", "--out", str(own), "--quiet"]) == 0
    rows = [json.loads((at / "results.json").read_text())["rows"]
            for at in (own, place / "scored" / "wall" / "seed0")]  # fmt: skip
    assert rows[0] == rows[1]
    assert rows[0]


def wall(track):
    return f"wall/seed0{SUFFIX[track]}"


WRONG = {
    "a sequence without a file": (lambda f, t: (f / wall(t)).unlink(), "the first is wall/seed0"),
    "a case that is not asked for": (
        lambda f, t: (f / "late").rename(f / "early"), "is no file of the track",
    ),
    "a damaged file": (lambda f, t: (f / wall(t)).write_text("ply, or not"), "wall/seed0"),
    "an empty file": (lambda f, t: (f / wall(t)).write_text(""), "wall/seed0"),
    "a linked file": (
        lambda f, t: ((f / wall(t)).rename(f.parent / "x"), (f / wall(t)).symlink_to("../../x")),
        "is a link",
    ),
    "another track": (
        lambda f, t: (f / "submission.toml").write_text(FACTS.format(track="chess")),
        "of depth maps, leave track out",
    ),
    "costs of depth maps": (
        lambda f, t: (f / "submission.toml").write_text(
            FACTS.format(track=t).replace("_sequence", "_window")
        ),
        "cost.seconds_per_sequence",
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_wrong_with_a_folder_is_one_line(place, track, capsys, kind):
    spoil, said = WRONG[kind]
    spoil(place / "theirs", track)
    for command in (entering(place), words(place, "check", place / "theirs")):
        assert said in command_refused(capsys, *command)
    assert not (place / "submissions" / "mine").exists()


def test_two_files_of_a_sequence_are_refused(place, track, capsys):
    if track == "geometry":
        (place / "theirs" / "wall" / "seed0.pcd").write_bytes(b"x")
        assert "leave one file for each" in command_refused(capsys, *entering(place))


def test_a_spoilt_package_is_refused_where_it_lies(place, track, capsys):
    """Packed anew with a file that nothing can read, as whoever wants to break the check would."""
    assert main(words(place, "make", place / "theirs", "--out", place / "mine.tar.zst")) == 0
    inside, manifest = place / "inside", read_manifest(place / "mine.tar.zst")
    for name in manifest.files:
        (inside / name).parent.mkdir(parents=True)
        (inside / name).write_text("nothing")
    files = {name: one.model_copy(update=_hash(inside / name)) for name, one in
             manifest.files.items()}  # fmt: skip
    text = manifest.model_copy(update={"files": files}).model_dump_json()
    (inside / MANIFEST).write_text(text)
    pack(place / "mine.tar.zst", inside, [MANIFEST, *files])
    said = command_refused(capsys, *words(place, "check", place / "mine.tar.zst"))
    assert "mine.tar.zst: " in said
    assert "/seed0" in said
    assert "/tmp" not in said.replace(str(place), "")


def _hash(path):
    from eventsweep.emvs.utils.output_manifest import hashed

    return hashed(path)._asdict()


def test_files_are_no_predictions_and_truth_must_be_there(place, track, capsys):
    assert main(entering(place)) == 0
    entry = place / "submissions" / "mine"
    assert (entry / ENTRY).is_file()
    assert (entry / PACKAGE).is_file()
    given = "suite", place / "pair.toml", "--out", place / "out", "--prediction", entry
    said = command_refused(capsys, *map(str, given))
    assert "score it with `submission score`" in said
    said = command_refused(capsys, *scoring(place, entry, place / "nowhere"))
    assert "needs CASE/seedN of every sequence" in said
    assert not (place / "scored").exists()
