"""A first run compiles what mapping calls in another process: all of it, and only then."""

import os
import subprocess
import sys

import numpy as np
import pytest

from eventsweep.emvs import rehearsal
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.rehearsal import Rehearsal, compiled_beside
from small_pair import small_sequence

RIG = Rehearsal(2, (40, 30)).rig
CALLED = """
import sys
from pathlib import Path
from numba.core import event
names = []
class Listener(event.Listener):
    def on_start(self, started):
        names.append(started.data["dispatcher"].py_func.__qualname__)
    def on_end(self, ended):
        pass
event.register("numba:compile", Listener())
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.mapper import map_window
map_window(Sequence.open(Path(sys.argv[1])), MapperConfig(planes=20))
print(names)
"""


@pytest.fixture
def cold(monkeypatch):
    """A machine of two processors without kernels; its processes run the given program."""

    real = subprocess.Popen

    def start(program):
        began = []

        def popen(_words, **_options):
            began.append(real([sys.executable, "-c", program]))
            return began[-1]

        monkeypatch.setattr(rehearsal, "has_kernel", lambda _name: False)
        monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1})
        monkeypatch.setattr(rehearsal.subprocess, "Popen", popen)
        return began

    return start


def test_with_kernels_or_one_processor_or_a_gpu_nothing_is_started(cold, monkeypatch):
    began, said = cold("raise SystemExit"), []
    with compiled_beside(MapperConfig(device="cuda"), RIG, said.append):
        pass
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0})
    with compiled_beside(MapperConfig(), RIG, said.append):
        pass
    monkeypatch.setattr(os, "sched_getaffinity", lambda _process: {0, 1})
    monkeypatch.setattr(rehearsal, "has_kernel", lambda _name: True)
    with compiled_beside(MapperConfig(), RIG, said.append):
        pass
    assert not began
    assert not said


def test_a_process_that_fails_is_told_of(cold):
    said = []
    cold("raise SystemExit(3)")
    with compiled_beside(MapperConfig(), RIG, said.append):
        pass
    assert "first run" in said[0]
    assert "ended with 3" in said[-1]


def test_a_process_ends_with_the_run(cold):
    began = cold("import time; time.sleep(600)")
    with (
        pytest.raises(KeyboardInterrupt),
        compiled_beside(MapperConfig(), RIG, lambda _line: None),
    ):
        raise KeyboardInterrupt
    assert began[0].returncode is not None


def test_the_made_up_events_lie_on_the_sensor():
    made = Rehearsal(2, (40, 30))
    for camera in (0, 1):
        events = made.events(camera, 0, 100_000)
        assert events.x.max() < 40
        assert events.y.max() < 30
        assert (np.diff(events.t_us) >= 0).all()


@pytest.mark.slow
def test_all_that_mapping_calls_is_compiled(tmp_path):
    """Of a configuration with settings that pick events of a recording."""
    environment = os.environ | {"NUMBA_CACHE_DIR": str(tmp_path / "kernels")}
    config = MapperConfig(planes=20, start_s=3, window_s=0.5, min_events=10**9)
    words = ["2", "40", "30", config.model_dump_json()]
    subprocess.run(
        [sys.executable, "-m", "eventsweep.emvs.rehearsal", *words], env=environment, check=True
    )
    sequence = small_sequence(tmp_path / "sequence")
    found = subprocess.run(
        [sys.executable, "-c", CALLED, str(sequence)], env=environment, check=True,
        capture_output=True, text=True,
    )  # fmt: skip
    assert found.stdout.strip() == "[]"
