"""Long sequences: chunks in processes, parts on disk, stopped and resumed: the same bytes."""

import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.parallel.checkpoint import CheckpointFolder, checkpoint_path
from eventsweep.sim.parallel.render_job import chunk_bounds_us
from eventsweep.sim.parallel.workers import slot_count
from eventsweep.sim.rendering import drawing
from eventsweep.sim.sensor.labels import Label
from eventsweep.sim.sensor_presets import SensorConfig
from eventsweep.sim.simulate import check_disk, make_job, simulate
from killed import killed_at_every_step
from mujoco_scenes import CONFIG, Killed, motion, stop_at, textures
from places import HELPERS
from refusals import all_bytes, refused
from tiers import often


@pytest.fixture(scope="module")
def whole(folder, scene):
    """The sequence, simulated without a stop."""
    return simulate(scene, made.tiny_rig(), CONFIG, 0, folder / "whole")


def stopped(scene, out, t_us, config=CONFIG):
    with pytest.raises(Killed):
        simulate(scene, made.tiny_rig(), config, 0, out, commit_s=0, progress=stop_at(t_us))
    assert not out.exists()


def test_a_stopped_run_keeps_its_renderer(tmp_path, monkeypatch):
    scene = made.noise_scene(tmp_path)
    stopped(scene, tmp_path / "s", 12_000)
    begun = drawing.default_renderer()
    monkeypatch.setattr(drawing, "default_renderer", lambda: "float")
    simulate(scene, made.tiny_rig(), CONFIG, 0, tmp_path / "s")
    manifest = Sequence.open(tmp_path / "s").manifest
    assert manifest.configuration["light"]["renderer"] == begun != "float"


@pytest.mark.parametrize("t_us", often([12_000], [12_000, 30_000, 50_000]))
def test_a_stopped_run_goes_on_where_it_was(folder, scene, whole, t_us):
    out, lines = folder / f"stopped{t_us}", []
    stopped(scene, out, t_us)
    assert checkpoint_path(out).exists()
    seen = []
    simulate(
        scene, made.tiny_rig(), CONFIG, 0, out, notice=lines.append,
        progress=lambda _stage, done_us, _total_us: seen.append(done_us),
    )  # fmt: skip
    assert all_bytes(out) == all_bytes(whole)
    assert len(lines) == 1
    assert "resuming" in lines[0]
    assert all(done_us > t_us - 10_000 for done_us in seen)
    assert not checkpoint_path(out).exists()


@pytest.mark.slow
def test_a_sensor_with_noise_goes_on_as_if_never_stopped(folder, scene):
    """Mismatch, bandwidth, noise, latency, arbiter: whatever it remembers is in the parts.

    And two workers that go on give the same bytes as none.
    """
    noisy = CONFIG.model_copy(update={"sensor": SensorConfig(preset="davis346")})
    once = simulate(scene, made.tiny_rig(), noisy, 0, folder / "noisy")
    out = folder / "noisy-again"
    stopped(scene, out, 22_000, noisy)
    times_us = []
    simulate(
        scene, made.tiny_rig(), noisy, 0, out, workers=2, commit_s=0,
        progress=lambda _stage, done_us, _total_us: times_us.append(done_us),
    )  # fmt: skip
    assert all_bytes(out) == all_bytes(once)
    assert times_us == sorted(set(times_us))
    assert times_us[-1] == 50_000
    assert not checkpoint_path(out).exists()
    assert multiprocessing.active_children() == []
    sequence = Sequence.open(out)
    for k in range(2):
        counts, labels = sequence.sensor_counts(k), sequence.labels(k, 0, 50_001)
        assert len(labels) == sequence.event_count(k) == len(sequence.events(k, 0, 50_001))
        for label in Label:
            assert counts[label.name.lower()] == np.count_nonzero(labels == label)
        assert counts["signal"] > 500
        assert len(sequence.event_depth_m(k, 0, 50_001)) == len(labels)


def test_an_ideal_sensor_stores_no_labels(whole):
    sequence = Sequence.open(whole)
    refused("no label", sequence.labels, 0, 0, 50_001)
    refused("not ideal", sequence.sensor_counts, 0)


@pytest.fixture(scope="module")
def unfinished(folder, scene):
    """What a run leaves that was stopped at 35 ms."""
    stopped(scene, folder / "unfinished", 35_000)
    return checkpoint_path(folder / "unfinished")


DAMAGED = [
    ("cam0.events.h5", 0), ("cam1.truth.h5", -1), ("part.json", 1), ("part.json", -1),
    ("state.npz", -1),
]  # fmt: skip


@pytest.mark.parametrize(
    ("name", "index"),
    often([("cam0.events.h5", 0), ("state.npz", -1)], DAMAGED),
)
def test_a_damaged_part_is_made_again(folder, scene, whole, unfinished, name, index):
    out, lines = folder / f"damaged-{name}{index}", []
    shutil.copytree(unfinished, checkpoint_path(out))
    part = sorted(path for path in checkpoint_path(out).iterdir() if path.is_dir())[index]
    file = part / name
    content = bytearray(file.read_bytes())
    content[len(content) // 2] ^= 1
    file.write_bytes(content)
    simulate(scene, made.tiny_rig(), CONFIG, 0, out, notice=lines.append)
    assert all_bytes(out) == all_bytes(whole)
    assert "damaged" in lines[0]


def test_work_of_another_configuration_is_not_taken_up(folder, scene, whole):
    out = folder / "other"
    other = CONFIG.model_copy(update={"contrast_threshold_pos": 0.3})
    stopped(scene, out, 22_000, other)
    kept = all_bytes(checkpoint_path(out))
    refused("resume=False", simulate, scene, made.tiny_rig(), CONFIG, 0, out)
    moved = replace(scene, motion=lambda duration_s, seed: motion(duration_s, seed + 1))
    refused("resume=False", simulate, moved, made.tiny_rig(), other, 0, out)
    mjcf = folder / "wider.xml"
    mjcf.write_text(scene.mjcf.read_text().replace('size=".1 .1 .1"', 'size=".1 .1 .12"'))
    refused("resume=False", simulate, replace(scene, mjcf=mjcf), made.tiny_rig(), other, 0, out)
    assert all_bytes(checkpoint_path(out)) == kept
    simulate(scene, made.tiny_rig(), CONFIG, 0, out, resume=False)
    assert all_bytes(out) == all_bytes(whole)


def test_a_target_is_worked_on_once_at_a_time(folder, scene):
    out = folder / "busy"

    def again(*_):
        refused("another process", simulate, scene, made.tiny_rig(), CONFIG, 0, out)
        raise Killed

    with pytest.raises(Killed):
        simulate(scene, made.tiny_rig(), CONFIG, 0, out, progress=again)
    assert not checkpoint_path(out).exists()


# Forks before any graphics or threads, so that each attempt starts within milliseconds.
KILLED = """
import os, pathlib, random, signal, sys, time
sys.path.insert(0, {tests!r})
import mujoco_scenes as made
from eventsweep.sim.simulate import simulate as simulated

def simulate(out, workers):
    simulated(made.noise_scene(out.parent), made.tiny_rig(), made.CONFIG, 0, out,
              commit_s=0, workers=workers)

def main(out, workers, seed):
    rng, kills = random.Random(seed), 0
    while True:
        child = os.fork()
        if not child:
            simulate(out, workers)
            os._exit(0)
        time.sleep(rng.uniform(0.1, 0.4 + {patience} * kills))
        os.kill(child, signal.SIGKILL)
        _, status = os.waitpid(child, 0)
        if os.WIFEXITED(status):
            print(kills)
            return os.WEXITSTATUS(status)
        kills += 1
        if out.exists():
            print(kills)
            return 0

if __name__ == "__main__":
    sys.exit(main(pathlib.Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
"""


def test_killed_at_any_step_of_its_beginning_it_can_be_begun_again(tmp_path):
    def begin():
        with CheckpointFolder(
            tmp_path / "out", "key", made.tiny_rig(), renderer="", resume=True, notice=print
        ) as work:
            assert work.next_chunk == 0

    assert killed_at_every_step(begin, lambda _step: begin()) > 5
    assert list(tmp_path.iterdir()) == []


@pytest.mark.slow
@pytest.mark.parametrize("workers", [1, 2])
def test_killed_at_random_moments_it_ends_with_the_same_bytes(tmp_path, whole, workers):
    script = tmp_path / "killed.py"
    script.write_text(KILLED.format(tests=str(HELPERS / "simulation"), patience=0.1 * workers**2))
    command = [sys.executable, str(script), str(tmp_path / "s"), str(workers), "3"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 0
    assert all_bytes(tmp_path / "s") == all_bytes(whole)
    # Killed between the end of the work and its removal, the work may stay: it is whole; and a
    # claim that nobody holds.
    done_with = {checkpoint_path(tmp_path / "s").name, ".s.partial"}
    left = {path.name for path in tmp_path.iterdir()} - done_with
    assert left == {"s", "noise.xml", "killed.py"}


@pytest.mark.slow
def test_a_worker_that_dies_is_told_and_loses_nothing(folder, scene, monkeypatch):
    out = folder / "died"
    # So few that the workers cannot be done long before the parent is.
    monkeypatch.setattr("eventsweep.sim.parallel.workers.slot_count", lambda _job: 2)

    def kill(_stage, done_us, _total_us):
        if done_us > 22_000:
            for child in multiprocessing.active_children():
                os.kill(child.pid, signal.SIGKILL)

    many = CONFIG.model_copy(update={"max_displacement_px": 0.5})
    simulate(scene, made.tiny_rig(), many, 0, folder / "not-killed")
    with pytest.raises(InputError, match="run again"):
        simulate(scene, made.tiny_rig(), many, 0, out, workers=2, commit_s=0, progress=kill)
    assert checkpoint_path(out).exists()
    simulate(scene, made.tiny_rig(), many, 0, out)
    assert all_bytes(out) == all_bytes(folder / "not-killed")


@pytest.mark.slow
def test_what_workers_refuse_is_one_line(folder, scene):
    fast = CONFIG.model_copy(update={"max_displacement_px": 0.5, "min_frame_interval_us": 9_000})
    local = replace(scene, textures=lambda: textures())
    for words, made_of, config, workers in (
        ("slow the motion", scene, fast, 2), ("top of a module", local, CONFIG, 2),
        ("0 workers", scene, CONFIG, 0),
    ):  # fmt: skip
        out = folder / words
        refused(words, simulate, made_of, made.tiny_rig(), config, 0, out, workers=workers)
        assert not checkpoint_path(out).exists()


def test_chunks_meet_at_all_truth_times_and_are_short():
    truth_us = [0, 3, 50_000, 50_001, 1_000_000]
    bounds_us = chunk_bounds_us(truth_us, 12_500)
    assert bounds_us == sorted(set(bounds_us))
    assert set(truth_us) <= set(bounds_us)
    assert np.diff(bounds_us).max() <= 12_500
    assert (bounds_us[0], bounds_us[-1]) == (0, 1_000_000)


def test_slots_are_bounded_in_memory(scene):
    big = Rig("big", (Camera(1280, 720, 1000, 1000, 640, 360),) * 2, (np.eye(4),) * 2)
    plain = CONFIG.model_copy(update={"sampling": "linear"})
    assert 10 < slot_count(make_job(scene, big, plain, 0)) < 30
    assert 3 <= slot_count(make_job(scene, big, CONFIG, 0)) < 8


def test_too_little_disk_or_memory_is_refused_with_numbers(folder, scene, monkeypatch):
    job = make_job(scene, made.tiny_rig(), CONFIG, 0)
    # As many truth times as a sequence of 10 days has.
    long = replace(job, truth_us=range(10**8))
    place = folder / "not" / "there"
    said = refused(r"takes about [\d.]+ [GT]B, but [\d.]+ \wB are", check_disk, long, place)
    assert said.startswith(f"{place}: ")
    with monkeypatch.context() as full:
        full.setattr("eventsweep.sim.simulate.free_bytes", lambda _: 12_345)
        refused(r"about [\d.]+ [kM]B, but 12.3 kB are free", check_disk, job, place)
    monkeypatch.setattr("eventsweep.sim.simulate.available_bytes", lambda: 10**8)
    words = r"takes about [\d.]+ [MG]B of memory, but 100 MB"
    refused(words, simulate, scene, made.tiny_rig(), CONFIG, 0, folder / "big")
