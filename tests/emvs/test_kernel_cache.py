"""Compiled code belongs to the version of all the code that it was made from."""

import ast
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from functools import cache

import pytest

from eventsweep.emvs.utils import kernel_cache
from places import HAS_PLUGINS, ROOT
from tiers import often

PACKAGES = ("emvs", "sim", "eval", "plugins") if HAS_PLUGINS else ("emvs", "sim", "eval")

FLAGS = {"nnan", "ninf", "nsz", "arcp", "contract", "afn", "reassoc", "fast"}  # LLVM's
FOLD = """
import numpy as np
from eventsweep.emvs.dsi.maxima import FocusPeak
peak = FocusPeak(4, 3, "variance", 0.3)
peak.update(np.arange(12, dtype=np.float32).reshape(1, 3, 4) ** 2)
print(peak.maximum().value.tolist())
"""
VARIANCE = """
import numpy as np
from eventsweep.emvs.dsi.focus_kernels import PAIR
from eventsweep.emvs.dsi.maxima import FocusPeak
from eventsweep.emvs.utils.vectors_kernels import aligned
peak = FocusPeak(PAIR, 3, "variance", 0.3)
peak.update(np.arange(3 * PAIR, dtype=np.float32).reshape(1, 3, PAIR) ** 2)
print(aligned(2).tolist(), peak.maximum().value.tolist())
"""
PIXELS = """
import numpy as np
from eventsweep.sim.sensor.pixels import Pixels
from eventsweep.sim.sensor.pixels import Randomness
from eventsweep.sim.sensor_presets import SensorParameters
pixels = Pixels((1, 2), (0.2, 0.2), 1e-3, SensorParameters(), Randomness(0, 0))
pixels.start(np.array([[0.2, 0.6]], np.float32))
for k, frame in enumerate(([0.7, 0.2], [0.25, 0.7])):
    batch = pixels.step(np.array([frame], np.float32), 1000 * k, 1000 * k + 1000)
    print(batch.pixel.tolist(), batch.t_us.tolist(), batch.p.tolist())
"""
CARRIED = """
import numpy as np
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.sim.compensation.fine_frame import FineFrame
from eventsweep.sim.compensation.interval import Passage, interval_between
from eventsweep.sim.rendering.base import Frame, Samples
light = (0.5 + 0.4 * np.sin(np.arange(30 * 74).reshape(30, 74) / 7)).astype(np.float32)
poses, rho = [np.eye(4), np.eye(4), np.eye(4)], np.full((30, 74), 0.5, np.float32)
rho[:, 14:18] = 2
poses[1][0, 3], poses[2][0, 3] = 0.2, 0.5
seen = light[12:18:2, 12:62:2], np.full((3, 25), 2, np.float32)
frames = [FineFrame(Frame(*seen, Samples(np.roll(light, k, 1), rho)), 2, 4.0) for k in (0, 3)]
passage = Passage(Camera(25, 3, 8, 8, 12, 1), *frames, interval_between((0, 9000), poses, (15, 37)))
assert len(passage.layered.layers.number)
print([picture.tolist() for picture in passage.pictures([3000, 6000])])
"""
LINES = """
import numpy as np
from eventsweep.plugins.track.odometry.registration.views import LineFields
from eventsweep.plugins.track.odometry.registration.residuals_kernels import map_to_events
fields = LineFields([(160, 120)], 1)
fields.begin()
fields.fill(0, np.c_[np.arange(50, 110, 0.25), np.full(240, 60.2), np.ones(240)], 240, 1)
H, g, lens = np.zeros((6, 6)), np.zeros(6), np.array([130, 130, 79.5, 59.5])
found = map_to_events(
    np.array([[0.02, 0.0, 1.3]]), np.array([[0.0, 1.0]]), np.eye(4), lens, np.array([160.0, 120.0]),
    fields.places[0, 0], fields.drawing, fields.field, 1e9, 5.0, H, g)
print(found, H.tolist(), g.tolist())
"""
EQUATIONS = """
import numpy as np
from eventsweep.plugins.track.odometry.registration.events_kernels import compensate
from eventsweep.plugins.track.odometry.registration.views import LineFields
from eventsweep.plugins.track.odometry.registration.gauss_newton_kernels import equations
out, eye = np.zeros((1, 3)), np.eye(4)
twist, lens, size = np.array([1.0, 0, 0, 0, 0, 0]), np.array([9.0, 9, 4, 3]), np.array([9.0, 7])
found = compensate(np.array([[5.0, 3.0, 0.1]]), 1, np.ones((7, 9)), 1.0, twist, lens, size, out)
print(found, out.tolist())
fields = LineFields([(9, 7)], 1)
fields.begin()
fields.fill(0, np.c_[np.arange(1, 8, 0.25), np.full(28, 3.2), np.ones(28)], 28, 1)
lines = fields.places[0, 0], fields.drawing, fields.field
scratch = np.eye(4), np.eye(4), np.zeros(6), np.zeros((12, 12)), np.zeros(12)
H, g, fit = np.zeros((12, 12)), np.zeros(12), np.zeros(6)
across, lens_of = np.array([[0.0, 1.0]]), (eye, eye, np.eye(6), lens, size)
event = np.array([[5.0, 3.0, 0.01, 0.0, 1.0, 1 / 9, 0.0, 1.0]])
equations((event, 1), np.array([[0.1, 0.0, 1.0]]), across, lines, lines, 0, lens_of, eye, eye,
          twist, scratch, H, g, fit)
print(fit.tolist(), g.tolist())
"""
ALIGNED = """
from eventsweep.emvs.utils.vectors_kernels import aligned
print(aligned(2).tolist())
"""
DRAWN = """
import mujoco
import numpy as np
from eventsweep.plugins.raster.renderer import RasterRenderer
from eventsweep.sim.rigs import rig
spec = mujoco.MjSpec.from_string('''<mujoco><asset>
  <texture name="flat" type="2d" builtin="checker" rgb1="1 .2 .2" width="64" height="64"/>
  <texture name="cube" type="cube" builtin="gradient" rgb1="1 1 .2" width="64" height="64"/>
  <material name="flat" texture="flat" texrepeat="3 2"/><material name="cube" texture="cube"/>
</asset><worldbody><light pos=".5 -.5 0" dir="0 0 1"/>
  <geom type="plane" size="2 2 .1" pos="0 0 3" euler="170 20 0" material="flat"/>
  <geom type="box" size=".3 .2 .3" pos=".1 0 1.5" euler="20 30 0" material="cube"/>
</worldbody></mujoco>''')
with RasterRenderer(spec, rig("oblique"), 1, (0.2, 9.0)) as drawn:
    seen = drawn.frame(0, np.eye(4))
    print(float(seen.intensity.sum()), float((1 / seen.nearest_depth_m).sum()))
"""
STAGE = f"""
import contextlib, io
import eventsweep.emvs.dsi.focus_kernels
def code(parameters):
    return (), ()
def run(parameters, inputs, out):
    with contextlib.redirect_stdout(io.StringIO()) as text:
        exec({FOLD!r}, {{}})
    (out / "result.json").write_text(text.getvalue())
"""
JOB = """
from eventsweep.eval.jobs.job import Job, do
done = do(Job("fold", "fold_stage", {}), "jobs")
print(done.found, done.code, done.text)
"""
LOADED = """
import sys
from eventsweep.emvs.utils import kernel_cache
kernel_cache._PATIENCE_S = float(sys.argv[2])
kernel = kernel_cache.VerifiedKernels(sys.argv[1], "kernel", 0)
print("asks", flush=True)
print(kernel.load("signature"), flush=True)
sys.stdin.read()
"""
# The caller that shows an edit in a file, and the edit where adding 1 to what is returned is none.
CALLERS = {
    "emvs/dsi/fusion_kernels.py": FOLD,
    "emvs/utils/vectors_kernels.py": VARIANCE, "sim/sensor/esim_kernels.py": PIXELS,
    "sim/compensation/box_sums_kernels.py": CARRIED,
    "sim/compensation/edge_reach_kernels.py": CARRIED,
    "sim/compensation/layer_kernels.py": CARRIED,
    "sim/compensation/path_kernels.py": CARRIED,
}  # fmt: skip
if HAS_PLUGINS:
    CALLERS |= {
        "plugins/track/odometry/registration/lines_kernels.py": LINES,
        "plugins/track/odometry/registration/residuals_kernels.py": EQUATIONS,
        "plugins/raster/light_kernels.py": DRAWN,
        "plugins/raster/shading_kernels.py": DRAWN,
        "plugins/raster/visibility_kernels.py": DRAWN,
    }
EDITS = {
    "box_sums": ("float(total * share)", "float(total * share + 0.1)"),
    "add_points": ("np.float32(v - j)", "np.float32(v - j + 0.2)"),
    "later": ("x + dt_s * ax", "y + dt_s * ax"),
    "events_to_map": ("r = n_u * (u - (fx", "r = 0.5 + n_u * (u - (fx"),
    "line_at": ("- lines[cell, 3]", "- lines[cell, 3] + 0.1"),
    "map_to_events": ("closeness += close\n        weight", "closeness -= close\n        weight"),
    "moved": ("T[1, 2] * z + T[1, 3]", "T[1, 2] * z + T[1, 3] + x"),
    "aligned": ("np.zeros(count", "np.ones(count"),
    "larger": ('fcmp_ordered(">"', 'fcmp_ordered("<"'),
    "load": ("load(place, align=4)", "fneg(builder.load(place, align=4))"),
    "plus": ("[args[1], args[2], args[0]]", "[args[1], args[1], args[0]]"),
    "splat": ("everywhere(builder, args[0]", "everywhere(builder, builder.fadd(args[0], args[0])"),
    "store": ("builder.store(args[2],", "builder.store(builder.fneg(args[2]),"),
    "fold_row": ("if value > top", "if value < top"),
    "begin_layers": (
        "layers.low[k, m], layers.high[k, m]",
        "layers.low[k, m] + 0.3, layers.high[k, m] + 0.3",
    ),
    "textured": ("near[k] += share *", "near[k] += 9 + share *"),
    "within_reach": ("if inside and away", "if inside and i % 2 and away"),
    "paths_of_row": ("rho_b[y], ways[0], lens", "rho_b[y], ways[0] + 0.1, lens"),
}


def tree(file):
    return ast.parse(file.read_text(encoding="utf-8"))


def compiled(file):
    """Functions of a file that are compiled."""
    found = [node for node in ast.walk(tree(file)) if isinstance(node, ast.FunctionDef)]
    return [f for f in found if any(is_compiler(d) for d in f.decorator_list)]


def is_compiler(node):
    called = node.func if isinstance(node, ast.Call) else node
    return any(word in ast.unparse(called) for word in ("jit", "intrinsic"))


def taken(file):
    """What a file imports from the project by name: name -> file."""
    nodes = [node for node in tree(file).body if isinstance(node, ast.ImportFrom) and node.module]
    ours = [node for node in nodes if node.module.startswith("eventsweep.")]
    return {
        alias.asname or alias.name: source(f"{node.module}.{alias.name}")
        for node in ours
        for alias in node.names
    }


def source(name):
    """The file of a module, or of the module that has this name."""
    for dotted in (name, name.rpartition(".")[0]):
        file = ROOT / f"{dotted.replace('.', '/')}.py"
        if file.is_file():
            return file.resolve()
    return (ROOT / name.replace(".", "/") / "__init__.py").resolve()


def kernel_files():
    return [file.resolve() for file in kernel_cache.kernel_files()]


def borrowed():
    """(function, its file) of compiled functions that a kernel of the CPU in another file calls."""
    found = set()
    for file in kernel_files():
        if "cuda" not in file.parts:
            for name, origin in taken(file).items():
                if name in [f.name for f in compiled(origin)]:
                    found.add((name, origin.relative_to(ROOT).as_posix()))
    return sorted(found)


def python(code, folder, cache):
    known = {"PYTHONPATH": str(folder), "NUMBA_CACHE_DIR": str(cache)}
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=folder, timeout=300,
        env=os.environ | known, check=True,
    )  # fmt: skip
    return done.stdout


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the packages and a cache, and what a caller says of the code as it is."""
    folder = tmp_path_factory.mktemp("copy")
    for package in (*PACKAGES, "eventsweep"):
        shutil.copytree(
            ROOT / package, folder / package, symlinks=True,
            ignore=shutil.ignore_patterns("__pycache__"),
        )  # fmt: skip
    return folder, cache(lambda file: python(CALLERS[file], folder, folder / "cache"))


def edited(text, name):
    """The file's text after an edit of one function that keeps every line where it was."""
    if name in EDITS:
        return text.replace(*EDITS[name])
    function = next(f for f in ast.parse(text).body if getattr(f, "name", None) == name)
    line = next(n.lineno for n in ast.walk(function) if isinstance(n, ast.Return)) - 1
    lines = text.splitlines(keepends=True)
    lines[line] = lines[line].replace("return ", "return 1 + ")
    return "".join(lines)


def test_every_borrowed_function_is_known():
    assert borrowed()
    assert {file for _, file in borrowed()} <= set(CALLERS)


@pytest.mark.slow
@pytest.mark.parametrize(("name", "file"), borrowed())
def test_an_edit_in_another_file_is_seen(copy, name, file):
    folder, before = copy
    path = folder / file
    text, told = path.read_text(encoding="utf-8"), before(file)
    path.write_text(edited(text, name), encoding="utf-8")
    try:
        assert path.read_text(encoding="utf-8") != text
        assert python(CALLERS[file], folder, folder / "cache") != told
    finally:
        path.write_text(text, encoding="utf-8")
    assert python(CALLERS[file], folder, folder / "cache") == told


@pytest.mark.slow
def test_no_job_is_kept_that_older_kernels_made(copy):
    folder, before = copy
    (folder / "fold_stage.py").write_text(STAGE, encoding="utf-8")
    path = folder / "emvs/dsi/fusion_kernels.py"
    text = path.read_text(encoding="utf-8")
    found, code, result = python(JOB, folder, folder / "cache").split(maxsplit=2)
    assert (found, result.strip()) == ("False", before("emvs/dsi/fusion_kernels.py").strip())
    path.write_text(edited(text, "fold_row"), encoding="utf-8")
    try:
        found, other_code, other_result = python(JOB, folder, folder / "cache").split(maxsplit=2)
        assert found == "False"
        assert other_code != code
        assert other_result != result
        fresh = python(FOLD, folder, folder / "fresh")
        assert other_result.strip() == fresh.strip()
    finally:
        path.write_text(text, encoding="utf-8")


def test_every_file_with_compiled_functions_counts():
    files = set(kernel_files())
    sources = [file for package in PACKAGES for file in (ROOT / package).rglob("*.py")]
    assert {file for file in sources if compiled(file)} <= files


def test_compiled_functions_take_names_only_from_files_that_count():
    files = set(kernel_files())
    for file in files:
        outside = {name for name, origin in taken(file).items() if origin not in files}
        for function in compiled(file):
            body = [node for part in function.body for node in ast.walk(part)]
            names = {node.id for node in body if isinstance(node, ast.Name)}
            assert not names & outside, f"{file}, {function.name}"


def test_every_file_with_compiled_functions_names_the_cache_first():
    for file in kernel_cache.kernel_files():
        if compiled(file) and "cuda" not in file.parts:
            names = [a.name for n in tree(file).body if isinstance(n, ast.Import) for a in n.names]
            assert "eventsweep.emvs.utils.runtime" in names, file


@pytest.fixture
def config(monkeypatch):
    """Numba's settings, without a chosen folder, restored afterwards."""
    settings = kernel_cache.numba.config
    monkeypatch.setattr(settings, "CACHE_DIR", "")
    return settings


def test_the_cache_lies_in_the_users_cache_folder(config, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    folder = kernel_cache.use_kernel_cache()
    assert folder.parent == tmp_path / "eventsweep-kernels"
    assert str(folder) == config.CACHE_DIR


def test_a_chosen_folder_is_kept(config, tmp_path, monkeypatch):
    monkeypatch.setattr(config, "CACHE_DIR", str(tmp_path / "mine"))
    folder = kernel_cache.use_kernel_cache()
    assert folder == tmp_path / "mine" / f"eventsweep-{kernel_cache.kernel_version()}"


def test_a_home_that_cannot_be_written_to_is_no_fault(config, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    assert kernel_cache.use_kernel_cache().parent.parent == tmp_path


@pytest.mark.parametrize("plant", [lambda p: p.mkdir(), lambda p: p.symlink_to("/")])
def test_code_is_not_run_from_a_folder_that_others_can_fill(config, tmp_path, monkeypatch, plant):
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file" / "cache"))
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    planted = tmp_path / f"eventsweep-kernels-{os.getuid()}"
    plant(planted)
    if not planted.is_symlink():
        planted.chmod(0o777)
    with pytest.raises(kernel_cache.InputError, match="set NUMBA_CACHE_DIR"):
        kernel_cache.use_kernel_cache()


def made(home, digit, days, mark=True):
    folder = home / f"eventsweep-{digit * 16}"
    (folder / "dsi_0").mkdir(parents=True)
    if mark:
        (folder / "last-used").touch()
        then = time.time() - days * 86_400
        os.utime(folder / "last-used", (then, then))
    return folder


def test_old_versions_go_and_nothing_else(config, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    home = tmp_path / "eventsweep-kernels"
    old, unmarked = made(home, "a", 40), made(home, "b", 40, mark=False)
    recent = [made(home, digit, 2 + k) for k, digit in enumerate("123456789")]
    busy = [made(home, digit, 0.1) for digit in "cd"]
    (home / "mine").mkdir()
    (home / f"eventsweep-{'e' * 16}").symlink_to(tmp_path)
    home.chmod(0o700)
    present = kernel_cache.use_kernel_cache()
    kept = {present, unmarked, *recent[:5], *busy, home / "mine", home / f"eventsweep-{'e' * 16}"}
    assert set(home.iterdir()) == kept
    assert not old.exists()


@pytest.mark.parametrize("damage", often(["flip"], ["flip", "cut", "empty"]))
def test_a_damaged_kernel_is_compiled_anew(tmp_path, damage):
    expected = python(ALIGNED, ROOT, tmp_path / "cache")
    kernels = sorted((tmp_path / "cache").glob("*/*/*.nb[ci]"))
    assert kernels
    for path in kernels:
        content = bytearray(path.read_bytes())
        content[len(content) // 2] ^= 1
        path.write_bytes({"cut": content[:-9], "flip": content, "empty": b""}[damage])
    assert python(ALIGNED, ROOT, tmp_path / "cache") == expected
    again = sorted((tmp_path / "cache").glob("*/*/*.nb[ci]"))
    assert any(kernel_cache._verified(path) is not None for path in again)


@pytest.fixture
def loading(tmp_path):
    """Starts processes that ask for a kernel, and have asked."""
    (tmp_path / "dsi").mkdir()
    (tmp_path / "last-used").touch()
    started = []

    def start(patience_s):
        started.append(
            subprocess.Popen(
                [sys.executable, "-c", LOADED, tmp_path / "dsi", str(patience_s)],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, cwd=ROOT,
            )
        )  # fmt: skip
        assert started[-1].stdout.readline() == "asks\n"
        return started[-1]

    yield start
    for process in started:
        process.communicate()


def test_a_kernel_that_another_process_compiles_is_waited_for(tmp_path, loading):
    kernel = kernel_cache.VerifiedKernels(str(tmp_path / "dsi"), "kernel", 0)
    assert kernel.load("signature") is None
    waiting = loading(0)
    kernel.save("signature", "compiled")
    assert waiting.stdout.readline() == "compiled\n"


HOLDER = """
import sys, time
from eventsweep.emvs.utils import kernel_cache
kernel = kernel_cache.VerifiedKernels(sys.argv[1], "kernel", 0)
print(kernel.load("signature"), flush=True)
time.sleep(600)
"""


@pytest.mark.parametrize("stopped", [False, True])
def test_who_compiles_for_long_is_waited_for_and_who_is_stopped_is_not(tmp_path, loading, stopped):
    """Even if it gets no time of a processor: so a busy machine would compile everything twice."""
    command = [sys.executable, "-c", HOLDER, str(tmp_path / "dsi")]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=ROOT) as holder:
        assert holder.stdout.readline() == "None\n"
        if stopped:
            holder.send_signal(signal.SIGSTOP)
        waiting = loading(0.5)
        ready, _, _ = select.select([waiting.stdout], [], [], 3.0 if not stopped else 60.0)
        assert bool(ready) == stopped
        holder.kill()
        assert waiting.stdout.readline() == "None\n"


FAILING = """
import sys
import eventsweep.emvs.utils.runtime
from numba import njit
from numba.core.errors import TypingError
@njit(cache=True)
def kernel(number):
    return number.nothing
try:
    kernel(1)
except TypingError:
    print("failed", flush=True)
sys.stdin.read()
"""


def test_who_fails_to_compile_lets_others_try(tmp_path):
    (tmp_path / "failing.py").write_text(FAILING, encoding="utf-8")
    command = [sys.executable, str(tmp_path / "failing.py")]
    known = os.environ | {"PYTHONPATH": str(ROOT), "NUMBA_CACHE_DIR": str(tmp_path)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, env=known) as first:
        assert first.stdout.readline() == "failed\n"
        try:
            second = subprocess.check_output(command, input="", text=True, env=known, timeout=120)
            assert second == "failed\n"
        finally:
            first.kill()


def test_who_dies_while_it_compiles_stands_in_nobodys_way(tmp_path, loading):
    first = loading(60)
    assert first.stdout.readline() == "None\n"
    second = loading(60)
    first.kill()
    assert second.stdout.readline() == "None\n"


def test_no_simulation_rounds_as_it_was_compiled():
    """Where sums may be reordered or joined with products, each processor has other events.

    So had a process that compiled and one that loaded from the cache.
    """
    files = [file for file in kernel_files() if "sim" in file.parts]
    flags = {
        flag
        for file in files for node in ast.walk(tree(file))
        if isinstance(node, ast.Constant) and (flag := node.value) in FLAGS
    }  # fmt: skip
    assert flags == {"nnan", "nsz"}
    assert not [file for file in files if "fastmath=True" in file.read_text("utf-8")]


def test_what_runs_for_each_pixel_counts_no_holders_of_arrays():
    """Each array of a tuple that is handed on takes two locked instructions: half of all time."""
    files = [
        *ROOT.glob("sim/compensation/*_kernels.py"),
        ROOT / "sim/sensor/compensated_kernels.py",
    ]
    functions = [function for file in files for function in compiled(file)]
    makers, before = {"empty", "zeros", "full", "astype"}, set()
    while makers != before:
        before = set(makers)
        makers |= {f.name for f in functions if makers & called(f)}
    assert len(makers) < len(functions) / 2
    for function in functions:
        says = " ".join(map(ast.unparse, function.decorator_list))
        assert function.name in makers or "inline='always'" in says or "**NO_ARRAYS" in says, (
            f"{function.name} makes no array: say **NO_ARRAYS"
        )


def called(function):
    nodes = [node.func for node in ast.walk(function) if isinstance(node, ast.Call)]
    return {getattr(node, "attr", getattr(node, "id", "")) for node in nodes}
