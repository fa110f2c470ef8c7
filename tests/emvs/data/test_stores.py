"""Event and truth files: optional columns and data sets, and bytes that packets do not change."""

import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.data.event_store import EventStoreReader, EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import TruthReader, TruthWriter
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.tables import Geom
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.scoring.run_folder import truth_of
from made_events import random_events
from peak_memory import peaks_mb
from places import HELPERS
from refusals import refused

LENS = Camera(20, 10, 15, 15, 9.5, 4.5, "kb4", (0.1, 0.0, 0.0, 0.0))
TRAJECTORY = Trajectory(np.array([0, 10_000]), np.zeros((2, 3)), np.tile([0.0, 0, 0, 1], (2, 1)))


def some_events(count: int) -> tuple[Events, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    events = random_events(rng, count, 20, 10, 3_000, 3_000 + 4 * count)
    return events, rng.integers(0, 5, count, np.uint8), rng.random(count).astype(np.float32)


def write(path: Path, cuts: list[int], count: int = 300_000) -> None:
    events, label, depth_m = some_events(count)
    with EventStoreWriter(path, 20, 10) as writer:
        for start, stop in zip([0, *cuts], [*cuts, count], strict=True):
            extra = {"label": label[start:stop], "depth_m": depth_m[start:stop]}
            writer.append(events.slice(start, stop), extra)


def test_the_bytes_do_not_depend_on_the_packets(tmp_path):
    write(tmp_path / "one", [])
    for name, cuts in (
        ("some", [1, 1, 131_071, 131_073, 262_144]),
        ("many", list(range(0, 300_000, 7_001))),
    ):
        write(tmp_path / name, cuts)
        assert (tmp_path / name).read_bytes() == (tmp_path / "one").read_bytes()


@given(st.integers(0, 1_300_000), st.integers(0, 30_000))
def test_slices_hold_exactly_their_events_and_columns(tmp_path_factory, start_us, length_us):
    path = tmp_path_factory.getbasetemp() / "slices.h5"
    if not path.exists():
        write(path, [1000])
    reader = EventStoreReader(path, 20, 10)
    events, label, depth_m = some_events(300_000)
    inside = (events.t_us >= start_us) & (events.t_us < start_us + length_us)
    got = reader.read(start_us, start_us + length_us)
    assert np.array_equal(got.t_us, events.t_us[inside])
    assert np.array_equal(got.x, events.x[inside])
    for name, column in (("label", label), ("depth_m", depth_m)):
        found = reader.read_extra(name, start_us, start_us + length_us)
        assert np.array_equal(found, column[inside])


def test_blocks_are_the_whole_file_in_order(tmp_path):
    write(tmp_path / "e", [], count=1_200_000)
    events, label, _ = some_events(1_200_000)
    blocks = list(EventStoreReader(tmp_path / "e", 20, 10).blocks())
    assert len(blocks) > 1
    assert np.array_equal(Events.concat([block for block, _ in blocks]).t_us, events.t_us)
    assert np.array_equal(np.concatenate([extra["label"] for _, extra in blocks]), label)


def test_columns_must_be_known_the_same_and_of_one_length(tmp_path):
    events, label, _ = some_events(10)
    with EventStoreWriter(tmp_path / "e", 20, 10) as writer:
        refused("choose from label, depth_m", writer.append, events, {"colour": label})
        writer.append(events, {"label": label})
        refused("same ones", writer.append, events, {})
        refused("9 values of label for 10 events", writer.append, events, {"label": label[:9]})
    with TruthWriter(tmp_path / "t", 20, 10) as writer:
        image = np.zeros((10, 20), np.float32)
        bright = image.astype(np.uint8)
        refused("choose from flow_px", writer.append, 0, image, bright, {"colour": image})
        writer.append(0, image, bright, {"boundary": bright})
        refused("same ones", writer.append, 1, image, bright)
    assert [t_us for t_us, _ in TruthReader(tmp_path / "t").times()] == [0]


def test_a_sequence_keeps_everything_that_it_is_given(tmp_path):
    events, label, depth_m = some_events(100)
    rng = np.random.default_rng(1)
    optional = {
        "flow_px": rng.random((10, 20, 2)).astype(np.float32),
        "segmentation": rng.integers(-1, 3, (10, 20)).astype(np.int32),
        "boundary": rng.integers(0, 2, (10, 20)).astype(np.uint8),
        "twist": rng.random(6),
        "view_depth_m": np.full((10, 20), 2.5, np.float32),
    }
    geoms = {0: Geom(name="floor", dynamic=False), 2: Geom(name="ball", dynamic=True)}
    facts = {"name": "s", "rig": Rig("one", (LENS,), (np.eye(4),)), "trajectory": TRAJECTORY}
    with SequenceWriter(tmp_path / "s", **facts, config={}, geoms=geoms) as writer:
        writer.append_events(0, events, label, depth_m)
        depth = np.full((10, 20), 1.5, np.float32)
        writer.append_truth(0, 500, depth, np.zeros((10, 20), np.uint8), optional)
    sequence = Sequence.open(tmp_path / "s")
    sequence.verify()
    assert np.array_equal(sequence.labels(0, 0, 10**6), label)
    assert np.array_equal(sequence.event_depth_m(0, 0, 10**6), depth_m)
    assert np.array_equal(sequence.truth_flow_px(0, 500), optional["flow_px"])
    assert np.array_equal(sequence.truth_segmentation(0, 500), optional["segmentation"])
    assert np.array_equal(sequence.truth_boundary(0, 500), optional["boundary"] == 1)
    assert np.array_equal(sequence.truth_dynamic(0, 500), optional["segmentation"] == 2)
    assert np.array_equal(sequence.truth_twist(0, 500), optional["twist"])
    assert sequence.geoms == geoms
    # Scores are made in the view without distortion, where the mapper's reference view is.
    truth = truth_of(sequence, 500, EvalConfig())
    assert (truth.depth_m == 2.5).all()
    assert (sequence.truth_depth_m(0, 500) == 1.5).all()


def test_a_lens_without_view_depth_cannot_be_scored(tmp_path):
    facts = {"name": "s", "rig": Rig("one", (LENS,), (np.eye(4),)), "trajectory": TRAJECTORY}
    with SequenceWriter(tmp_path / "s", **facts, config={}) as writer:
        image = np.ones((10, 20), np.float32)
        writer.append_truth(0, 500, image, image.astype(np.uint8))
    refused("view_depth_m", truth_of, Sequence.open(tmp_path / "s"), 500, EvalConfig())


MEMORY = """
import pathlib, sys
sys.path.insert(0, {tests!r})
import mujoco_scenes as t
from eventsweep.sim.rigs import rig
from eventsweep.sim.simulate import simulate

if __name__ == "__main__":
    out, seconds, workers = pathlib.Path(sys.argv[1]), float(sys.argv[2]), int(sys.argv[3])
    config = t.CONFIG.model_copy(update={{"duration_s": seconds}})
    simulate(t.noise_scene(out.parent), rig("tumvie"), config, 0, out, workers=workers)
"""


@pytest.mark.slow
@pytest.mark.parametrize(("workers", "most_mb"), [(1, 1800), (2, 2700)])
def test_1_mpx_takes_bounded_memory_and_no_more_for_longer(tmp_path, workers, most_mb):
    script = tmp_path / "memory.py"
    script.write_text(MEMORY.format(tests=str(HELPERS / "simulation")))
    peaks = []
    for seconds in ("0.04", "0.16"):
        command = [sys.executable, str(script), str(tmp_path / seconds), seconds, str(workers)]
        peaks.append(max(peaks_mb(command)))
    assert peaks[1] < most_mb
    assert peaks[1] < 1.15 * peaks[0]
