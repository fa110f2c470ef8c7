"""`eventsweep info`: counts equal a plain count, faults are found, and pictures are drawn."""

import itertools
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import write_events
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.cli.main import main
from eventsweep.eval.event_statistics import GAP_US, StreamCount
from refusals import command_refused


def made(times, columns=None) -> Events:
    t_us = np.array(times, np.int64)
    x = np.zeros(len(t_us), np.uint16) if columns is None else np.array(columns, np.uint16)
    return Events(x, x, t_us, (np.arange(len(t_us)) % 2).astype(np.uint8))


@given(
    st.lists(st.integers(0, 1 << 40) | st.integers(0, 5000), min_size=1, max_size=40),
    st.integers(1, 40),
)
def test_packets_count_as_one_plain_pass(times, packet):
    events = made(times)
    found = StreamCount((1, 1))
    for start in range(0, len(times), packet):
        found.add(events.slice(start, start + packet))
    pairs = list(itertools.pairwise(times))
    assert (found.events, found.first_us, found.last_us) == (len(times), min(times), max(times))
    assert found.backwards == sum(b < a for a, b in pairs)
    assert found.backwards_events == sum(t < max(times[: k + 1]) for k, t in enumerate(times))
    assert found.gap_count == sum(b - a >= GAP_US for a, b in pairs)
    starts, rates = found.rates()
    assert rates.sum() == len(times)
    assert rates[1].sum() == found.brighter == len(times) // 2
    inside = [int(((np.array(times) // found.bin_us) == s // found.bin_us).sum()) for s in starts]
    if found._origin_us % found.bin_us == 0:
        assert rates.sum(axis=0).tolist() == inside


def test_strays_are_counted_and_named(tmp_path, capsys):
    path = tmp_path / "e.raw"
    write_events(path, "evt2", 64, 64, {"e": [made([0, 10, 300_000], [1, 2, 63])]})
    raw = path.read_bytes().replace(b"64", b"32")
    path.write_bytes(raw)
    main(["info", str(path), "--json"])
    stream = json.loads(capsys.readouterr().out)["streams"][0]
    assert stream["sensor_px"] == [32, 32]
    assert (stream["events"], stream["outside_sensor"], stream["gaps"]) == (3, 1, 1)
    assert stream["longest_gaps_us"] == [[10, 300_000]]


PLACES = st.lists(st.tuples(st.integers(0, 300), st.integers(0, 300)), min_size=1, max_size=30)


@given(PLACES, st.integers(1, 10))
def test_without_a_sensors_size_the_image_reaches_the_largest_pixel(places, packet):
    x, y = np.array(places, np.uint16).T
    p = (np.arange(len(x)) % 2).astype(np.uint8)
    events = Events(x.copy(), y.copy(), np.arange(len(x)), p)
    found = StreamCount(None)
    for start in range(0, len(x), packet):
        found.add(events.slice(start, start + packet))
    expected = np.zeros((2, y.max() + 1, x.max() + 1), np.int64)
    np.add.at(expected, (p, y, x), 1)
    np.testing.assert_array_equal(found.image(), expected)
    far = ((5000, "u2"), (1, "u2"), (99, "i8"), (0, "u1"))
    found.add(Events(*(np.array([v], kind) for v, kind in far)))
    assert found.image() is None
    assert found.outside == 0


def test_a_picture_is_drawn_of_a_file_that_says_no_size_but_not_of_nothing(tmp_path, capsys):
    path, picture = tmp_path / "e.txt", tmp_path / "e.png"
    write_events(path, "text", 64, 64, {"e": [made([0, 10, 20])]})
    asked = ["info", str(path), "--quiet", "--picture", str(picture)]
    assert main(asked) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    command_refused(capsys, *asked)
    (tmp_path / "e.raw").write_bytes(b"\x00\x01\x02")
    command_refused(capsys, "info", tmp_path / "e.raw")


def test_slider_depth_is_known(shared_data, capsys):
    main(["info", str(shared_data / "slider_depth"), "--json"])
    found = json.loads(capsys.readouterr().out)
    assert (found["what"], found["streams"][0]["events"]) == ("Event Camera Dataset", 1_078_541)
    assert found["recording"]["poses_cover_events"] is False
    assert found["recording"]["poses"] == 339


@pytest.mark.parametrize("word", ["--json", "--quiet"])
def test_nothing_but_what_was_asked_for(tmp_path, capsys, word):
    path = tmp_path / "e.npz"
    write_events(path, "npz", 64, 64, {"e": [made([0, 10, 20])]})
    main(["info", str(path), word])
    out = capsys.readouterr().out
    assert json.loads(out) if word == "--json" else not out


HEADER = "#timestamp [ns],x,y,z,qw,qx,qy,qz\n"
NS = HEADER + "".join(f"{k}0000000,0.{k},0,0,1,0,0,0\n" for k in range(12))
SAYS = {  # poses of a recording with events from 0 to 0.1 s, a line of its table, and what is told
    "header in ns": (NS, "", ""),
    "unit agrees": (NS, 'unit = "ns"\n', ""),
    "ms, silent": ("".join(f"{10 * k} 0.{k} 0 0 0 0 0 1\n" for k in range(12)), "",
                   "fewer than two from the first event to the last: check their unit"),
    "another clock": ("".join(f"{1.6e9 + k / 100} 0.{k} 0 0 0 0 0 1\n" for k in range(12)), "",
                      "none at the time of the events: check clock and unit"),
    "repeated": ("".join(f"{k / 100} 0.{k} 0 0 0 0 0 1\n" * 2 for k in range(12)), "",
                 "12 of 24 poses repeat the time before them"),
    "an impossible year": ("".join(f"{1e10 + k / 100} 0.{k} 0 0 0 0 0 1\n" for k in range(12)),
                           'unit = "s"\n', "times reach the year 2286"),
}  # fmt: skip
REFUSED = {
    "unit contradicts": (HEADER + "0,0,0,0,1,0,0,0\n", 'unit = "us"\n', "leave the setting out"),
    "ns, silent": ("".join(f"{k}0000000 0 0 0 0 0 0 1\n" for k in range(12)), "",
                   "set poses.unit to 'ns'"),
}  # fmt: skip


def recording_of(folder, poses, table):
    """A recording of one camera with these poses, beside its events."""
    rig = Rig("r", (Camera(64, 64, 60, 60, 32, 32, "pinhole"),), (np.eye(4),))
    (folder / "rig.json").write_text(json.dumps(rig.to_json()), encoding="utf-8-sig")
    (folder / "poses.txt").write_text(poses, encoding="utf-8-sig")
    events = "t_us,x,y,p\n" + "".join(f"{1000 * k},{k % 64},5,1\n" for k in range(101))
    (folder / "cam0.csv").write_text(events, encoding="utf-8-sig")
    (folder / "recording.toml").write_text(
        f'[calibration]\nfile = "rig.json"\n[poses]\nfile = "poses.txt"\n{table}'
        '[[events]]\nfile = "cam0.csv"\n', encoding="utf-8-sig",
    )  # fmt: skip
    return folder


@pytest.mark.parametrize("name", SAYS)
def test_what_the_poses_of_a_recording_say_is_told(tmp_path, capsys, name):
    poses, table, words = SAYS[name]
    assert main(["info", str(recording_of(tmp_path, poses, table))]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert f"note: poses: {words}" in said or (words in said if words else "note" not in said)


@pytest.mark.parametrize("name", REFUSED)
def test_poses_that_contradict_or_cannot_be_are_refused(tmp_path, capsys, name):
    poses, table, words = REFUSED[name]
    assert words in command_refused(capsys, "info", recording_of(tmp_path, poses, table))


def test_a_year_that_a_header_states_is_told(tmp_path, capsys):
    (tmp_path / "e.csv").write_text("t_us,x,y,p\n1600000000000000000,2,3,1\n")
    assert main(["info", str(tmp_path / "e.csv")]) == 0
    assert "events: times reach the year 526" in capsys.readouterr().out
