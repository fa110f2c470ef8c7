"""Events that are not in the order of time: kept and told of, or refused; never lost in silence."""

import json

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dataset_world import rewritten, write_sequence
from eventsweep.emvs.data.event_store import EventStoreReader
from eventsweep.emvs.data.events import Events, check_sorted, count_late
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, open_events, write_events
from eventsweep.eval.cli.main import main
from made_events import part_of
from refusals import refused
from tiers import often

OFFSET_US = 12_345
INDEXED = ("dsec", "tumvie")
ORDERS = {
    "reversed": lambda k: k[::-1],
    "halves": lambda k: np.roll(k, len(k) // 2),
    "swapped": lambda k: np.where(k == k[len(k) // 3], k[-9], np.where(k == k[-9], len(k) // 3, k)),
    "one late": lambda k: np.append(np.delete(k, len(k) // 2), len(k) // 2),
}


def write_hdf5(path, t, index, offset_us=None):
    """Events with times and an index as given, whatever they say; x counts the rows."""
    with h5py.File(path, "w") as file:
        file["events/t"] = np.asarray(t, np.int64)
        file["events/x"] = np.arange(len(t), dtype=np.uint16)
        file["events/y"], file["events/p"] = np.zeros((2, len(t)), np.uint8)
        file["ms_to_idx"] = np.asarray(index, np.int64)
        if offset_us is not None:
            file["t_offset"] = offset_us
    return path


def rows_of(events):
    return list(zip(events.t_us.tolist(), events.x.tolist(), strict=True))


@pytest.mark.slow
@settings(max_examples=30)
@given(
    t=st.lists(st.integers(0, 6000), min_size=1, max_size=12),
    data=st.data(), step_us=st.sampled_from([1000, 1500, 2300]), in_order=st.booleans(),
)  # fmt: skip
def test_slices_of_an_indexed_file_are_right_or_refused(tmp_path, t, data, step_us, in_order):
    """Slices that follow each other: all of them right, or one is refused; any index, any order."""
    t = sorted(t) if in_order else t
    honest = np.searchsorted(np.sort(t), np.arange(max(t) // 1000 + 1) * 1000)
    random = st.lists(st.integers(0, len(t)), min_size=1, max_size=8)
    index = data.draw(st.one_of(st.just(honest.tolist()), random))
    readers = (
        (open_events(write_hdf5(tmp_path / "a.h5", t, index, OFFSET_US)), OFFSET_US),
        (open_events(write_hdf5(tmp_path / "b.h5", t, index)), 0),
        (EventStoreReader(tmp_path / "a.h5", 64, 64), OFFSET_US),
    )
    for reader, offset_us in readers:
        read = getattr(reader, "read", None) or (lambda a, b, r=reader: r.between("events", a, b))
        refusals = []
        for t0_us in range(offset_us, offset_us + 8001, step_us):
            slice_us = (t0_us, t0_us + step_us)
            stamps = [(s + offset_us, k) for k, s in enumerate(t)]
            expected = [row for row in stamps if slice_us[0] <= row[0] < slice_us[1]]
            try:
                got = rows_of(read(*slice_us))
            except InputError as error:
                refusals.append(str(error))
            else:
                assert not in_order or got == expected
        assert refusals or t == sorted(t)
        assert not refusals or not in_order or index != honest.tolist()
        assert all("sort the events" in words for words in refusals)


@pytest.mark.parametrize("kind", INDEXED)
@pytest.mark.parametrize("order", ORDERS)
def test_the_span_of_an_indexed_file_is_that_of_all_its_events(tmp_path, kind, order):
    t = np.arange(0, 50_000, 70)
    index = np.searchsorted(t, np.arange(t[-1] // 1000 + 1) * 1000)
    shuffled = t[ORDERS[order](np.arange(len(t)))]
    write_hdf5(tmp_path / "e.h5", shuffled, index, OFFSET_US if kind == "dsec" else None)
    reader = open_events(tmp_path / "e.h5")
    assert reader.format == kind
    offset_us = OFFSET_US if kind == "dsec" else 0
    assert reader.span_us("events") == (offset_us, int(t[-1]) + offset_us)


@pytest.mark.parametrize("cut", [1, 5])
@given(t=st.lists(st.integers(0, 20), max_size=12))
def test_late_events_are_counted_whatever_the_packets(t, cut):
    latest, count = 0, 0
    for start in range(0, len(t), cut):
        part = np.array(t[start : start + cut])
        count += count_late(part, latest)
        latest = max(latest, *part.tolist())
    assert count == sum(stamp < max(t[: k + 1]) for k, stamp in enumerate(t))


def test_a_fall_is_named_by_its_number_in_the_stream(tmp_path):
    packets = [Events(*np.zeros((2, 3), np.uint16), np.array(t), np.zeros(3, np.uint8)) for t in
               ([1, 2, 3], [3, 9, 8])]  # fmt: skip
    with pytest.raises(InputError, match="event 5 at 8 µs comes after one at 9 µs"):
        write_events(tmp_path / "e", "evt3", 64, 64, {"events": packets})
    refused("event 12 at 8 µs", check_sorted, np.array([3, 9, 8]), 10)


def unsorted_recording(folder, kind, order):
    """A recording of one camera whose events were put into another order; its index was not."""
    ours = write_sequence(folder / "ours", "pinhole", cameras=1, steps=300)
    path = ours / "cam0" / "events.h5"
    if kind != "sequence":
        ours = rewritten(ours, folder / kind, "npz")
        described, plain = ours / "recording.toml", ours / "cam0.npz"
        path = plain if kind == "npz" else ours / f"cam0{FORMATS[kind].suffix}"
        described.write_text(described.read_text().replace(plain.name, path.name))
        events = Events.concat(list(open_events(plain).chunks("events")))
        write_events(path, kind, 96, 64, {"events": [events]})
    shuffle(path, ORDERS[order])
    if kind == "sequence":
        manifest = json.loads((ours / "manifest.json").read_text())
        manifest["files"]["cam0/events.h5"]["bytes"] = path.stat().st_size
        (ours / "manifest.json").write_text(json.dumps(manifest))
    return ours


def shuffle(path, order):
    if path.suffix == ".npz":
        events = Events.concat(list(open_events(path).chunks("events")))
        events = part_of(events, order(np.arange(len(events))))
        write_events(path, "npz", 96, 64, {"events": [events]})
        return
    with h5py.File(path, "r+") as file:
        for name in "xytp":
            column = file[f"events/{name}"]
            column[...] = column[...][order(np.arange(len(column)))]


@pytest.mark.parametrize("kind", often(["sequence", "npz"], ["sequence", *INDEXED, "npz"]))
@pytest.mark.parametrize("order", ["reversed", "one late"])
def test_a_map_names_the_order_and_convert_tells_of_it(tmp_path, kind, order, capsys):
    """`map` refuses what it would get wrong, however it is cut; `info` and `convert` say so."""
    path = unsorted_recording(tmp_path, kind, order)
    settings = ("--method", "EMVS/cam0", "--map.planes", "10", "--quiet")
    for slides in ((), ("--map.window-s", "0.1")):
        out = tmp_path / f"map{len(slides)}"
        assert main(["map", str(path), "--out", str(out), *settings, *slides]) in (1, 2)
        assert "sort the events" in capsys.readouterr().err
    assert main(["info", str(path)]) == 0
    said = capsys.readouterr().out.partition("note: cam0: ")[2].split()[0]
    assert main(["convert", str(path), str(tmp_path / "all"), "--to", "npz", "--quiet"]) == 0
    assert f"note: cam0: {said} events come after later ones" in capsys.readouterr().err
    csv = tmp_path / "one.csv"
    assert main(["convert", str(path), str(csv), "--to", "csv", "--stream", "cam0", "--quiet"]) == 0
    assert f"note: cam0: {said} events come after later ones" in capsys.readouterr().err
    for kind_out in ("sequence", "dsec", "evt3"):
        one = ("--stream", "cam0") if kind_out != "sequence" else ()
        words = ["convert", str(path), str(tmp_path / "refused"), "--to", kind_out, *one]
        assert main([*words, "--quiet"]) == 2
        assert "sort the events by time" in capsys.readouterr().err
        assert not (tmp_path / "refused").exists()
