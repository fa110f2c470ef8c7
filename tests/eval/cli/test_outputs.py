"""Every verb: what it refuses it leaves as it was, and what it replaces was its own."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.emvs.utils.outputs import output_file
from eventsweep.eval.cli.main import main
from eventsweep.eval.cli.verbs.gate import GateFlags
from eventsweep.eval.scoring.results import Results, write_results
from eventsweep.sim.parallel.checkpoint import CheckpointFolder, checkpoint_path
from places import ROOT
from score_rows import score_row
from small_pair import small_sequence

pytestmark = pytest.mark.usefixtures("blank_figures")


def contents(folder):
    """Every file's bytes, and every folder."""
    return {path: path.read_bytes() if path.is_file() else "folder" for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return small_sequence(tmp_path_factory.mktemp("small") / "seq")


@pytest.fixture
def rec(made, tmp_path):
    """A sequence in a folder of its own."""
    rec = tmp_path / "rec"
    for path in made.rglob("*"):
        if path.is_file():
            (rec / path.relative_to(made)).parent.mkdir(parents=True, exist_ok=True)
            (rec / path.relative_to(made)).write_bytes(path.read_bytes())
    return rec


def refused(capsys, *arguments):
    """Runs a command that must fail: exit code 2 and one line, without a raw error number."""
    assert main([*map(str, arguments), "--quiet"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("eventsweep: ")
    assert said.count("\n") == 1
    assert "Errno" not in said
    return said


SLIDING = ("--map.window-s", "0.02", "--map.planes", "5", "--method", "Alg1/H")
VERBS = {
    "simulate": ("simulate", "planes"),
    "run": ("run", "planes"),
    "map": ("map", "../rec"),
    "sliding": ("map", "../rec", *SLIDING),
    "convert": ("convert", "../rec", "{out}", "--to", "dsec"),
    "convert a file": ("convert", "../rec", "{out}", "--to", "tum"),
}


@pytest.mark.parametrize("verb", VERBS)
def test_a_thesis_survives_every_verb(tmp_path, monkeypatch, capsys, rec, verb):
    p, here = tmp_path / "p", tmp_path / "here"
    p.mkdir()
    here.mkdir()
    (p / "thesis.tex").write_text("x")
    monkeypatch.chdir(here)
    words = [word.format(out=p) for word in VERBS[verb]]
    out = [] if verb.startswith("convert") else ["--out", p]
    before = contents(tmp_path)
    for force in ([], ["--force"]):
        said = refused(capsys, *words, *out, *force)
        assert "--force" not in said
        assert verb == "sliding" or "thesis.tex" in said or "is a folder" in said
        assert contents(tmp_path) == before


@pytest.mark.parametrize("flags", [(), SLIDING], ids=["one", "sliding"])
def test_a_recording_survives_its_map(tmp_path, capsys, rec, flags):
    parent = tmp_path / "parent"
    parent.mkdir()
    rec = rec.rename(parent / "rec")
    before = contents(tmp_path)
    assert "input itself" in refused(capsys, "map", rec, "--out", rec, "--force", *flags)
    assert "holds the input" in refused(capsys, "map", rec, "--out", parent, "--force", *flags)
    assert contents(tmp_path) == before
    Sequence.open(rec).verify()


@pytest.mark.parametrize("verb", VERBS)
def test_the_working_directory_survives_every_verb(tmp_path, monkeypatch, capsys, rec, verb):
    here = tmp_path / "here"
    here.mkdir()
    (here / "thesis.tex").write_text("x")
    monkeypatch.chdir(here)
    words = [word.format(out=".") for word in VERBS[verb]]
    out = [] if verb.startswith("convert") else ["--out", "."]
    before = contents(tmp_path)
    for force in ([], ["--force"]):
        refused(capsys, *words, *out, *force)
        assert contents(tmp_path) == before


WRONG = {
    "simulate": ("simulate", "planes", "--out", "a/b", "--trajectory", "nowhere"),
    "run": ("run", "planes", "--out", "a/b", "--sim.replay.trajectory", "nowhere"),
    "map": ("map", "rec", "--out", "a/b", "--map.duration-s", "9"),
    "sliding": ("map", "rec", "--out", "a/b", "--map.window-s", "9"),
    "fuse": ("fuse", "nowhere"),
    "score": ("score", "nowhere"),
    "report": ("report", "nowhere"),
    "convert": ("convert", "rec", "a/b", "--to", "npz", "--stream", "cam9"),
    "convert a file": ("convert", "nowhere", "a/b", "--to", "tum"),
    "suite": ("suite", "quick", "--out", "a/b", "--case", "nothing", "--cache", "cache"),
    "gate": ("gate", "--baseline", "nowhere", "--out", "a/b", "--junit", "a/c.xml"),
    "study": ("study", "pose-noise", "--out", "a/b", "--case", "nothing", "--cache", "cache"),
    "compare": ("compare", "nowhere", "nowhere2", "--out", "a/b"),
    "info": ("info", "nowhere", "--picture", "a/b.png"),
}


@pytest.mark.parametrize("verb", WRONG)
def test_what_is_refused_leaves_nothing(tmp_path, monkeypatch, capsys, rec, verb):
    monkeypatch.chdir(tmp_path)
    before = contents(tmp_path)
    refused(capsys, *WRONG[verb])
    assert contents(tmp_path) == before


def test_a_refused_map_does_not_block_the_right_one(tmp_path, capsys, rec):
    out = tmp_path / "map"
    bad = (*SLIDING, "--map.min-events", "99999999", "--no-check")
    refused(capsys, "map", rec, "--out", out, *bad)
    assert main([*map(str, ("map", rec, "--out", out, *SLIDING)), "--quiet"]) == 0
    capsys.readouterr()  # windows of 0.02 s are short, and `map` says so
    before = contents(tmp_path)
    other = (*SLIDING, "--map.median-px", "3")
    assert "--force" in refused(capsys, "map", rec, "--out", out, *other)
    assert contents(tmp_path) == before
    again = (*other, "--no-check")
    assert main([*map(str, ("map", rec, "--out", out, *again)), "--force", "--quiet"]) == 0
    assert json.loads((out / "map.json").read_text())["config"]["median_px"] == 3
    assert strangers(out) == []
    assert {path.name for path in tmp_path.iterdir()} == {"rec", "map"}
    # A file of the user's in it ends that, and the advice with it.
    (out / "w000" / "notes.txt").write_text("x")
    assert "--force" not in refused(capsys, "map", rec, "--out", out, *SLIDING)
    assert "w000/notes.txt" in refused(capsys, "map", rec, "--out", out, *SLIDING, "--force")


def test_the_old_map_stays_until_the_new_one_is_done(tmp_path, capsys, rec):
    out = tmp_path / "map"
    assert main([*map(str, ("map", rec, "--out", out, *SLIDING)), "--quiet", "--no-check"]) == 0
    before = contents(tmp_path)
    bad = (*SLIDING, "--map.min-events", "99999999", "--force", "--no-check")
    assert "none of" in refused(capsys, "map", rec, "--out", out, *bad)
    assert contents(tmp_path) == before
    (tmp_path / ".map.next").symlink_to(tmp_path / "rec")
    assert "is a link" in refused(capsys, "map", rec, "--out", out, *SLIDING, "--force")


def test_a_map_that_was_to_replace_another_and_was_killed_is_taken_up(tmp_path, rec):
    out = tmp_path / "map"
    words = [*map(str, ("map", rec, "--out", out, *SLIDING)), "--quiet", "--no-check"]
    assert main(words) == 0
    names = sorted(path.name for path in out.glob("w*"))
    expected = {path: what for path, what in contents(tmp_path).items() if path.name != ".lock"}
    following = tmp_path / ".map.next"
    shutil.copytree(out, following)
    shutil.rmtree(following / names[-1])
    left = following / f".{names[-1]}.abcdefgh.partial"
    (left / "new").mkdir(parents=True)
    (left / ".eventsweep-work").touch()
    (following / f".{names[0]}.abcdefgh.partial").mkdir()
    stamp = (following / names[0] / "window.json").stat().st_ino
    assert main([*words, "--force"]) == 0
    assert contents(tmp_path) == expected
    assert (out / names[0] / "window.json").stat().st_ino == stamp
    assert strangers(out) == []


def test_everything_that_a_map_folder_gets_is_known(tmp_path, rec):
    out = tmp_path / "map"
    flags = ("--map.save-dsi", "--map.inpaint")
    assert main([*map(str, ("map", rec, "--out", out, *SLIDING, *flags)), "--quiet"]) == 0
    for verb in (["fuse"], ["report", "--tables", "--figures", "svg"]):
        assert main([verb[0], str(out), *verb[1:], "--quiet"]) == 0
        assert strangers(out) == []


def test_own_files_in_a_folder_are_written_anew_and_others_are_not(tmp_path, capsys):
    rows = (score_row("c", "all", "Alg1/H", "mean_error", 1.0, "m", "lower"),)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, Results(rows))
    words = ("compare", tmp_path / "a", tmp_path / "b", "--out", tmp_path / "out")
    for _ in range(2):
        assert main([*map(str, words), "--quiet"]) == 0
    (tmp_path / "out" / "compare.html").write_text("mine")
    before = contents(tmp_path)
    assert "compare.html" in refused(capsys, *words)
    assert contents(tmp_path) == before


def test_the_gate_writes_over_nothing_but_its_own(tmp_path, capsys):
    baseline = Path("reports/baseline.json")
    for flag, name in (("--junit", "thesis.xml"), ("--markdown", "notes.md")):
        mine = tmp_path / name
        mine.write_text("mine")
        words = ("gate", "--baseline", baseline, "--result", baseline, flag)
        assert "exists" in refused(capsys, *words, mine)
        assert "the input itself" in refused(capsys, *words, baseline, "--force")
        assert "is a folder" in refused(capsys, *words, tmp_path, "--force")
        assert mine.read_text() == "mine"
    own = tmp_path / "own.md"
    flags = GateFlags(baseline=baseline, markdown=own)
    with output_file(own, listed=True) as path:
        path.write_text("### eventsweep gate")
    flags.check_files(force=False)
    own.write_text("### eventsweep gate: corrected")
    with pytest.raises(InputError, match="exists"):
        flags.check_files(force=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kills", [(12, "map anew", "simulate", "submission"), (5, "convert")], ids=str
)
def test_after_a_kill_the_same_call_makes_the_same_and_nothing_is_lost(kills):
    """As in `fuzz_kills`, in a process that has not yet any thread."""
    count, *names = map(str, kills)
    tool = ROOT / "tests" / "fuzz" / "fuzz_kills.py"
    done = subprocess.run(
        [sys.executable, str(tool), count, "0", *names],
        check=False, capture_output=True, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (0, f"{count} kills, 0 faults\n"), done.stderr[-999:]


# Unfinished simulations


@pytest.mark.parametrize("kind", ["link", "lock", "stranger", "file"])
def test_a_work_folder_that_is_not_ours_is_refused_and_kept(tmp_path, made, kind):
    out, mine = tmp_path / "out", tmp_path / "mine"
    mine.mkdir()
    (mine / "000000").mkdir()
    (mine / "precious").write_text("x")
    place = checkpoint_path(out)
    if kind == "link":
        place.symlink_to(mine)
    elif kind == "file":
        place.write_text("x")
    else:
        place.mkdir()
        (place / "lock").symlink_to(mine / "precious") if kind == "lock" else None
        (place / "thesis.tex").write_text("x") if kind == "stranger" else None
    before = contents(tmp_path)
    rig = Sequence.open(made).rig
    with pytest.raises(InputError, match="unfinished work") as caught:
        CheckpointFolder(out, "key", rig, resume=False, notice=print).__enter__()
    assert "\n" not in str(caught.value)
    assert contents(tmp_path) == before


# Ctrl-C before anything has begun


@pytest.mark.parametrize("kind", [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize("late_s", [0.0, 0.1, 0.25])
def test_ctrl_c_while_modules_are_imported_is_one_line(tmp_path, kind, late_s):
    process = subprocess.Popen(
        [sys.executable, "-c", STARTED, str(tmp_path / "out")],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert process.stdout.readline() == "up\n"
    time.sleep(late_s)
    process.send_signal(kind)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130, err
    assert err.startswith("eventsweep: interrupted")
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


# Stops after the first lines of the entry point, as its imports would take long.
STARTED = """
import sys
sys.argv = ["eventsweep", "simulate", "desk", "--out", sys.argv[1], "--quiet"]
import eventsweep.__main__ as entry
print("up", flush=True)
entry.main()
"""


def test_an_interrupt_that_is_to_be_ignored_is_ignored():
    script = "import signal, os, eventsweep.__main__; os.kill(os.getpid(), signal.SIGINT)"
    done = subprocess.run(
        [sys.executable, "-c", script],
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_IGN),
        check=False, capture_output=True, env=os.environ,
    )  # fmt: skip
    assert done.returncode == 0
