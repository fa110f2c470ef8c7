"""What the core offers to plug-ins: every group of entry points, and the plug-in of the page."""

from __future__ import annotations

import logging
import sys
from dataclasses import replace
from importlib.metadata import EntryPoint
from types import SimpleNamespace

import numpy as np
import pytest

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.dsi import device
from eventsweep.emvs.dsi.backend import CpuBackend
from eventsweep.emvs.dsi.backprojection import CpuProjector
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.utils import plugins
from eventsweep.emvs.utils.cache import Cache
from eventsweep.eval import pipeline, trackers
from eventsweep.eval.config import Settings
from eventsweep.eval.scoring.predictions import NamedFolder
from eventsweep.eval.suite import packages, source
from eventsweep.eval.suite.definition import load
from packages import documented, install, run_with
from places import ROOT
from small_pair import small_sequence

PAGE = ROOT / "docs" / "architecture.md"
MODULE = "theirs_for_tests"
BROKEN = """[project]
name = "broken"
version = "1"
[project.entry-points."eventsweep.verbs"]
broken = "broken.eventsweep:verb"
map = "broken.taken:map"
"""


def offer(monkeypatch, place, **found):
    """Puts objects of a stranger behind the entry points that a module of the core reads."""
    stranger = SimpleNamespace(**found)
    monkeypatch.setitem(sys.modules, MODULE, stranger)
    points = tuple(EntryPoint(name, f"{MODULE}:{name}", "any") for name in found)
    for reader in {place, plugins}:
        monkeypatch.setattr(reader, "points", lambda _group: points)


@pytest.fixture(scope="module")
def sequence(tmp_path_factory):
    return small_sequence(tmp_path_factory.mktemp("small") / "seq")


def their_device(missing=None):
    used = []

    def backend(task, rays):
        used.append(len(rays))
        return CpuBackend(task, rays)

    return SimpleNamespace(
        missing=lambda: missing, name=lambda: "Theirs 3000", projector=CpuProjector,
        backend=backend, used=used,
    )  # fmt: skip


def test_a_device_of_others_computes_the_sweep(monkeypatch, sequence):
    theirs = their_device()
    offer(monkeypatch, device, mine=theirs)
    recording, config = open_recording(sequence), MapperConfig(methods=("Alg1/H",), planes=20)
    own, ours = (
        map_window(recording, config.model_copy(update={"device": name}))
        for name in ("mine", "cpu")
    )
    assert (own.device, ours.device) == ("Theirs 3000", "cpu")
    assert theirs.used
    for a, b in zip(own.depth_maps.values(), ours.depth_maps.values(), strict=True):
        np.testing.assert_array_equal(a.depth_m, b.depth_m)


def test_the_files_of_a_device_of_others_belong_to_the_key_of_its_maps(monkeypatch, tmp_path):
    """So an edit of the package maps again."""
    (tmp_path / "their_device.py").write_text("")
    monkeypatch.syspath_prepend(tmp_path)
    point = EntryPoint("mine", "their_device", "any")
    monkeypatch.setattr(device, "points", lambda _group: (point,))
    assert device.code_of_device("mine") == ((), (tmp_path / "their_device.py",))
    assert device.code_of_device("cpu") == ((), ())


@pytest.mark.parametrize(
    ("missing", "taken", "said"),
    [(None, "mine", "took the GPU Theirs 3000"), ("no driver", "cpu", "took the CPU: no driver")],
)
def test_auto_takes_a_device_of_others_where_it_can(monkeypatch, caplog, missing, taken, said):
    offer(monkeypatch, device, mine=their_device(missing))
    with caplog.at_level(logging.WARNING):
        assert device.choose_device("auto").kind == taken
    assert said in caplog.text


def test_auto_is_the_cpu_where_nobody_brings_another_device(monkeypatch, caplog):
    offer(monkeypatch, device)
    assert device.choose_device("auto") == device.CPU
    assert "no plug-in with another device is installed" in caplog.text


REFUSED = {
    "device": (lambda _: device.choose_device("tpu"), "unknown device 'tpu': choose from cpu"),
    "tracker": (lambda _: trackers.tracker("slam"), "unknown tracker 'slam': choose from true"),
    "sequences": (lambda folder: source.open_source(folder), "no installed plug-in can read"),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_nobody_brings_is_refused(monkeypatch, tmp_path, what):
    for place in (device, trackers, source, plugins):
        offer(monkeypatch, place)
    call, words = REFUSED[what]
    with pytest.raises(InputError, match=words):
        call(tmp_path)


def test_one_that_cannot_be_loaded_is_named(monkeypatch):
    point = EntryPoint("mine", "nobody_has_this:thing", "any")
    monkeypatch.setattr(plugins, "points", lambda _group: (point,))
    with pytest.raises(InputError, match=r"its device \(mine = nobody_has_this:thing\) cannot"):
        device.choose_device("mine")


def test_a_tracker_of_others_is_chosen_by_name(monkeypatch):
    theirs = SimpleNamespace(track=lambda *_: None)
    offer(monkeypatch, trackers, slam=theirs)
    assert trackers.names() == ("true", "slam")
    assert trackers.tracker("slam") is theirs


def test_a_check_of_others_warns_before_mapping(monkeypatch, sequence, tmp_path):
    said = []
    offer(monkeypatch, plugins, mine=lambda recording, config: [f"{recording.name} is dark"])
    settings = Settings(map=MapperConfig(methods=("EMVS/cam0",), planes=10))
    pipeline.map_recording(sequence, tmp_path / "maps", settings, warn=said.append)
    assert said == ["small is dark"]


def test_sequences_come_from_whoever_knows_the_folder(monkeypatch, tmp_path):
    known = SimpleNamespace(facts=None)
    offer(monkeypatch, source, a=lambda _: None, b=lambda path: known if path == tmp_path else None)
    assert source.open_source(tmp_path) is known
    offer(monkeypatch, source, ours=lambda _: pytest.fail("asked first"), theirs=lambda _: known)
    assert source.open_source(tmp_path) is known


def test_predictions_are_unpacked_by_whoever_can(monkeypatch, tmp_path):
    suite, _ = load("quick")
    wanted = packages.Wanted(suite, ("planes",), (0,))
    asked = []

    def unpacked(given, about, cache):
        asked.append(about)
        return [one._replace(path=one.path / "unpacked") for one in given], {"Mine": {"cost": 1}}

    given, cache = NamedFolder(tmp_path, "Mine"), Cache(tmp_path / "cache")
    offer(monkeypatch, packages)
    assert packages.open_packages([f"Mine={tmp_path}"], wanted, cache) == ([given], {})
    wanted = replace(
        wanted, suite=suite.model_copy(update={"predictions": {"Mine": str(tmp_path)}})
    )
    offer(monkeypatch, packages, mine=unpacked)
    folders, stated = packages.open_packages((), wanted, cache)
    assert [one.path for one in folders] == [tmp_path / "unpacked"]
    assert (stated, asked) == ({"Mine": {"cost": 1}}, [wanted])


def test_points_of_a_plug_in_whose_folder_is_gone_are_left_out(monkeypatch):
    points = [
        EntryPoint("gone", "eventsweep.plugins.no_such_plug_in.verb:gone", "any"),
        EntryPoint("theirs", "their_package:verb", "any"),
    ]
    monkeypatch.setattr(plugins, "entry_points", lambda group: points)
    plugins.points.cache_clear()
    try:
        assert [point.name for point in plugins.points("eventsweep.any")] == ["theirs"]
    finally:
        plugins.points.cache_clear()


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """The plug-in that the page prints, and one whose verb cannot be imported."""
    folder = tmp_path_factory.mktemp("site")
    install(folder, *documented(PAGE, "## A plug-in of your own"))
    install(folder, BROKEN, "import no_such_module\n")
    (folder / "broken" / "taken.py").write_text("def map() -> None: ...\n")
    return folder


def test_the_documented_plug_in_works(site, sequence, tmp_path):
    done = run_with(site, tmp_path, "rate", str(sequence), "--least-hz", "1e6")
    said = "broken: its verb map is left out, there is one of that name"
    assert (done.returncode, done.stderr.splitlines()) == (1, [said])
    assert done.stdout.splitlines()[0].startswith("cam0: 40,")
    asked = ("map", str(sequence), "--out", "maps", "--method", "EMVS/cam0", "--quiet")
    assert "check: cam0 sends 40" in run_with(site, tmp_path, *asked).stderr
    assert "Print the event rate of every camera." in run_with(site, tmp_path, "--help").stdout


def test_a_verb_that_cannot_be_loaded_disturbs_no_other(site, tmp_path):
    done = run_with(site, tmp_path, "broken", "--whatever", "7")
    assert (done.returncode, done.stdout) == (2, "")
    *_, line = done.stderr.splitlines()
    assert "broken: its verb (broken = broken.eventsweep:verb) cannot be loaded" in line
    assert "no_such_module" in line
    assert run_with(site, tmp_path, "list", "suites").returncode == 0
