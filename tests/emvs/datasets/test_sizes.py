"""Cameras of different sizes: each stream is written with its own, in either order."""

from dataclasses import replace

import numpy as np
import pytest

import dataset_world as world
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.data.writer import SequenceWriter
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.export import kinds
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.formats import FORMATS, open_events, write_events
from eventsweep.emvs.geometry.rig import Rig

SIZES = [((96, 64), (120, 48)), ((120, 48), (96, 64))]


def corners(size_px, count=60):
    """Events at the first and at the last pixel of a sensor."""
    last = np.arange(count) % 2
    x, y = last * (size_px[0] - 1), last * (size_px[1] - 1)
    t_us = 1000 + 1000 * np.arange(count)
    return Events(x.astype(np.uint16), y.astype(np.uint16), t_us, last.astype(np.uint8))


def sequence_of(path, sizes):
    rig = world.rig_of("pinhole")
    cameras = tuple(
        replace(camera, width_px=w, height_px=h)
        for camera, (w, h) in zip(rig.cameras, sizes, strict=True)
    )
    rig = Rig("two", cameras, rig.T_body_cam)
    with SequenceWriter(
        path, name="two", rig=rig, trajectory=world.trajectory_of(rig), config={}
    ) as writer:
        for k, size_px in enumerate(sizes):
            writer.append_events(k, corners(size_px))
    return path


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize("kind", [kind for kind in kinds() if kind != "colmap"])  # needs pictures
def test_every_layout_keeps_each_cameras_size(tmp_path, kind, sizes):
    ours = sequence_of(tmp_path / "ours", sizes)
    found = open_recording(world.rewritten(ours, tmp_path / "out", kind))
    assert [(c.width_px, c.height_px) for c in found.rig.cameras] == list(sizes)
    whole = Sequence.open(ours)
    for camera in range(2):
        events, expected = (r.events(camera, 0, 1 << 40) for r in (found, whole))
        if kind != "eventnerf":  # which undistorts, and begins its clock at the first event
            np.testing.assert_array_equal(events.x, expected.x)
            np.testing.assert_array_equal(events.y, expected.y)
    path = getattr(found, "path", None)
    assert list(open_readable(path).sizes_px) == list(sizes)


@pytest.mark.parametrize("sizes", SIZES)
@pytest.mark.parametrize(
    "kind", [name for name, one in FORMATS.items() if one.writes and one.limits.streams > 1]
)
def test_a_file_of_several_streams_knows_each_ones_size(tmp_path, kind, sizes):
    names = ("davis/left", "davis/right")
    streams = {name: [corners(size)] for name, size in zip(names, sizes, strict=True)}
    path = tmp_path / "file"
    write_events(path, kind, *sizes[0], streams, sizes_px=dict(zip(names, sizes, strict=True)))
    reader = open_events(path)
    for name, size_px in zip(names, sizes, strict=True):
        assert len(reader.between(name, 0, 1 << 40)) == 60
        assert reader.size_px(name) == (None if kind == "mvsec" else size_px)
