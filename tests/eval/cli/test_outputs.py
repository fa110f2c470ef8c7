"""Every verb: what it refuses it leaves as it was, and what it replaces was its own."""

import json
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.utils.inputs import also_read, command, command_inputs
from eventsweep.emvs.utils.output_manifest import strangers
from eventsweep.eval.cli.app import Common, app
from eventsweep.eval.cli.main import main
from eventsweep.eval.cli.verbs import gate
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
SHORT = ("--rig", "oblique", "--seconds", "0.005")
VERBS = {
    "simulate": ("simulate", "planes", *SHORT), "run": ("run", "planes"), "map": ("map", "../rec"),
    "sliding": ("map", "../rec", *SLIDING),
    "convert": ("convert", "../rec", "{out}", "--to", "dsec"),
    "convert a file": ("convert", "../rec", "{out}", "--to", "tum"),
    "info": ("info", "../rec", "--picture", "{out}"),
}  # fmt: skip


def asked(verb, out):
    """The words of a verb that writes to `out`."""
    words = [word.format(out=out) for word in VERBS[verb]]
    return [*words, *(() if out in words else ("--out", out)), "--quiet"]


@pytest.mark.parametrize("verb", VERBS)
def test_a_thesis_survives_every_verb(tmp_path, monkeypatch, capsys, caplog, rec, verb):
    for name in ("p", "here"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "thesis.tex").write_text("x")
    monkeypatch.chdir(tmp_path / "here")
    with untouched(tmp_path):
        said = command_refused(capsys, *asked(verb, "../p"))
        assert "--force" in said or verb == "sliding"
        for force in ([], ["--force"]):
            said = command_refused(capsys, *asked(verb, "."), *force)
            assert "working directory" in said or verb == "sliding"
    if verb != "run":
        assert main([*asked(verb, "../p"), "--force"]) == 0
        assert (tmp_path / "p.kept-1" / "thesis.tex").read_text() == "x"
        (line,) = (line for line in caplog.messages if "kept" in line)
        assert line.endswith("p.kept-1")


@pytest.mark.parametrize("flags", [(), SLIDING], ids=["one", "sliding"])
@pytest.mark.parametrize("out", ["parent", "parent/rec"])
def test_a_recording_survives_its_map(tmp_path, caplog, rec, flags, out):
    (tmp_path / "parent").mkdir()
    rec = rec.rename(tmp_path / "parent" / "rec")
    place, rest = tmp_path / out, rec.relative_to(tmp_path / out)
    assert main([*map(str, ("map", rec, "--out", place, "--force", *flags)), "--quiet"]) == 0
    Sequence.open(place.with_name(f"{place.name}.kept-1") / rest).verify()
    assert "is or holds the input" in caplog.text
    assert (place / "map.json").is_file()


# The words of a command, in which `IN` is what it must not remove, and OUT what it writes.
READING = {
    "simulate": "simulate planes --out OUT --sim.replay.trajectory IN",
    "simulate a model": "simulate IN --out OUT --sim.replay.imu-cam IN --motion IN --rig IN",
    "simulate a sensor": "simulate planes --out OUT --sim.sensor.preset PRESET",
    "simulate as a file says": "simulate planes --out OUT --config IN",
    "run": "run planes --out OUT --sim.replay.hand-eye IN --map.learned.weights IN",
    "map": "map IN --out OUT --config IN --map.derd.weights IN",
    "convert": "convert IN OUT --to tum", "info": "info IN --picture OUT",
    "score": "score NAME=IN --truth IN --out OUT --config IN",
    "score maps": "score IN --prediction NAME=IN",
    "suite": "suite IN --out OUT --prediction NAME=IN --archive IN",
    "gate": "gate --baseline IN --suite IN --out OUT --junit OUT --markdown OUT",
    "compare": "compare IN IN --out OUT", "track": "track IN --out OUT --first-map IN --start IN",
    "events": "events IN --out OUT --poses IN --calibration IN --stamps IN",
    "check": "check IN --out OUT", "calibrate": "calibrate IN --refine delay --out OUT",
    "fit": "fit IN --out OUT", "realism": "realism IN IN --out OUT",
    "archive": "archive unpack IN --out OUT", "ranking": "ranking NAME=IN --out OUT",
    "submission": "submission make IN --suite IN --out OUT --archive IN",
    "train": "train --out OUT --published IN",
}  # fmt: skip


@pytest.mark.parametrize("verb", READING)
def test_a_command_removes_nothing_that_its_words_name(tmp_path, verb):
    """Nor what a file of settings names: the outputs' tests say what becomes of it."""
    (tmp_path / "weights.npz").touch()
    words, inputs = [], {tmp_path / "weights.npz"}
    for number, word in enumerate(READING[verb].split()):
        if word.endswith("IN"):
            path = tmp_path / f"in{number}{'.toml' if number == 2 else '.txt'}"
            path.write_text('weights = "weights.npz"\n')
            inputs.add(path)
            word = word.replace("IN", str(path))
        if word == "PRESET":
            word = str(tmp_path / "sensor.toml")
            Path(word).write_text("contrast_threshold_pos = 0.3\n")
            inputs.add(Path(word))
        words.append(str(tmp_path / "out") if word == "OUT" else word)
    if not any(path.name == "in2.toml" for path in inputs):
        inputs.remove(tmp_path / "weights.npz")
    with command():
        app.parse_args(words, exit_on_error=False, print_error=False)
        named = set(command_inputs())
    assert inputs <= named
    assert tmp_path / "out" not in named


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
    (out / "w000" / "notes.txt").write_text("x")
    assert "--force" in command_refused(capsys, *asked)
    assert mapped(rec, out, "--no-check", "--force") == 0
    assert (tmp_path / "map.kept-1" / "w000" / "notes.txt").read_text() == "x"


def test_the_old_map_stays_until_the_new_one_is_done(tmp_path, capsys, rec):
    assert mapped(rec, tmp_path / "map", "--no-check") == 0
    asked = ("map", rec, "--out", tmp_path / "map", *SLIDING, "--force", "--quiet")
    with untouched(tmp_path):
        bad = ("--map.min-events", "99999999", "--no-check")
        assert "none of" in command_refused(capsys, *asked, *bad)
    (tmp_path / ".map.next").symlink_to(tmp_path / "rec")
    assert main([*map(str, asked), "--no-check"]) == 0
    assert (tmp_path / ".map.next.kept-1").readlink() == tmp_path / "rec"
    Sequence.open(rec).verify()


def test_a_map_that_was_to_replace_another_and_was_killed_is_taken_up(tmp_path, rec):
    out = tmp_path / "map"
    assert mapped(rec, out, "--no-check") == 0
    names = sorted(path.name for path in out.glob("w*"))
    expected = {path: what for path, what in contents(tmp_path).items() if path.name != ".lock"}
    following = shutil.copytree(out, tmp_path / ".map.next")
    shutil.rmtree(following / names[-1])
    left = following / f".{names[-1]}.partial"
    (left / "new").mkdir(parents=True)
    (left / ".eventsweep-work").touch()
    (following / f".{names[0]}.partial").mkdir()
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


def test_own_files_in_a_folder_are_written_anew_and_others_are_kept(tmp_path):
    rows = (score_row("c", "all", "Alg1/H", "mean_error", 1.0, "m", "lower"),)
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        write_results(tmp_path / name, Results(rows))
    out = tmp_path / "out"
    words = ["compare", *(str(tmp_path / name) for name in "ab"), "--out", str(out)]
    for _ in range(2):
        assert main([*words, "--quiet"]) == 0
        assert strangers(out) == []
    (out / "compare.html").write_text("mine")
    assert main([*words, "--quiet"]) == 0
    assert (out / "compare.html.kept-1").read_text() == "mine"
    assert strangers(out) == ["compare.html.kept-1"]


def test_the_gate_keeps_what_is_not_its_own(tmp_path):
    baseline = tmp_path / "baseline.json"
    baseline.write_text("numbers")

    def report(**files):
        flags = gate.GateFlags(baseline=baseline, **files)
        with command():
            also_read({"flags": flags})
            gate._report([], SimpleNamespace(name="a"), flags, Common(quiet=True))

    for kind in ("junit", "markdown"):
        (mine := tmp_path / kind).write_text("mine")
        for path in (mine, tmp_path):
            assert "exists" in line_of(report, **{kind: path})
        report(**{kind: mine}, force=True)
        assert mine.with_name(f"{kind}.kept-1").read_text() == "mine"
        report(**{kind: mine})  # its own, unchanged
        mine.write_text(f"{mine.read_text()} corrected")
        assert "exists" in line_of(report, **{kind: mine})
    report(junit=baseline, force=True)
    assert (tmp_path / "baseline.json.kept-1").read_text() == "numbers"


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
    checkpoint = CheckpointFolder(
        out, "key", Sequence.open(made).rig, renderer="", resume=False, notice=print
    )
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
