"""Which graphics library is chosen, with drivers that work, draw in software, crash or hang."""

import os
import re
import subprocess
import sys
from typing import NamedTuple

import pytest

from eventsweep import scenes
from eventsweep.eval.jobs.job import ONE_OF_MANY
from eventsweep.eval.stages import simulate as stage_simulate
from eventsweep.sim import graphics
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import choice
from eventsweep.sim.graphics.choice import (
    DEVICE,
    NOTE,
    Choice,
    Driver,
    choose,
    equal_devices,
    probe,
)
from eventsweep.sim.rendering import drawing
from eventsweep.sim.rigs import rig
from eventsweep.sim.simulate import simulate
from places import ROOT
from refusals import refused

BOTH = ("egl", "osmesa")
GPU = Driver("NVIDIA Corporation", "NVIDIA H200/PCIe/SSE2", "4.6.0 NVIDIA 580.0", devices=2)
SOFTWARE = Driver("Mesa/X.org", "llvmpipe (LLVM 15.0.6, 256 bits)", "4.5 Mesa 22.3.6")
VENDOR = "__EGL_VENDOR_LIBRARY_FILENAMES"
DRIVER_FILE = "usr/local/nvidia/share/glvnd/egl_vendor.d/10_nvidia.json"


@pytest.fixture(autouse=True)
def _fresh(monkeypatch):
    for name in (VENDOR, "__EGL_VENDOR_LIBRARY_DIRS", DEVICE, NOTE, "MUJOCO_GL"):
        monkeypatch.setenv(name, "")  # so that what a test adopts is undone
        monkeypatch.delenv(name)
    known = choose, choice._probed, drawing.default_renderer
    for found in known:
        found.cache_clear()
    yield
    for found in known:
        found.cache_clear()


@pytest.fixture
def machine(tmp_path):
    """The root of a machine with an NVIDIA card."""
    for name in ("dev/nvidiactl", DRIVER_FILE):
        file = tmp_path / "machine" / name
        file.parent.mkdir(parents=True)
        file.touch()
    return tmp_path / "machine"


@pytest.fixture
def program(tmp_path, monkeypatch):
    """Replaces the program that tries a driver by one that does as told; counts its runs."""
    path, runs = tmp_path / "program.py", tmp_path / "runs"

    def does(body):
        path.write_text(f"import json, os, sys, time\nopen({str(runs)!r}, 'a').write('.')\n{body}")
        return lambda: len(runs.read_text()) if runs.exists() else 0

    monkeypatch.setattr(choice, "_PROBE", path)
    return does


def prints(driver):
    facts = {"vendor": driver.vendor, "renderer": driver.renderer, "version": driver.version}
    return f"print(json.dumps({facts | {'devices': driver.devices}!r}))\n"


def test_without_a_gpu_nothing_is_tried(tmp_path, program):
    runs = program("sys.exit(1)")
    assert choose(BOTH, tmp_path) == Choice("egl")
    assert choose(("osmesa",), tmp_path) == Choice("osmesa")
    assert runs() == 0


def test_a_gpu_that_draws_is_taken_and_tried_once(machine, program):
    runs = program(prints(GPU))
    assert choose(BOTH, machine) == Choice("egl")
    assert probe("egl") == GPU
    assert runs() == 1


def test_a_driver_beside_the_usual_places_is_found_and_passed_on(machine, program, monkeypatch):
    program(f"if os.environ.get({VENDOR!r}):\n    {prints(GPU)}else:\n    {prints(SOFTWARE)}")
    chosen = choose(BOTH, machine)
    assert chosen == Choice("egl", {VENDOR: str(machine / DRIVER_FILE)})
    chosen.adopt()
    assert (os.environ["MUJOCO_GL"], os.environ[VENDOR]) == ("egl", str(machine / DRIVER_FILE))
    # What was found without the variable no longer counts.
    assert probe("egl") == GPU


@pytest.mark.parametrize("own", [True, False])
def test_the_users_own_driver_file_stays_and_egl_in_software_beside_a_gpu_is_told(
    machine, program, monkeypatch, own
):
    if own:
        monkeypatch.setenv(VENDOR, "/their/own.json")
    program(prints(SOFTWARE))
    chosen = choose(BOTH, machine)
    assert (chosen.backend, dict(chosen.environment)) == ("egl", {})
    assert own or chosen.note == "the GPU offers no EGL here"


@pytest.mark.parametrize(
    ("body", "reason"),
    [
        ("os.kill(os.getpid(), 11)", "SIGSEGV"),
        ("time.sleep(60)", "no answer within 0.5 s"),
        ("sys.exit('no driver\\nthe last line')", "the last line"),
        ("sys.exit(3)", "exit code 3"),
        ("print('hello')", "exit code 0"),
        ("print('[1]')", "exit code 0"),
        ("print(json.dumps({'vendor': 1}))", "exit code 0"),
        ("", "exit code 0"),
    ],
    ids=["crash", "hang", "error", "silent", "other words", "list", "half", "nothing"],
)
def test_a_driver_that_fails_takes_nobody_down(machine, program, monkeypatch, body, reason):
    monkeypatch.setattr(choice, "_LIMIT_S", 0.5 if "sleep" in body else 60.0)
    program(body)
    chosen = choose(BOTH, machine)
    assert chosen.backend == "osmesa"
    assert reason in chosen.note
    refused(["libosmesa6", re.escape(reason)], choose, ("egl",), machine)


def test_the_users_word_wins_without_a_trial(program, monkeypatch):
    runs = program("os.kill(os.getpid(), 11)")
    monkeypatch.setattr(choice, "has_gpu", lambda root=None: True)
    monkeypatch.setattr(graphics, "_installed", lambda name: True)
    for name in BOTH:
        monkeypatch.setenv("MUJOCO_GL", name.upper())
        assert graphics.backend() == name
    assert runs() == 0


def test_processes_that_are_started_later_inherit_the_choice(monkeypatch):
    installed = next(filter(graphics._installed, BOTH), None)
    if installed is None:
        pytest.skip("neither EGL nor OSMesa is installed")
    Choice(installed, {VENDOR: "x"}, "because").adopt()
    said = "from eventsweep.sim import graphics; print(graphics.backend(), graphics.note())"
    assert in_process(said) == f"{installed} because\n"


@pytest.mark.parametrize(("name", "hardware"), [
    ("NVIDIA H200/PCIe/SSE2", True), ("AMD Radeon RX 7900 (radeonsi, navi31)", True),
    ("Mesa Intel(R) UHD Graphics 620 (KBL GT2)", True), ("zink Vulkan 1.3(NVIDIA A10)", True),
    ("llvmpipe (LLVM 15.0.6, 256 bits)", False), ("softpipe", False),
    ("Software Rasterizer", False), ("zink Vulkan 1.3(llvmpipe (LLVM 17))", False),
    ("D3D12 (Microsoft Basic Render Driver)", False), ("ANGLE (SwiftShader Device)", False),
])  # fmt: skip
def test_software_is_known_by_its_name(name, hardware):
    assert Driver("", name, "4.5").hardware is hardware


def test_the_width_of_vectors_is_no_identity():
    wide = Driver(SOFTWARE.vendor, SOFTWARE.renderer.replace("256", "512"), SOFTWARE.version)
    assert (
        wide.identity == SOFTWARE.identity == "llvmpipe (LLVM 15.0.6), Mesa/X.org, 4.5 Mesa 22.3.6"
    )
    assert GPU.identity != SOFTWARE.identity


def test_only_equal_gpus_share_a_sequence(program, monkeypatch):
    other = Driver("NVIDIA Corporation", "NVIDIA A10/PCIe/SSE2", GPU.version)
    program(
        f"device = os.environ.get({DEVICE!r})\n"
        f"if device == '1':\n    {prints(other)}"
        f"elif device == '2':\n    sys.exit(1)\nelse:\n    {prints(GPU)}"
    )
    four = Driver(GPU.vendor, GPU.renderer, GPU.version, devices=4)
    assert equal_devices(four) == (0, 3)
    monkeypatch.setenv(DEVICE, "3")
    assert equal_devices(four) == ()


def test_one_gpu_or_software_is_not_divided(program):
    runs = program(prints(GPU))
    one = Driver(GPU.vendor, GPU.renderer, GPU.version)
    many = Driver(SOFTWARE.vendor, SOFTWARE.renderer, SOFTWARE.version, devices=3)
    assert equal_devices(one) == equal_devices(many) == ()
    assert runs() == 0


def test_a_note_reaches_who_simulates(tmp_path, monkeypatch):
    monkeypatch.setenv(NOTE, "the GPU sleeps")
    heard = []
    config = SimConfig(duration_s=0.002, supersample=1)
    simulate(scenes.load("planes"), rig("davis346"), config, 0, tmp_path / "s", notice=heard.append)
    assert heard[0].startswith("the GPU sleeps: drawn by ")


class Offered(NamedTuple):
    name: str
    module: str


OURS, THEIRS = Offered("ours", "eventsweep.plugins.ours"), Offered("theirs", "their.renderer")


@pytest.mark.parametrize(("driver", "offers", "taken"), [
    (None, [OURS, THEIRS], "ours"), (None, [THEIRS], "mujoco"), (None, [], "mujoco"),
    (GPU, [OURS, THEIRS], "mujoco"), (SOFTWARE, [OURS], "ours"), (SOFTWARE, [], "mujoco"),
])  # fmt: skip
def test_a_gpu_draws_with_mujoco_and_else_our_plug_in(program, monkeypatch, driver, offers, taken):
    runs = program(prints(driver or GPU))
    monkeypatch.setattr(choice, "_VENDOR_FILES", ())  # this machine's own driver is not tried
    monkeypatch.setattr(choice, "has_gpu", lambda root=None: driver is not None)
    monkeypatch.setattr(graphics, "has_gpu", lambda: driver is not None)
    monkeypatch.setattr(graphics, "_installed", lambda name: True)
    monkeypatch.setattr(drawing, "points", lambda group: offers)
    for _ in range(2):
        assert drawing.decided(SimConfig()).light.renderer == taken
    assert runs() == (driver is not None and OURS in offers)
    chosen = SimConfig(light={"renderer": "classic"})
    assert drawing.decided(chosen, "ours") is chosen


def test_who_has_a_gpu_that_draws_nothing_is_told(program, monkeypatch):
    program("os.kill(os.getpid(), 11)")
    monkeypatch.setattr(graphics, "has_gpu", lambda: True)
    monkeypatch.setattr(graphics, "_installed", lambda name: True)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    assert not graphics.gpu_draws()
    assert re.match(r"the GPU does not draw \(.*SIGSEGV", graphics.note())


def test_a_worker_that_draws_otherwise_refuses_the_job(tmp_path):
    planned = stage_simulate.sequence_parameters("planes", None, 0, {})
    planned |= {"change": {"light": 0.5}, "graphics": "softpipe, 1.0"}
    refused(
        "planned for the renderer softpipe", stage_simulate.run, planned, [], tmp_path, ONE_OF_MANY
    )
    assert not list(tmp_path.iterdir())


@pytest.fixture(params=BOTH)
def library(request):
    """A library that draws on this machine, whatever that is."""
    found = probe(request.param)
    if isinstance(found, str):
        pytest.skip(f"{request.param} does not draw here: {found}")
    return request.param, found


def in_process(code, *arguments, **environment):
    """What a program prints that was started with these variables."""
    kept = {name: text for name, text in os.environ.items() if name != "PYOPENGL_PLATFORM"}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments], env=kept | environment, text=True,
        capture_output=True, cwd=ROOT,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


SHOW = """
import sys
from eventsweep import scenes
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig
scene = scenes.load("planes")
with StereoRenderer(scene.spec(), rig("davis346"), 1, scene.depth_range_m) as renderer:
    print(renderer.description)
"""


@pytest.mark.slow
def test_the_trial_says_what_the_renderer_says(library):
    backend, found = library
    said = in_process(SHOW, MUJOCO_GL=backend)
    assert re.fullmatch(rf"mujoco \S+ classic, {backend}: {re.escape(found.identity)}\n", said)


def test_every_library_keeps_the_laws_of_the_renderer(library):
    """Depth against ray casting, known points and edges: the truth whatever draws."""
    laws = "import sys, pytest; sys.exit(pytest.main(sys.argv[1:]))"
    file = ROOT / "tests" / "sim" / "rendering" / "test_renderer.py"
    in_process(laws, "-q", "-p", "no:cacheprovider", str(file), MUJOCO_GL=library[0])
