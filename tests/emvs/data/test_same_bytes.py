"""Equal input gives equal bytes, whoever watches the process."""

import hashlib
import sys
import threading
import time

import numpy as np
import pytest

from eventsweep.emvs.data.event_store import EventStoreWriter
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import FrameWriter, Photo, TruthWriter
from eventsweep.emvs.formats.tables.hdf5 import MvsecWriter, TumvieWriter
from tiers import often

SHAPE = (48, 64)


def packets(count=150_000, number=6):
    rng = np.random.default_rng(0)
    for k in range(number):
        x, y, p = (rng.integers(0, top, count) for top in (64, 48, 2))
        t_us = 5_000_000 * k + np.sort(rng.integers(0, 5_000_000, count))
        yield Events(x.astype(np.uint16), y.astype(np.uint16), t_us, p.astype(np.uint8))


def write_events(path):
    with EventStoreWriter(path, 64, 48) as writer:
        for events in packets():
            depth_m = events.x.astype(np.float32)
            writer.append(events, {"label": events.p, "depth_m": depth_m})


def write_truth(path):
    with TruthWriter(path, 64, 48) as writer:
        for k in range(60):
            more = {"segmentation": np.full(SHAPE, k, np.int32)}
            writer.append(k, np.full(SHAPE, k, np.float32), np.full(SHAPE, k, np.uint8), more)


def write_frames(path):
    with FrameWriter(path, 64, 48) as writer:
        for k in range(60):
            writer.append(Photo(2 * k, 2 * k + 1, 1.0, np.full(SHAPE, k, np.uint8)))


def write_tumvie(path):
    writer = TumvieWriter(path)
    for events in packets():
        writer._put("events", events)
    writer._close()


def write_mvsec(path):
    writer = MvsecWriter(path, ["left", "right"])
    for events in packets():
        writer._put("left", events)
        writer._put("right", events)
    writer._close()


WRITERS = (write_events, write_truth, write_frames, write_tumvie, write_mvsec)


def digest(write, path):
    write(path)
    return hashlib.sha256(path.read_bytes()).hexdigest()


def watch(stop):
    """Holds every frame for a moment, and with it all that the frame's function held."""
    while not stop.is_set():
        kept = sys._current_frames()
        time.sleep(0)
        del kept


@pytest.mark.parametrize("write", often((write_events, write_mvsec), WRITERS))
def test_who_watches_changes_no_byte(tmp_path, write):
    alone = digest(write, tmp_path / "alone.h5")
    stop = threading.Event()
    watcher = threading.Thread(target=watch, args=(stop,))
    watcher.start()
    try:
        assert {digest(write, tmp_path / f"watched{k}.h5") for k in range(5)} == {alone}
    finally:
        stop.set()
        watcher.join()
