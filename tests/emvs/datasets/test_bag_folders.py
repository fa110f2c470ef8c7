"""Folders of ROS 2 bags whose metadata is missing or broken, while the bag's file is whole."""

import shutil

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin

import event_files
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.datasets.raw_streams import open_readable
from eventsweep.emvs.formats import open_events
from eventsweep.eval.cli.main import main
from refusals import refused

SIZE_PX = (64, 48)
NAMED = "rosbag2_bagfile_information:\n  relative_file_paths: [other.mcap]\n"
METADATA = {
    "missing": None, "empty": "", "cut off": NAMED[:40], "no YAML": "{[\n: :",
    "another file's": NAMED, "a list": "- 1\n",
}  # fmt: skip


@pytest.fixture(scope="module", params=["SQLITE3", "MCAP"])
def bag(request, tmp_path_factory):
    t_us = 1000 * np.arange(1, 41)
    x = (np.arange(40) % 64).astype(np.uint16)
    events = Events(x, x % 48, t_us, (x % 2).astype(np.uint8))
    path = tmp_path_factory.mktemp("bags") / "whole"
    storage = getattr(StoragePlugin, request.param)
    return event_files.write_rosbag2(path, SIZE_PX, [events], storage) or path


@pytest.mark.parametrize("kind", METADATA)
def test_a_bag_whose_metadata_is_of_no_use_opens_as_its_file(bag, tmp_path, capsys, kind):
    folder, text = tmp_path / "bag", METADATA[kind]
    shutil.copytree(bag, folder)
    (folder / "metadata.yaml").unlink()
    if text is not None:
        (folder / "metadata.yaml").write_text(text)
    alone = next(path for path in folder.iterdir() if path.name != "metadata.yaml")
    for path in (bag, folder, alone):
        reader = open_events(path)
        assert (reader.count("/events"), reader.size_px("/events")) == (40, SIZE_PX)
        assert "events alone: no calibration" in open_readable(path).what
    assert main(["info", str(folder), "--json"]) == 0
    assert '"events": 40' in capsys.readouterr().out


def test_several_files_without_metadata_are_refused(bag, tmp_path):
    folder = tmp_path / "bag"
    shutil.copytree(bag, folder)
    (folder / "metadata.yaml").unlink()
    alone = next(folder.iterdir())
    shutil.copy(alone, folder / f"second{alone.suffix}")
    refused(["2 files of a ROS2 bag", "reindex"], open_events, folder)
    refused("2 files of a ROS2 bag", open_readable, folder)
