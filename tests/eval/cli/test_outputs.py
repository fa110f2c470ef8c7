"""Every verb: what it refuses it leaves as it was, and what it replaces was its own."""

import json
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.emvs.utils.outputs import output_file
from eventsweep.eval.cli.main import main
from eventsweep.eval.cli.verbs.gate import GateFlags
from eventsweep.eval.results.results import Results, write_results
from eventsweep.sim.parallel.checkpoint import CheckpointFolder, checkpoint_path
from places import ROOT
from programs import python
from refusals import command_refused, contents, line_of, untouched
from score_rows import score_row
from small_pair import small_sequence

pytestmark = pytest.mark.usefixtures("blank_figures")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    return small_sequence(tmp_path_factory.mktemp("small") / "seq")


@pytest.fixture
def rec(made, tmp_path):
    """A sequence in a folder of its own."""
    return shutil.copytree(made, tmp_path / "rec", copy_function=shutil.copyfile)


SLIDING = ("--map.window-s", "0.02", "--map.planes", "5", "--method", "Alg1/H")
VERBS = {
    "simulate": ("simulate", "planes"), "run": ("run", "planes"), "map": ("map", "../rec"),
    "sliding": ("map", "../rec", *SLIDING),
    "convert": ("convert", "../rec", "{out}", "--to", "dsec"),
    "convert a file": ("convert", "../rec", "{out}", "--to", "tum"),
}  # fmt: skip


def asked(verb, out):
    """The words of a verb that writes to `out`."""
    words = [word.format(out=out) for word in VERBS[verb]]
    return [*words, "--quiet"] if "convert" in verb else [*words, "--out", out, "--quiet"]


@pytest.mark.parametrize("place", ["../p", "."], ids=["a folder", "the working directory"])
@pytest.mark.parametrize("verb", VERBS)
def test_a_thesis_survives_every_verb(tmp_path, monkeypatch, capsys, rec, verb, place):
    for name in ("p", "here"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").write_text("x")
    monkeypatch.chdir(tmp_path / "here")
    for force in ([], ["--force"]):
        with untouched(tmp_path):
            said = command_refused(capsys, *asked(verb, place), *force)
        assert place == "." or "--force" not in said
        assert "sliding" in verb or place == "." or re.search(r"thesis\.tex|is a folder", said)


@pytest.mark.parametrize("flags", [(), SLIDING], ids=["one", "sliding"])
def test_a_recording_survives_its_map(tmp_path, capsys, rec, flags):
    parent = tmp_path / "parent"
    parent.mkdir()
    rec = rec.rename(parent / "rec")
    with untouched(tmp_path):
        for out, words in ((rec, "input itself"), (parent, "holds the input")):
            assert words in command_refused(capsys, "map", rec, "--out", out, "--force", *flags)
    Sequence.open(rec).verify()


WRONG = {
    "simulate": "simulate planes --out a/b --trajectory nowhere",
    "run": "run planes --out a/b --sim.replay.trajectory nowhere",
    "map": "map rec --out a/b --map.duration-s 9", "sliding": "map rec --out a/b --map.window-s 9",
    "fuse": "fuse nowhere", "score": "score nowhere", "report": "report nowhere",
    "convert": "convert rec a/b --to npz --stream cam9",
    "convert a file": "convert nowhere a/b --to tum",
    "suite": "suite quick --out a/b --case nothing --cache cache",
    "gate": "gate --baseline nowhere --out a/b --junit a/c.xml",
    "study": "study pose-noise --out a/b --case nothing --cache cache",
    "compare": "compare nowhere nowhere2 --out a/b", "info": "info nowhere --picture a/b.png",
}  # fmt: skip


@pytest.mark.parametrize("verb", WRONG)
def test_what_is_refused_leaves_nothing(tmp_path, monkeypatch, capsys, rec, verb):
    monkeypatch.chdir(tmp_path)
    with untouched(tmp_path):
        command_refused(capsys, *WRONG[verb].split(), "--quiet")


def mapped(rec, out, *flags):
    return main([*map(str, ("map", rec, "--out", out, *SLIDING, *flags)), "--quiet"])


def test_a_refused_map_does_not_block_the_right_one(tmp_path, capsys, rec):
    out = tmp_path / "map"
    asked = ("map", rec, "--out", out, *SLIDING, "--quiet")
    command_refused(capsys, *asked, "--map.min-events", "99999999", "--no-check")
    assert mapped(rec, out) == 0  # windows of 0.02 s are short, and `map` says so
    other = ("--map.median-px", "3")
    with untouched(tmp_path):
        assert "--force" in command_refused(capsys, *asked, *other)
    assert mapped(rec, out, *other, "--no-check", "--force") == 0
    assert json.loads((out / "map.json").read_text())["config"]["median_px"] == 3
    assert strangers(out) == []
    assert {path.name for path in tmp_path.iterdir()} == {"rec", "map"}
    # A file of the user's in it ends that, and the advice with it.
    (out / "w000" / "notes.txt").write_text("x")
    assert "--force" not in command_refused(capsys, *asked)
    assert "w000/notes.txt" in command_refused(capsys, *asked, "--force")


def test_the_old_map_stays_until_the_new_one_is_done(tmp_path, capsys, rec):
    assert mapped(rec, tmp_path / "map", "--no-check") == 0
    asked = ("map", rec, "--out", tmp_path / "map", *SLIDING, "--force", "--quiet")
    with untouched(tmp_path):
        bad = ("--map.min-events", "99999999", "--no-check")
        assert "none of" in command_refused(capsys, *asked, *bad)
    (tmp_path / ".map.next").symlink_to(tmp_path / "rec")
    assert "is a link" in command_refused(capsys, *asked)


def test_a_map_that_was_to_replace_another_and_was_killed_is_taken_up(tmp_path, rec):
    out = tmp_path / "map"
    assert mapped(rec, out, "--no-check") == 0
    names = sorted(path.name for path in out.glob("w*"))
    expected = {path: what for path, what in contents(tmp_path).items() if path.name != ".lock"}
    following = shutil.copytree(out, tmp_path / ".map.next")
    shutil.rmtree(following / names[-1])
    left = following / f".{names[-1]}.abcdefgh.partial"
    (left / "new").mkdir(parents=True)
    (left / ".eventsweep-work").touch()
    (following / f".{names[0]}.abcdefgh.partial").mkdir()
    stamp = (following / names[0] / "window.json").stat().st_ino
    assert mapped(rec, out, "--no-check", "--force") == 0
    assert contents(tmp_path) == expected
    assert (out / names[0] / "window.json").stat().st_ino == stamp
    assert strangers(out) == []


def test_everything_that_a_map_folder_gets_is_known(tmp_path, rec):
    out = tmp_path / "map"
    assert mapped(rec, out, "--map.save-dsi", "--map.inpaint") == 0
    for verb in (["fuse"], ["report", "--tables", "--figures", "svg"]):
        assert main([verb[0], str(out), *verb[1:], "--quiet"]) == 0
        assert strangers(out) == []


def test_own_files_in_a_folder_are_written_anew_and_others_are_not(tmp_path, capsys):
    rows = (score_row("c", "all", "Alg1/H", "mean_error", 1.0, "m", "lower"),)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, Results(rows))
    words = ["compare", *(str(tmp_path / name) for name in "ab"), "--out", str(tmp_path / "out")]
    for _ in range(2):
        assert main([*words, "--quiet"]) == 0
    (tmp_path / "out" / "compare.html").write_text("mine")
    with untouched(tmp_path):
        assert "compare.html" in command_refused(capsys, *words, "--quiet")


def test_the_gate_writes_over_nothing_but_its_own(tmp_path, capsys):
    baseline = Path("reports/baseline.json")
    for flag, name in (("--junit", "thesis.xml"), ("--markdown", "notes.md")):
        (mine := tmp_path / name).write_text("mine")
        words = ("gate", "--baseline", baseline, "--result", baseline, "--quiet", flag)
        with untouched(tmp_path):
            assert "exists" in command_refused(capsys, *words, mine)
            assert "the input itself" in command_refused(capsys, *words, baseline, "--force")
            assert "is a folder" in command_refused(capsys, *words, tmp_path, "--force")
    own = tmp_path / "own.md"
    flags = GateFlags(baseline=baseline, markdown=own)
    with output_file(own, listed=True) as path:
        path.write_text("### eventsweep gate")
    flags.check_files(force=False)
    own.write_text("### eventsweep gate: corrected")
    assert "exists" in line_of(flags.check_files, force=False)


@pytest.mark.slow
@pytest.mark.parametrize(
    "kills", [(12, "map anew", "simulate", "submission"), (5, "convert")], ids=str
)
def test_after_a_kill_the_same_call_makes_the_same_and_nothing_is_lost(kills):
    """As in `fuzz_kills`, in a process that has not yet any thread."""
    count, *names = kills
    done = python(ROOT / "tests/fuzz/fuzz_kills.py", count, 0, *names, timeout=None)
    assert (done.returncode, done.stdout) == (0, f"{count} kills, 0 faults\n"), done.stderr[-999:]


# Unfinished simulations
@pytest.mark.parametrize("kind", ["link", "lock", "stranger", "file"])
def test_a_work_folder_that_is_not_ours_is_refused_and_kept(tmp_path, made, kind):
    out, mine = tmp_path / "out", tmp_path / "mine"
    (mine / "000000").mkdir(parents=True)
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
    checkpoint = CheckpointFolder(out, "key", Sequence.open(made).rig, resume=False, notice=print)
    with untouched(tmp_path):
        assert "unfinished work" in line_of(checkpoint.__enter__)


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
    ignoring = lambda: signal.signal(signal.SIGINT, signal.SIG_IGN)  # noqa: E731
    assert python("-c", script, preexec_fn=ignoring).returncode == 0
