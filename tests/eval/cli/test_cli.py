"""The command line: what it refuses, what it prints, and what it never leaves behind."""

import io
import json
import os
import resource
import signal
import subprocess
import sys
import time
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path

import h5py
import numpy as np
import pytest

from eventsweep.eval import pipeline
from eventsweep.eval.cli.exit_codes import with_flags
from eventsweep.eval.cli.main import main
from eventsweep.plugins.cuda import device
from places import ROOT
from small_pair import small_sequence
from tiers import often

pytestmark = pytest.mark.usefixtures("blank_figures")

COMMAND = [sys.executable, "-m", "eventsweep"]


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


def refused(capsys, arguments: list[str]) -> str:
    """Runs a command that must fail: exit code 2 and one line."""
    assert main(arguments) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert err.startswith("eventsweep: ")
    assert err.count("\n") == 1, err
    return err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["run", "desc", "--out", "o"], "unknown scene 'desc': choose one of"),
        (["run", "--out", "o"], "CASE"),
        (["run", "desk", "desk", "--out", "o"], "without repeats"),
        (["run", "desk"], "--out"),
        (["run", "desk", "--out", "o", "--rig", "kinect"], "unknown rig 'kinect'"),
        (["run", "desk", "--out", "o", "--method", "Alg9/Z"], "unknown method 'Alg9/Z'"),
        (["run", "desk", "--out", "o", "--fast"], "--fast"),
        (["simulate", "desk", "--out", "o", "--seconds", "-1"], "duration_s"),
        (["simulate", "desk", "--out", "o", "--seed", "-1"], "seed -1"),
        (["simulate", "desk", "--out", "o", "--sim.log-eps", "0"], "log_eps"),
        (["simulate", "desk", "--out", "o", "--sim.threshold", "1"], "--sim.threshold"),
        (["map", "nowhere", "--out", "o"], "nowhere: no such folder"),
        (["map", ".", "--out", "o", "--map.planes", "1"], "planes"),
        (["map", ".", "--out", "o", "--map.planes", "many"], "planes"),
        (["map", ".", "--out", "o", "--map.min-depth-m", "-1"], "min_depth_m"),
        (["map", ".", "--out", "o", "--map.min-depth-m", "4", "--map.max-depth-m", "1"], "4..1 m"),
        (["score", "nowhere"], "nowhere: no maps"),
        (["report", "nowhere"], "nowhere"),
        (["mop"], "mop"),
    ],
)  # fmt: skip
def test_bad_input_is_one_line_and_code_2(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    assert message in refused(capsys, arguments)
    assert list(tmp_path.iterdir()) == []


def test_a_run_without_its_gpu_is_refused_before_it_simulates(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(device, "missing", lambda: "it is gone")
    monkeypatch.setattr(pipeline, "simulate_scene", None)
    arguments = ["run", "planes", "--out", str(tmp_path / "o"), "--device", "cuda"]
    assert "device cuda cannot be used: it is gone" in refused(capsys, arguments)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[map]\nplanez = 5\n", "unknown key map.planez; did you mean planes?"),
        ("[mapp]\nplanes = 5\n", "unknown key mapp; did you mean map?"),
        ("planes = 5\n", "unknown key planes"),
        ("map = 5\n", "must be a table"),
        ("[map]\nplanes = 'many'\n", "map.planes is 'many'"),
        ("[map\n", "not TOML"),
        (
            "[sim.model]\ncontroller = 'evil.py:go'\n",
            "no file may name code to run; leave it out, and give --sim.model.controller",
        ),
    ],
)
def test_bad_configuration_file_is_one_line_and_code_2(tmp_path, capsys, sequence, text, message):
    file = tmp_path / "c.toml"
    file.write_text(text)
    arguments = ["map", str(sequence), "--out", str(tmp_path / "o"), "--config", str(file)]
    assert message in refused(capsys, arguments)
    assert [path.name for path in tmp_path.iterdir()] == ["c.toml"]


@pytest.mark.slow
def test_settings_that_a_command_does_not_read_are_said(tmp_path, capsys, sequence):
    file = tmp_path / "c.toml"
    file.write_text("[sim]\ncontrast_threshold_pos = 0.15\n[map]\nplanes = 7\n[score]\n")
    arguments = ["map", str(sequence), "--config", str(file), "--method", "EMVS/cam0"]
    for flags, lines in (((), 1), (("--json",), 1), (("--quiet",), 0)):
        assert main([*arguments, "--out", str(tmp_path / f"o{flags}"), *flags]) == 0
        told = [x for x in capsys.readouterr().err.splitlines() if "has no effect here" in x]
        assert len(told) == lines
        assert all("[sim] (contrast_threshold_pos)" in x and "reads [map]" in x for x in told)


@pytest.mark.parametrize(
    "arguments",
    [["report", "x"], ["list"], ["info", "x"], ["fuse", "x"], ["gate", "--baseline", "x"]],
)
def test_verbs_without_settings_take_no_file_of_them(tmp_path, capsys, arguments):
    file = tmp_path / "c.toml"
    file.write_text("[map]\nplanes = 7\n")
    assert "--config" in refused(capsys, [*arguments, "--config", str(file)])


def test_flag_beats_file_beats_default(tmp_path, capsys, sequence):
    file = tmp_path / "c.toml"
    file.write_text("[map]\nplanes = 7\nmedian_px = 3\n")
    out = tmp_path / "o"
    asked = ["--config", str(file), "--method", "Alg1/H", "--map.median-px", "1", "--quiet"]
    assert main(["map", str(sequence), "--out", str(out), *asked]) == 0
    config = json.loads((out / "map.json").read_text())["config"]
    assert (config["planes"], config["median_px"], config["threshold_kernel_px"]) == (7, 1, 5)
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("library", "command_line"),
    [
        ("o exists: set force=True to replace it", "o exists: add --force to replace it"),
        ("or set resume=False to discard it", "or add --fresh to discard it"),
        ("(resume=False discards them)", "(--fresh discards them)"),
        ("simulate with frames.rate_hz above 0", "simulate with --sim.frames.rate-hz above 0"),
        ("simulate with imu.rate_hz above 0", "simulate with --sim.imu.rate-hz above 0"),
        ("replay.imu_cam without replay", "--sim.replay.imu-cam without replay"),
        ("a/frames.gain and imu.csv", "a/frames.gain and imu.csv"),
        ("map with inpaint=True to fill", "map with --map.inpaint to fill"),
        ("planes is 1: needs 2", "planes is 1: needs 2"),
    ],
)
def test_libraries_name_parameters_and_the_command_line_flags(library, command_line):
    assert with_flags(library) == command_line


def test_an_existing_output_is_kept_unless_forced(tmp_path, capsys, sequence):
    out = tmp_path / "o"
    out.mkdir()
    (out / "precious").write_text("keep me")
    arguments = ["map", str(sequence), "--out", str(out), *FEW]
    for asked in (arguments, [*arguments, "--force"]):
        said = refused(capsys, asked)
        assert "holds precious, which eventsweep did not write" in said
        assert "--force" not in said
        assert (out / "precious").read_text() == "keep me"
    (out / "precious").unlink()
    assert "--force" in refused(capsys, arguments)
    assert main([*arguments, "--force"]) == 0
    before = (out / "map.json").stat().st_ino
    assert "--force" in refused(capsys, arguments)
    assert main([*arguments, "--force"]) == 0
    assert (out / "map.json").stat().st_ino != before


def test_json_is_all_that_is_printed(mapped):
    _, printed, err = mapped
    assert json.loads(printed)["windows"][0]["counts"]["cam0"]["events"] == 4000
    assert err == ""


def test_a_map_is_scored_and_reported_from_its_folder(capsys, mapped):
    out, _, _ = mapped
    assert main(["score", str(out), "--json"]) == 0
    rows = json.loads(capsys.readouterr().out)["rows"]
    assert {row["method"] for row in rows} >= {"Alg1/H", "Alg1/max", "EMVS/cam0", "EMVS/cam1"}
    assert main(["report", str(out), "--quiet"]) == 0
    assert "Alg1/H" in (out / "report.html").read_text(encoding="utf-8")


@pytest.mark.parametrize("flag", [
    ["--map.view-width-px", "64"], ["--map.view-cx-px", "30.5"], ["--map.reference-shift", "0.5"],
])  # fmt: skip
def test_a_view_of_its_own_is_reported_but_not_scored(tmp_path, capsys, sequence, flag):
    out = str(tmp_path / "o")
    assert main(["map", str(sequence), "--out", out, *FEW, *flag]) == 0
    page = (tmp_path / "o" / "report.html").read_text(encoding="utf-8")
    assert "Alg1/H" in page
    assert "Ground truth" not in page
    assert "reference view is not camera 0's" in refused(capsys, ["score", out])


def test_a_changed_sequence_is_not_scored(tmp_path, capsys):
    sequence = small_sequence(tmp_path / "seq")
    assert main(["map", str(sequence), "--out", str(tmp_path / "o"), *FEW]) == 0
    file = sequence / "cam0" / "truth.h5"
    content = file.read_bytes()
    file.write_bytes(content[:-1] + bytes([content[-1] ^ 1]))
    assert "content changed" in refused(capsys, ["score", str(tmp_path / "o")])


def test_windows_that_poses_do_not_cover_are_refused_with_the_distance(tmp_path, capsys):
    sequence = small_sequence(tmp_path / "seq", poses_end_us=60_000)
    out = ["--out", str(tmp_path / "o"), "--map.start-s", "0.02"]
    err = refused(capsys, ["map", str(sequence), *out, "--map.duration-s", "0.07"])
    assert "0.029999 s after the last" in err


def test_list_and_version(capsys):
    assert main(["list", "--json"]) == 0
    kinds = json.loads(capsys.readouterr().out)
    assert {"desk", "boxes", "planes"} <= set(kinds["scenes"])
    assert {"davis346", "tumvie"} <= set(kinds["rigs"])
    assert main(["list"]) == 0
    assert "mean |e - g|" in capsys.readouterr().out
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("eventsweep 0.")


@pytest.mark.slow
def test_a_full_disk_is_one_line_and_loses_nothing(tmp_path):
    def small_files() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))

    arguments = ["simulate", "planes", "--out", str(tmp_path / "s"), "--quiet", "--seconds", "0.05"]
    done = subprocess.run(
        [*COMMAND, *arguments], preexec_fn=small_files, capture_output=True, text=True, check=False
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "s").exists()
    # With room again the same command takes up what was finished, and clears it away.
    assert main(arguments) == 0
    assert [path.name for path in tmp_path.iterdir()] == ["s"]


@pytest.mark.parametrize("kind", often([signal.SIGINT], [signal.SIGINT, signal.SIGTERM]))
def test_an_interrupted_run_leaves_nothing(tmp_path, kind):
    def heed_signals() -> None:
        # A parent in the background may have told its children to ignore Ctrl-C.
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    arguments = ["simulate", "planes", "--out", str(tmp_path / "s"), "--quiet"]
    process = subprocess.Popen(
        [*COMMAND, *arguments], preexec_fn=heed_signals, stderr=subprocess.PIPE, text=True
    )
    deadline = time.monotonic() + 60
    while (
        not list(tmp_path.glob(".*.work/*.partial/cam0.events.h5")) and time.monotonic() < deadline
    ):
        time.sleep(0.05)
    process.send_signal(kind)
    _, err = process.communicate(timeout=60)
    assert process.returncode == 130
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_an_interrupt_inside_a_destructor_is_not_lost():
    script = """
import signal, sys, time
from eventsweep.eval.cli.exit_codes import exit_code

class Late:
    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
        len([])  # Python heeds a signal between two steps.

with exit_code() as code:
    Late()
    for _ in range(600):
        time.sleep(0.1)
sys.exit(code.value)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 130
    assert done.stderr.count("\n") == 1


def test_an_interrupt_during_an_import_is_not_lost(tmp_path):
    """Libraries make an ImportError of it, or half an import."""
    (tmp_path / "foreign.py").write_text("""
import signal, time
try:
    signal.raise_signal(signal.SIGINT)
    time.sleep(0.3)
except KeyboardInterrupt as error:
    raise ImportError("initialisation failed") from error
""")
    script = """
import signal, sys, time
signal.signal(signal.SIGINT, signal.default_int_handler)
from eventsweep.eval.cli.exit_codes import exit_code

with exit_code() as code:
    try:
        import foreign
    except ImportError:
        sys.exit(0)
    for _ in range(600):
        time.sleep(0.1)
sys.exit(code.value)
"""
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=False, timeout=60,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
    )  # fmt: skip
    assert done.returncode == 130
    assert done.stderr.count("\n") == 1


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
    done = subprocess.run(
        [sys.executable, "-c", "import script"], capture_output=True, check=False, timeout=30,
        env=os.environ | {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])},
    )  # fmt: skip
    assert done.returncode == 130


def test_an_interrupt_while_hdf5_writes_waits_until_it_has_written(tmp_path):
    script = """
import signal, sys, time
from pathlib import Path
import numpy as np
from eventsweep.emvs.data import hdf5
from eventsweep.eval.cli.exit_codes import exit_code

class Interrupted(hdf5.Sink):
    once = False

    def tell(self):  # asked for in `write`
        if not self.once:
            self.once = True
            signal.raise_signal(signal.SIGTERM)
        return super().tell()

hdf5.Sink = Interrupted
with exit_code() as code:
    path = Path(sys.argv[1])
    writer = hdf5.Hdf5Writer(path)
    writer.file["depth"] = np.arange(100_000)
    writer.close()
    for _ in range(600):
        time.sleep(0.1)
sys.exit(code.value)
"""
    path = tmp_path / "depth.h5"
    done = subprocess.run(
        [sys.executable, "-c", script, path], capture_output=True, text=True, check=False,
        timeout=60,
    )  # fmt: skip
    assert done.returncode == 130, done.stderr
    assert done.stderr.count("\n") == 1
    with h5py.File(path) as file:
        assert np.array_equal(file["depth"], np.arange(100_000))


def test_no_usable_graphics_is_one_line(tmp_path):
    arguments = ["simulate", "planes", "--out", str(tmp_path / "s"), "--quiet"]
    done = subprocess.run(
        [*COMMAND, *arguments],
        env={"MUJOCO_GL": "nonsense"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2, done.stderr
    assert done.stderr.count("\n") == 1
    assert "MUJOCO_GL" in done.stderr
    assert list(tmp_path.iterdir()) == []
