"""The GPU's benchmark, tried on the CPU in its place and on numba's simulator of a GPU."""

import json
import subprocess
import sys
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import bench_gpu
import gpu_calls
import gpu_frames
import gpu_machine
import gpu_parts
import gpu_tables
from cost_stream import MovingEdges
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from gpu_calls import Agreement, agreement, same, save_volumes
from gpu_plan import QUICK, BenchmarkPlan
from gpu_votes import votes_s
from places import ROOT, TOOLS, with_tools

TRIAL = ["--quick", "--device", "cpu"]
MAPPED = ["--only", "whole", "--only", "agreement", "--only", "sliding", "--only", "growth"]


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    path = tmp_path_factory.mktemp("gpu") / "report.json"
    assert bench_gpu.main([*TRIAL, *MAPPED, "--out", str(path)]) == 0
    return json.loads(path.read_text())


def program(*arguments, code=None, **environment):
    command = (
        [sys.executable, str(TOOLS), "bench_gpu"] if code is None else [sys.executable, "-c", code]
    )
    return subprocess.run(
        [*command, *arguments], env=with_tools() | environment, cwd=ROOT, text=True,
        capture_output=True,
    )  # fmt: skip


def test_the_report_says_what_was_measured_and_on_what(report):
    assert report["wrong"] == []
    assert report["quick"] is True
    assert report["machine"]["versions"]["numba"][0].isdigit()
    calls = report["parts"]["whole"]["calls"]
    assert set(calls) == {"fixed", "float", "cpu"}
    assert all(len(one["rounds_s"]) == 1 and one["votes_s"] > 0 for one in calls.values())
    # The CPU stood in for the GPU, so nothing can differ.
    for name in ("fixed", "float"):
        found = report["parts"]["agreement"][name]
        assert (found["volume"], found["relative"], found["counted"]) == (0, 0, 0)
        assert found["argmax"] == 1
    assert [g["amounts"] for g in report["parts"]["growth"]["series"]] == [
        list(QUICK.grow_events), list(QUICK.grow_planes), [w * h for w, h in QUICK.grow_sizes],
    ]  # fmt: skip
    assert report["parts"]["sliding"]["gpu"]["events"] == 2 * QUICK.window_events * QUICK.windows


@given(
    names=st.sets(st.sampled_from(list(MAPPED[1::2]))),
    broken=st.sets(st.sampled_from(MAPPED[1::2])),
)
def test_tables_stand_without_any_of_the_parts(report, names, broken):
    parts = {n: {"skipped": "no time"} if n in broken else report["parts"][n] for n in names}
    said = gpu_tables.text(report | {"parts": parts})
    assert said.startswith("A trial: these figures mean nothing. The CPU stands in for the GPU.")
    assert said.count("Not measured: no time.") == len(names & broken)
    assert said.count("\n### ") == len(names)


def test_the_share_of_the_atomic_rate_is_that_of_the_additions():
    rates = [{"kind": "int64", "grid": "L2", "per_s": 1e11, "grid_bytes": 8}]
    one = {"counted": 1_000_000_000, "votes_s": 0.04}
    assert gpu_tables._share(one, ("int64", 2), {"rates": rates}) == "50 %"
    assert gpu_tables._share(one, ("int64", 2), {"skipped": "no GPU"}) == "–"
    assert gpu_tables._share(one, None, {"rates": rates}) == "–"


def real(report, took_s):
    """The report as a GPU's would be."""
    gpu = {"name": "NVIDIA H200", "l2_bytes": 60 << 20, "simulated": False, "cuda_runtime": "13.0",
           "nvidia_smi": {"driver_version": "580.1"}}  # fmt: skip
    made = json.loads(json.dumps(report)) | {"quick": False, "device": "cuda"}
    made["machine"]["gpu"] = gpu
    made["parts"]["whole"]["calls"]["fixed"]["median_s"] = took_s
    return made


@pytest.mark.parametrize(("took_s", "held"), [(0.0999, "yes"), (0.1001, "**no**")])
def test_a_page_gets_the_tables_of_a_report(report, tmp_path, took_s, held):
    source, page = tmp_path / "report.json", tmp_path / "page.md"
    bench_gpu.write_json(source, real(report, took_s))
    page.write_text("before\n<!-- gpu: begin -->\nold\n<!-- gpu: end -->\nafter\n")
    assert bench_gpu.main(["--from", str(source), "--page", str(page)]) == 0
    first = page.read_text()
    assert first.startswith(
        "before\n<!-- gpu: begin -->\n\nNVIDIA H200, driver 580.1, CUDA runtime 13.0"
    )
    assert first.endswith("<!-- gpu: end -->\nafter\n")
    assert "old" not in first
    line = next(line for line in first.splitlines() if "fixed-point votes" in line)
    assert f"| {1e3 * took_s:.4g} ms | {held} |" in line
    assert bench_gpu.main(["--from", str(source), "--page", str(page)]) == 0
    assert page.read_text() == first


def test_the_projects_page_has_the_marks():
    page = (ROOT / "docs/performance.md").read_text(encoding="utf-8")
    assert page.count("<!-- gpu: begin -->\n") == page.count("<!-- gpu: end -->\n") == 1


def test_a_trial_stays_off_the_page(report, tmp_path, capsys):
    source, page = tmp_path / "report.json", tmp_path / "page.md"
    bench_gpu.write_json(source, report)
    page.write_text("<!-- gpu: begin -->\n<!-- gpu: end -->\n")
    for arguments in (["--from", str(source)], [*TRIAL, "--out", str(tmp_path / "other.json")]):
        assert bench_gpu.main([*arguments, "--page", str(page)]) == 2
        assert "trial" in capsys.readouterr().err
    assert page.read_text() == "<!-- gpu: begin -->\n<!-- gpu: end -->\n"
    assert not (tmp_path / "other.json").exists()


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "null", "{}", '{"schema_version": 99}', "\0", '{"schema_version": "1"}']
)
def test_what_is_no_report_is_refused_in_one_line(tmp_path, capsys, text):
    path = tmp_path / "report.json"
    path.write_text(text)
    assert bench_gpu.main(["--from", str(path)]) == 2
    assert bench_gpu.main(["--from", str(tmp_path / "absent.json")]) == 2
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2
    assert all(line.startswith("eventsweep: ") for line in said)


@pytest.mark.parametrize(
    ("arguments", "word"),
    [([], "--out"), (["--out", "x.json", "--from", "y.json"], "--from"),
     ([*TRIAL, "--out", "new.json", "--only", "nonsense"], "choose from atomics"),
     ([*TRIAL, "--out", "there.json"], "there.json")],
)  # fmt: skip
def test_arguments_that_cannot_be_met(tmp_path, monkeypatch, capsys, arguments, word):
    monkeypatch.chdir(tmp_path)
    Path("there.json").write_text("precious")
    assert bench_gpu.main(arguments) == 2
    assert word in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["there.json"]
    assert Path("there.json").read_text() == "precious"


def test_wrong_results_are_the_exit_code(tmp_path, monkeypatch, capsys):
    def unstable(recording, config, rounds):
        found, result = gpu_calls.call(recording, config, rounds)
        return replace(found, repeats=False), result

    monkeypatch.setattr(gpu_parts, "call", unstable)
    path = tmp_path / "report.json"
    assert bench_gpu.main([*TRIAL, "--only", "whole", "--out", str(path)]) == 1
    assert "wrong: whole: fixed votes gave other bits" in capsys.readouterr().err
    assert len(json.loads(path.read_text())["wrong"]) == 1


def test_a_part_that_fails_leaves_the_others(tmp_path, monkeypatch, capsys):
    def breaks(*_):
        raise RuntimeError("the card\nis gone")

    monkeypatch.setattr(gpu_parts, "stream", breaks)
    path, parts = tmp_path / "report.json", ["--only", "sliding", "--only", "growth"]
    assert bench_gpu.main([*TRIAL, *parts, "--out", str(path)]) == 1
    found = json.loads(path.read_text())["parts"]
    assert found["sliding"]["failed"] == "RuntimeError: the card is gone"
    assert "series" in found["growth"]
    assert "Not measured: RuntimeError: the card is gone." in capsys.readouterr().out


def test_no_part_begins_when_the_time_is_spent(tmp_path):
    path = tmp_path / "report.json"
    assert bench_gpu.main([*TRIAL, "--budget-s", "-1", "--out", str(path)]) == 0
    found = json.loads(path.read_text())["parts"]
    assert len(found) == 6
    assert all("--budget-s" in part["skipped"] for part in found.values())


def test_without_a_gpu_it_says_so_in_one_line(tmp_path):
    done = program("--out", str(tmp_path / "x.json"), CUDA_VISIBLE_DEVICES="")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.count("\n") == 1
    assert done.stderr.startswith("eventsweep: device cuda cannot be used: ")
    assert not list(tmp_path.iterdir())


def test_without_a_backend_it_says_so(monkeypatch):
    monkeypatch.setattr(gpu_machine, "find_spec", lambda name: None)
    with pytest.raises(InputError, match="no CUDA backend") as caught:
        gpu_machine.check_device("cuda")
    assert "\n" not in str(caught.value)
    gpu_machine.check_device("cpu")


# A bare checkout beside a few wheels: what only the rest of the project needs is not there.
BARE = """
import sys
absent = {"h5py", "hdf5plugin", "pandas", "open3d", "matplotlib", "cyclopts", "rich", "mujoco",
          "OpenGL", "lz4", "jinja2", "rosbags", "tomli_w", "PIL", "backports"}
class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in absent:
            raise ModuleNotFoundError(name, name=name)
sys.meta_path.insert(0, Absent())
import importlib.util
found = importlib.util.find_spec
importlib.util.find_spec = lambda name, *rest: None if name in absent else found(name, *rest)
from bench_gpu import main
sys.exit(main(sys.argv[1:]))
"""


def test_it_runs_beside_few_libraries(tmp_path):
    path = tmp_path / "report.json"
    parts = ["--only", "whole", "--only", "agreement", "--only", "sliding", "--only", "frames"]
    done = program(*TRIAL, *parts, "--out", str(path), code=BARE)
    assert done.returncode == 0, done.stderr
    found = json.loads(path.read_text())["parts"]
    assert found["frames"]["skipped"].startswith("mujoco and OpenGL not installed")
    assert all("skipped" not in found[name] for name in parts[1:-2:2])


RECORDING = MovingEdges((24, 18), 400)
CONFIG = replace(QUICK, planes=4).config("cpu")


@pytest.fixture(scope="module")
def mapped(tmp_path_factory):
    folder = tmp_path_factory.mktemp("volumes")
    result = map_window(RECORDING, CONFIG)
    return result, [save_volumes(RECORDING, CONFIG, folder / name) for name in ("a", "b")]


def test_a_result_agrees_with_itself(mapped):
    result, (ours, theirs) = mapped
    found = agreement(result, result, ours, theirs)
    assert found == Agreement(0, 0, 1, 0)
    assert found.faults("x") == []
    assert same(result, result)


@pytest.mark.parametrize("value", [0.01, np.nan, np.inf])
def test_one_wrong_voxel_is_found(mapped, tmp_path, value):
    result, (_, theirs) = mapped
    ours = save_volumes(RECORDING, CONFIG, tmp_path / "ours")
    volume = np.load(ours / "EMVS-cam1.npy")
    greatest = np.load(theirs / "EMVS-cam1.npy").max()
    volume[2, 3, 4] += np.float32(value * greatest)
    np.save(ours / "EMVS-cam1.npy", volume)
    found = agreement(result, result, ours, theirs)
    assert len(found.faults("x")) == 1
    if value < 1:
        least = min(np.load(path).max() for path in theirs.glob("*.npy"))
        assert 0.9 * value < found.volume * (1 + 1e-6) <= value * greatest / least * 1.01


def test_maxima_in_other_planes_are_found(mapped):
    result, (ours, theirs) = mapped
    one = result.depth_maps["Alg1/G"]
    moved = one.argmax.copy()
    moved[0, 0] += 1
    maps = {**result.depth_maps, "Alg1/G": replace(one, argmax=moved)}
    found = agreement(replace(result, depth_maps=maps), result, ours, theirs)
    assert found.argmax == 1 - 1 / moved.size
    assert found.faults("x") == (["x: the argmax is equal in 99.769 % of pixels, below 99.9 %"])
    assert not same(replace(result, depth_maps=maps), result)


def test_a_share_that_is_no_number_is_wrong():
    assert len(Agreement(np.nan, 0, np.nan, 0).faults("x")) == 2


def test_votes_alone_take_time():
    assert 0 < votes_s(RECORDING, CONFIG, 3) < 60


def test_the_published_load_is_that_of_the_issue():
    plan = BenchmarkPlan()
    assert (plan.size_px, plan.events, plan.planes) == ((1280, 720), 10_000_000, 100)
    assert plan.rounds >= 5
    assert len(plan.config("cpu").methods) == 8


class TestFrames:
    @pytest.fixture
    def ran(self, monkeypatch):
        """Replaces the programs that draw; keeps what they were started with."""
        started = []

        def answers(stdout, returncode=0, stderr=""):
            def run(command, env, **_):
                started.append((command, env))
                return subprocess.CompletedProcess(command, returncode, stdout, stderr)

            monkeypatch.setattr(gpu_frames.subprocess, "run", run)
            return started

        return answers

    def drawn(self, kind="classic", where="software", **chosen):
        return gpu_frames._drawn(kind, where, "davis346", 0.1, chosen)

    def test_a_rate_is_read_among_what_drivers_say(self, ran, monkeypatch):
        monkeypatch.setenv("MUJOCO_GL", "egl")
        started = ran('FEngine\n\n{"per_s": 12.5, "drawn_by": "mujoco 4 classic, llvmpipe"}\nbye\n')
        found = self.drawn(MUJOCO_GL="osmesa")
        assert (found.per_s, found.drawn_by) == (12.5, "mujoco 4 classic, llvmpipe")
        ((arguments, environment),) = started
        program, *rest = arguments[1:]
        assert rest == ["classic", "davis346", "0.1"]
        assert Path(program).is_file()
        assert environment["MUJOCO_GL"] == "osmesa"

    def test_the_device_that_vulkan_selects_is_named(self, ran):
        ran(
            "Selected physical device 'NVIDIA H200' from 2\n"
            '{"per_s": 900.0, "drawn_by": "filament"}'
        )
        found = self.drawn("filament", "GPU")
        assert (found.per_s, found.drawn_by) == (900.0, "filament: NVIDIA H200")

    @pytest.mark.parametrize(
        ("apart", "faults"),
        [((0.0, 0.0), 0), ((9e-7, 9e-7), 0), ((2e-6, 0), 1), ((0, 2e-6), 1), ((np.nan, 0), 1)],
    )
    def test_a_shader_that_disagrees_with_the_kernels_is_wrong(self, ran, apart, faults):
        ran(json.dumps({"per_s": 90.0, "drawn_by": "llvmpipe", "apart": apart}))
        found = self.drawn("shader")
        assert len(found.faults()) == faults
        drawn = [asdict(found), asdict(replace(found, kind="kernels", apart=None))]
        first, second = gpu_tables._frames({"frames": {"drawn": drawn}}).splitlines()[2:4]
        assert f"| {apart[0]:.2g}, {apart[1]:.2g} |" in first
        assert "| – |" in second

    @pytest.mark.parametrize(("where", "by"), [("GPU", "llvmpipe"), ("software", "NVIDIA H200")])
    def test_nothing_stands_under_another_ones_name(self, ran, where, by):
        ran(json.dumps({"per_s": 1.0, "drawn_by": by}))
        found = self.drawn(where=where)
        assert (found.per_s, found.drawn_by) == (None, f"drawn by {by} instead")

    def test_a_crash_is_a_reason(self, ran):
        ran("", -11, "")
        assert self.drawn() == gpu_frames.Drawn(
            "classic", "software", "davis346", None, "exit -11: silent"
        )
        ran("{broken", 1, "Traceback\nValueError: no")
        assert self.drawn().drawn_by == "exit 1: ValueError: no"

    def test_without_a_gpu_only_software_draws(self, monkeypatch):
        monkeypatch.setattr(gpu_frames.choice, "has_gpu", lambda: False)
        assert {gpu_frames._environment(kind, "GPU") for kind in gpu_frames.KINDS} == {
            "there is no GPU"
        }

    def test_a_gpu_with_an_egl_draws_by_it(self, monkeypatch):
        monkeypatch.setattr(gpu_frames.choice, "has_gpu", lambda: True)
        choices = {"works": gpu_frames.choice.Choice("egl", {"A": "b"}),
                   "software": gpu_frames.choice.Choice("egl", {}, "a note")}  # fmt: skip
        for name, wanted in (
            ("works", {"MUJOCO_GL": "egl", "A": "b"}),
            ("software", "the GPU offers no EGL"),
        ):
            monkeypatch.setattr(gpu_frames.choice, "choose", lambda _, name=name: choices[name])
            assert gpu_frames._environment("float", "GPU") == wanted
        assert gpu_frames._environment("filament", "GPU") == {}


# The kernel's own generator, as slowly and plainly as can be.
ATOMICS = """
import json
import numpy as np
from gpu_atomics import add_at_random, atomic_rates, cuda
from gpu_plan import QUICK
def twin(cells, threads, repeats):
    out = np.zeros(cells, np.int64)
    for thread in range(threads):
        state = thread * 2654435761 % 2**32
        state ^= state // 2**15
        for _ in range(repeats):
            state = (state * 1664525 + 1013904223) % 2**32
            out[state * cells // 2**32] += 1
    return out
for dtype in (np.int64, np.float32):
    cells = cuda.to_device(np.zeros(61, dtype))
    add_at_random[3, 5](cells, 7, dtype(1))
    np.testing.assert_array_equal(cells.copy_to_host(), twin(61, 15, 7))
rates = atomic_rates(QUICK, 4096)
assert [(r.kind, r.grid, r.grid_bytes) for r in rates] == [
    ("int64", "L2", 2048), ("int64", "DRAM", 4096),
    ("float32", "L2", 2048), ("float32", "DRAM", 4096)]
assert all(r.right and r.per_s > 0 for r in rates)
"""


def test_atomic_additions_equal_their_twin_on_the_simulator():
    done = program(code=ATOMICS, NUMBA_ENABLE_CUDASIM="1")
    assert done.returncode == 0, done.stderr


@pytest.mark.slow
def test_the_whole_script_on_the_simulator(tmp_path):
    path = tmp_path / "report.json"
    done = program("--quick", "--out", str(path), NUMBA_ENABLE_CUDASIM="1")
    assert done.returncode == 0, done.stderr
    found = json.loads(path.read_text())
    assert found["machine"]["gpu"]["simulated"] is True
    assert not [
        name for name, part in found["parts"].items() if "skipped" in part or "failed" in part
    ]
    drawn = found["parts"]["frames"]["drawn"]
    assert {one["kind"] for one in drawn} == {*gpu_frames.KINDS, *gpu_frames.FINE_KINDS}
    assert all((one["per_s"] is None) != (one["drawn_by"].startswith("mujoco")) for one in drawn)
