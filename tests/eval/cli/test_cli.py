"""The command line: what it refuses, what it prints, and what it never leaves behind."""

import io
import json
import resource
import shutil
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import h5py
import numpy as np
import pytest

from eventsweep.eval.cli import flag_names
from eventsweep.eval.cli.app import app
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.cli.main import main
from programs import python
from refusals import command_refused
from small_pair import small_sequence
from tiers import often

pytestmark = pytest.mark.usefixtures("blank_figures")

FEW = ("--method", "Alg1/H", "--map.planes", "20", "--quiet")


@pytest.fixture(scope="module")
def sequence(tmp_path_factory) -> Path:
    return small_sequence(tmp_path_factory.mktemp("small") / "seq")


@pytest.fixture(scope="module")
def mapped(sequence, tmp_path_factory) -> tuple[Path, str, str]:
    """A map with what is the default, and what the command printed."""
    out, err = io.StringIO(), io.StringIO()
    folder = tmp_path_factory.mktemp("mapped") / "o"
    with redirect_stdout(out), redirect_stderr(err):
        assert main(["map", str(sequence), "--out", str(folder), "--json"]) == 0
    return folder, out.getvalue(), err.getvalue()


@pytest.mark.parametrize(("words", "message"), [
    ("run desc --out o", "unknown scene 'desc': choose one of"), ("run --out o", "CASE"),
    ("run desk desk --out o", "without repeats"), ("run desk", "--out"), ("mop", "mop"),
    ("run desk --out o --rig kinect", "unknown rig 'kinect'"),
    ("run desk --out o --method Alg9/Z", "unknown method 'Alg9/Z'"),
    ("run desk --out o --fast", "--fast"),
    ("simulate desk --out o --seconds -1", "--sim.duration-s is"),
    ("simulate desk --out o --seed -1", "seed -1"),
    ("simulate desk --out o --sim.log-eps 0", "--sim.log-eps is"),
    ("simulate desk --out o --sim.threshold 1", "--sim.threshold"),
    ("map nowhere --out o", "nowhere: no such folder"),
    ("map . --out o --map.planes 1", "planes"), ("map . --out o --map.planes many", "planes"),
    ("map . --out o --map.min-depth-m -1", "--map.min-depth-m is"),
    ("map . --out o --map.min-depth-m 4 --map.max-depth-m 1", "4..1 m"),
    ("score nowhere", "nowhere: no maps"), ("report nowhere", "nowhere"),
])  # fmt: skip
def test_bad_input_is_one_line_and_code_2(tmp_path, monkeypatch, capsys, words, message):
    monkeypatch.chdir(tmp_path)
    assert message in command_refused(capsys, *words.split())
    assert list(tmp_path.iterdir()) == []


@pytest.fixture
def config(tmp_path):
    """A function that writes a configuration file, and gives the flag and its path."""

    def written(text):
        (tmp_path / "c.toml").write_text(text)
        return ["--config", str(tmp_path / "c.toml")]

    return written


@pytest.mark.parametrize(("text", "message"), [
    ("[map]\nplanez = 5\n", "unknown key map.planez; did you mean planes?"),
    ("[mapp]\nplanes = 5\n", "unknown key mapp; did you mean map?"),
    ("planes = 5\n", "unknown key planes"), ("map = 5\n", "must be a table"),
    ("[map]\nplanes = 'many'\n", "map.planes is 'many'"), ("[map\n", "not TOML"),
    ("[sim.model]\ncontroller = 'evil.py:go'\n",
     "no file may name code to run; leave it out, and give --sim.model.controller"),
])  # fmt: skip
def test_bad_configuration_file_is_one_line_and_code_2(
    tmp_path, capsys, sequence, config, text, message
):
    words = ["map", sequence, "--out", tmp_path / "o", *config(text)]
    assert message in command_refused(capsys, *words)
    assert [path.name for path in tmp_path.iterdir()] == ["c.toml"]


@pytest.mark.slow
def test_settings_that_a_command_does_not_read_are_said(tmp_path, capsys, sequence, config):
    flag = config("[sim]\ncontrast_threshold_pos = 0.15\n[map]\nplanes = 7\n[score]\n")
    arguments = ["map", str(sequence), *flag, "--method", "EMVS/cam0"]
    for flags, lines in (((), 1), (("--json",), 1), (("--quiet",), 0)):
        assert main([*arguments, "--out", str(tmp_path / f"o{flags}"), *flags]) == 0
        told = [x for x in capsys.readouterr().err.splitlines() if "has no effect here" in x]
        assert len(told) == lines
        assert all("[sim] (contrast_threshold_pos)" in x and "reads [map]" in x for x in told)


@pytest.mark.parametrize("words", ["report x", "list", "info x", "fuse x", "gate --baseline x"])
def test_verbs_without_settings_take_no_file_of_them(capsys, config, words):
    assert "--config" in command_refused(capsys, *words.split(), *config("[map]\nplanes = 7\n"))


def test_flag_beats_file_beats_default(tmp_path, capsys, sequence, config):
    out, flag = tmp_path / "o", config("[map]\nplanes = 7\nmedian_px = 3\n")
    asked = [*flag, "--method", "Alg1/H", "--map.median-px", "1", "--quiet"]
    assert main(["map", str(sequence), "--out", str(out), *asked]) == 0
    config = json.loads((out / "map.json").read_text())["config"]
    assert (config["planes"], config["median_px"], config["threshold_kernel_px"]) == (7, 1, 5)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(("verb", "library", "command_line"), [
    ("simulate", "o exists: set force=True to replace it", "o exists: add --force to replace it"),
    ("list", "o exists: set force=True to replace it", "o exists: set force=True to replace it"),
    ("simulate", "or set resume=False to discard it", "or add --fresh to discard it"),
    ("simulate", "(resume=False discards them)", "(--fresh discards them)"),
    ("simulate", "with frames.rate_hz above 0", "with --sim.frames.rate-hz above 0"),
    ("map", "with frames.rate_hz above 0", "with frames.rate_hz above 0"),
    ("simulate", "replay.imu_cam without replay", "--sim.replay.imu-cam without replay"),
    ("simulate", "a/frames.gain and imu.csv", "a/frames.gain and imu.csv"),
    ("map", "map with inpaint=True to fill", "map with --map.inpaint to fill"),
    ("score", "set unit to 'ns', or set offset_s", "say --unit 'ns', or add --offset-s"),
    ("list", "set unit to 'ns'", "set unit to 'ns'"),
    ("map", "planes is 1: needs 2", "planes is 1: needs 2"),
])  # fmt: skip
def test_libraries_name_parameters_and_the_command_line_its_flags(verb, library, command_line):
    flag_names.runs(app[verb].assemble_argument_collection)
    assert flag_names.with_flags(library) == command_line


def test_an_existing_output_is_kept_unless_forced(tmp_path, capsys, sequence):
    out = tmp_path / "o"
    out.mkdir()
    (out / "precious").write_text("keep me")
    arguments = ["map", str(sequence), "--out", str(out), *FEW]
    assert "--force" in command_refused(capsys, *arguments)
    assert (out / "precious").read_text() == "keep me"
    (out / "precious").unlink()
    for _ in range(2):
        assert "--force" in command_refused(capsys, *arguments)
        before = (out / "map.json").stat().st_ino if (out / "map.json").exists() else None
        assert main([*arguments, "--force"]) == 0
        assert (out / "map.json").stat().st_ino != before


def test_json_is_all_that_is_printed_and_a_map_is_scored_and_reported(mapped, capsys):
    _, printed, err = mapped
    assert json.loads(printed)["windows"][0]["counts"]["cam0"]["events"] == 4000
    assert err == ""
    out, _, _ = mapped
    assert main(["score", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {row["method"] for row in rows} >= {"Alg1/H", "Alg1/max", "EMVS/cam0", "EMVS/cam1"}
    assert main(["report", str(out), "--quiet"]) == 0
    assert "Alg1/H" in (out / "report.html").read_text(encoding="utf-8")


def test_the_page_that_map_writes_shows_its_recording_beside_it_and_elsewhere(
    tmp_path, capsys, sequence
):
    assert main(["map", str(sequence), "--out", str(tmp_path / "o"), *FEW]) == 0
    shutil.copytree(sequence, tmp_path / "beside")
    assert main(["map", str(tmp_path / "beside"), "--out", str(tmp_path / "p"), *FEW]) == 0
    for name in "op":
        own = (tmp_path / name / "report.html").read_text(encoding="utf-8")
        assert "Ground truth" in own
        assert main(["report", str(tmp_path / name), "--quiet"]) == 0
        assert (tmp_path / name / "report.html").read_text(encoding="utf-8") == own


@pytest.mark.parametrize("flag", [
    ["--map.view-width-px", "64"], ["--map.view-cx-px", "30.5"], ["--map.reference-shift", "0.5"],
])  # fmt: skip
def test_a_view_of_its_own_is_reported_but_not_scored(tmp_path, capsys, sequence, flag):
    assert main(["map", str(sequence), "--out", str(tmp_path / "o"), *FEW, *flag]) == 0
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert "Alg1/H" in page
    assert "Ground truth" not in page
    said = command_refused(capsys, "score", tmp_path / "o")
    assert "reference view is not camera 0's" in said


def test_a_changed_sequence_is_not_scored(tmp_path, capsys):
    sequence = small_sequence(tmp_path / "seq")
    assert main(["map", str(sequence), "--out", str(tmp_path / "o"), *FEW]) == 0
    file = sequence / "cam0" / "truth.h5"
    content = file.read_bytes()
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert "content changed" in command_refused(capsys, "score", tmp_path / "o")


def test_windows_that_poses_do_not_cover_are_refused_with_the_distance(tmp_path, capsys):
    sequence = small_sequence(tmp_path / "seq", poses_end_us=60_000)
    span = ["--map.start-s", "0.02", "--map.duration-s", "0.07"]
    said = command_refused(capsys, "map", sequence, "--out", tmp_path / "o", *span)
    assert "0.029999 s after the last" in said


def test_list_and_version(capsys):
    assert main(["list", "--json"]) == 0
    kinds = json.loads(capsys.readouterr().out)
    assert {"desk", "boxes", "planes"} <= set(kinds["scenes"])
    assert {"davis346", "tumvie"} <= set(kinds["rigs"])
    assert main(["list"]) == 0
    assert "mean |e - g|" in capsys.readouterr().out
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("eventsweep 0.")


@pytest.mark.parametrize("points", [0, 1])
def test_a_method_without_points_or_with_one_is_scored_shown_and_compared(tmp_path, points):
    mapped, none = tmp_path / "map", tmp_path / "none"
    words = ("map", small_sequence(tmp_path / "seq"), "--out", mapped, *FEW, "--no-check")
    assert main([*map(str, words), "--method", "Alg1/min"]) == 0
    shutil.copytree(mapped, none)
    path = none / "w000" / "Alg1-min" / "depth.npz"
    arrays = dict(np.load(path))
    arrays["mask"] &= np.cumsum(arrays["mask"]).reshape(arrays["mask"].shape) <= points
    assert np.count_nonzero(arrays["mask"]) == points
    np.savez(path, **arrays)
    for folder in (mapped, none):
        assert main(["score", str(folder), "--quiet"]) == 0
        assert main(["report", str(folder), "--tables", "--figures", "svg", "--quiet"]) == 0
    pair = ["compare", str(mapped), str(none), "--out", str(tmp_path / "c"), "--quiet"]
    assert main([*pair, "--table", str(tmp_path / "t.tex")]) == 0
    assert f"none: Alg1/min & {'--' if points == 0 else ''}" in (tmp_path / "t.tex").read_text()


@pytest.mark.slow
def test_a_full_disk_in_sliding_windows_is_one_line_and_the_same_command_goes_on(tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (12_000, 12_000))

    sequence, out = small_sequence(tmp_path / "seq"), tmp_path / "o"
    words = ("map", sequence, "--out", out, *FEW, "--map.window-s", "0.02", "--no-check")
    done = python("-m", "eventsweep", *words, preexec_fn=small_files)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert f"{out}: file too large; 0 of" in done.stderr
    assert "make room, and the same again goes on" in done.stderr
    assert main([*map(str, words)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"seq", "o"}


@pytest.mark.parametrize(
    ("error", "words"), [(MemoryError(), ""), (MemoryError("no 9 GB"), "no 9 GB: ")]
)
def test_a_fault_without_words_is_said_without_an_empty_place(capsys, error, words):
    with exit_code() as code:
        raise error
    assert code.value == 2
    assert capsys.readouterr().err.startswith(f"eventsweep: {words}not enough memory; ")


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    arguments = ["simulate", "planes", "--out", str(tmp_path / "s"), "--quiet", "--seconds", "0.05"]
    done = python("-m", "eventsweep", *arguments, preexec_fn=small_files)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert not (tmp_path / "s").exists()
    # With room again the same command takes up what was finished, and clears it away.
    assert main(arguments) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


@pytest.mark.parametrize("kind", often([signal.SIGINT], [signal.SIGINT, signal.SIGTERM]))
def test_an_interrupted_run_leaves_nothing(tmp_path, kind):
    def heed_signals() -> None:
        # A parent in the background may have told its children to ignore Ctrl-C.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    words = [sys.executable, "-m", "eventsweep", "simulate", "planes", "--out", tmp_path / "s"]
    process = subprocess.Popen(
        [*words, "--quiet"], preexec_fn=heed_signals, stderr=subprocess.PIPE, text=True
    )
    deadline, begun = time.monotonic() + 60, ".*.work/*.partial/cam0.events.h5"
    while not list(tmp_path.glob(begun)) and time.monotonic() < deadline:
        time.sleep(0.05)
    process.send_signal(kind)
    _, err = process.communicate(timeout=60)
    assert (process.returncode, err.count("\n")) == (130, 1)
    assert list(tmp_path.iterdir()) == []


SPAWNING = """
import multiprocessing, os, sys
import eventsweep.__main__

def work():
    os.kill(os.getpid(), 15)

if __name__ == "__main__":
    worker = multiprocessing.get_context("spawn").Process(target=work)
    worker.start()
    worker.join()
    sys.exit(worker.exitcode != -15)
"""


def test_a_worker_that_is_ended_says_nothing_of_an_interrupt(tmp_path):
    """It imports the command's module before it knows that it is one."""
    (tmp_path / "main.py").write_text(SPAWNING)
    done = python("main.py", cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")


HEEDED = """
import signal, sys, time
from eventsweep.eval.cli.exit_codes import exit_code
signal.signal(signal.SIGINT, signal.default_int_handler)
%s
    for _ in range(600):
        time.sleep(0.1)
sys.exit(code.value)
"""
FOREIGN = """
import signal, time
try:
    signal.raise_signal(signal.SIGINT)
    time.sleep(0.3)
except KeyboardInterrupt as error:
    raise ImportError("initialisation failed") from error
"""
AT = {
    "a destructor": """
class Late:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
        len([])  # Python heeds a signal between two steps.

with exit_code() as code:
    Late()""",
    # Libraries make an ImportError of it, or half an import.
    "an import": """
with exit_code() as code:
    try:
        import foreign
    except ImportError:
        sys.exit(0)""",
    # It waits until all is written.
    "a write of HDF5": """
from pathlib import Path
import numpy as np
from eventsweep.emvs.data import hdf5

class Interrupted(hdf5.Sink):
    once = False

    def tell(self):  # asked for in `write`
        if not self.once:
            self.once = True
            signal.raise_signal(signal.SIGTERM)
        return super().tell()

hdf5.Sink = Interrupted
with exit_code() as code:
    path = Path("depth.h5")
    writer = hdf5.Hdf5Writer(path)
    writer.file["depth"] = np.arange(100_000)
    writer.close()""",
}


@pytest.mark.parametrize("place", AT)
def test_an_interrupt_at_an_odd_place_is_not_lost(tmp_path, place):
    (tmp_path / "foreign.py").write_text(FOREIGN)
    done = python("-c", HEEDED % AT[place], path=[tmp_path], cwd=tmp_path, timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (130, 1), done.stderr
    if "HDF5" in place:
        with h5py.File(tmp_path / "depth.h5") as file:
            assert np.array_equal(file["depth"], np.arange(100_000))


def test_a_command_inside_an_import_can_be_interrupted(tmp_path):
    (tmp_path / "script.py").write_text("""
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
import eventsweep.eval.cli.main as command

def forever(*_, **__):
    signal.raise_signal(signal.SIGINT)
    time.sleep(60)

command.app = forever
sys.exit(command.main(["list"]))
""")
    assert python("-c", "import script", path=[tmp_path], timeout=30).returncode == 130


def test_no_usable_graphics_is_one_line(tmp_path):
    words = ["simulate", "planes", "--out", tmp_path / "s", "--sim.light.renderer", "mujoco"]
    done = python("-m", "eventsweep", *words, "--quiet", env={"MUJOCO_GL": "nonsense"})
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "MUJOCO_GL" in done.stderr
    assert list(tmp_path.iterdir()) == []
