"""Tables of events whose columns somebody states, or whose values alone say what they are."""

import dataclasses
import json
import sys
from pathlib import Path

import h5py
import numpy as np
import pytest
import scipy.io

import naive_formats as naive
from dataset_world import rewritten, write_sequence
from event_files import ALL, write_any
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.tables.columns import ColumnMap, column_map
from eventsweep.eval.cli.main import main
from refusals import refused

ROWS = [(70_000 + 7 * k, k % 640, k % 480, k % 2) for k in range(5000)]
MAP = ColumnMap("ev/xs", "ev/ys", "ev/ts", "ev/on", "ns")
WORDS = ("--columns", "x=ev/xs,y=ev/ys,t=ev/ts,p=ev/on", "--time-unit", "ns")


def columns_of(rows=ROWS):
    return [np.array(column) for column in zip(*rows, strict=True)]


def read(path, columns=None):
    reader = open_events(path, columns)
    whole = Events.concat(list(reader.chunks("events", 999)))
    middle = int(np.median(whole.t_us))
    part = reader.between("events", middle, middle + 700)
    inside = (whole.t_us >= middle) & (whole.t_us < middle + 700)
    assert naive.rows_of(part) == [
        row for row, k in zip(naive.rows_of(whole), inside, strict=True) if k
    ]
    return naive.rows_of(whole)


@pytest.mark.parametrize("compressed", [False, True])
def test_matlab_arrays_by_stated_columns(tmp_path, compressed):
    t_us, x, y, p = columns_of()
    path, rows = tmp_path / "f.mat", np.stack([x, y, 2 * p - 1, t_us], axis=1).astype(float)
    scipy.io.savemat(path, {"note": "a text", "ev": rows}, do_compression=compressed)
    refused("fit neither t, x, y, p nor x, y, t, p; set", open_events, path)
    stated = ColumnMap("ev[0]", "ev[1]", "ev[3]", "ev[2]", "us")
    assert read(path, stated) == ROWS
    path.write_bytes(path.read_bytes()[:-40])
    refused("not a complete MATLAB file", open_events, path, stated)


REAL = Path(__file__).parents[3] / "../shared/data/real"


@pytest.mark.skipif(not REAL.exists(), reason="needs ../shared/data, no part of the project")
@pytest.mark.parametrize("name", ["dvs128_garfield", "dvs128_stripes"])
def test_real_matlab_arrays_are_what_scipy_reads(name):
    path = REAL / f"{name}.mat"
    x, y, p, t_us = scipy.io.loadmat(path)["events"].T
    expected = naive.rows_of(Events(x, y, t_us, p > 0))
    columns = ColumnMap(*(f"events[{k}]" for k in (0, 1, 3, 2)), "us")
    found = Events.concat(list(open_events(path, columns).chunks("events")))
    assert naive.rows_of(found) == expected


def matrix(order, kind=np.int64, unit=1):
    named = dict(zip("txyp", columns_of(), strict=True)) | {"t": columns_of()[0] * unit}
    return np.stack([named[name].astype(kind) for name in order], axis=1)


def saved(path, kind, rows):
    """A matrix in a file of a kind, by the library that people save it with."""
    if kind == "hdf5":
        with h5py.File(path, "w") as file:
            file.create_dataset("events", data=rows, maxshape=(None, 4), compression="gzip")
    else:
        save = {"npy": np.save, "npz": np.savez_compressed, "npz-stored": np.savez}[kind]
        with path.open("wb") as file:
            save(file, rows)
    return path


@pytest.mark.parametrize("order", ["txyp", "xytp"])
@pytest.mark.parametrize("kind", ["npy", "npz", "npz-stored", "hdf5"])
@pytest.mark.parametrize(("number", "unit"), [(np.int64, 1), (np.uint64, 1), (np.float64, 1e-6)])
@pytest.mark.parametrize("layout", [np.ascontiguousarray, np.asfortranarray])
def test_nameless_columns_are_told_by_their_values(tmp_path, order, kind, number, unit, layout):
    path = saved(tmp_path / "f", kind, layout(matrix(order, number, unit)))
    assert read(path) == ROWS


@pytest.mark.parametrize("kind", ["npy", "npz", "hdf5"])
def test_nameless_columns_that_could_be_either_are_refused_until_stated(tmp_path, kind):
    rows = [(t - 70_000, x, y, p) for t, x, y, p in ROWS]
    both = np.stack(columns_of(rows), axis=1)
    path = saved(tmp_path / "f", kind, both)
    refused([r"either t, x, y, p or x, y, t, p; set `columns`", path], open_events, path)
    name = {"npy": "", "npz": "arr_0", "hdf5": "events"}[kind]
    t, x, y, p = (f"{name}[{k}]" for k in range(4))
    assert read(path, ColumnMap(x, y, t, p, "us")) == rows
    swapped = [(y, t, x, p) for t, x, y, p in rows]
    assert read(path, ColumnMap(t, x, y, p, "us")) == swapped


@pytest.mark.parametrize("kind", ["npy", "npz", "hdf5"])
def test_floating_times_without_fractions_need_a_unit(tmp_path, kind):
    path = saved(tmp_path / "f", kind, matrix("txyp", np.float64))
    refused("without fractions; set `time_unit`", open_events, path)
    assert read(path, ColumnMap(time_unit="us")) == ROWS
    assert read(path, ColumnMap(time_unit="ms"))[1][0] == 1000 * ROWS[1][0]


@pytest.mark.parametrize("compress", [np.savez, np.savez_compressed])
def test_one_array_with_fields(tmp_path, compress):
    t, x, y, p = columns_of()
    rows = np.empty(
        len(t), [("y", "<f4"), ("extra", "S3"), ("x", ">u2"), ("t", "<f8"), ("on", "i1")]
    )
    rows["t"], rows["x"], rows["y"], rows["on"], rows["extra"] = t / 1e6, x, y, 2 * p - 1, b"abc"
    np.save(tmp_path / "f.npy", rows)
    assert read(tmp_path / "f.npy") == ROWS
    compress(tmp_path / "f.npz", events=rows)
    assert read(tmp_path / "f.npz") == ROWS
    stated = ColumnMap("x", "y", "t", "on", "ms")
    assert read(tmp_path / "f.npy", stated)[0][0] == ROWS[0][0] // 1000
    fields = ColumnMap("events[x]", "events[y]", "events[t]", "events[on]", "s")
    assert read(tmp_path / "f.npz", fields) == ROWS


def the_library():
    reason = "pyarrow is not installed (extra `parquet`)"
    pyarrow = pytest.importorskip("pyarrow", reason=reason)
    return pyarrow, pytest.importorskip("pyarrow.parquet", reason=reason)


def stated_file(path, kind):
    """Columns whose names nothing here knows, times in ns, polarity -1 and 1."""
    t, x, y, p = columns_of()
    columns = {"ev/ts": 1000 * t, "ev/xs": x, "ev/ys": y.astype(np.uint16), "ev/on": 2 * p - 1}
    match kind:
        case "hdf5":
            with h5py.File(path, "w") as file:
                for name, values in columns.items():
                    file[name] = values
        case "npz":
            with path.open("wb") as file:
                np.savez(file, other=np.zeros(3), **columns)
        case "csv":
            head = ",".join(["other", *columns])
            rows = np.stack([0 * t, *columns.values()], axis=1)
            np.savetxt(path, rows, "%d", ",", header=head, comments="")
        case "parquet":
            pyarrow, writer = the_library()
            writer.write_table(pyarrow.table(columns), path, row_group_size=999)
    return path


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hdf5", "npz", "csv", "parquet"])
def test_stated_columns_are_read_by_library_flags_and_recording(tmp_path, kind, capsys):
    path = stated_file(tmp_path / "f", kind)
    refused("set `columns`", open_events, path)
    assert open_events(path, MAP).format == kind
    assert read(path, MAP) == ROWS
    words = [str(path), *WORDS, "--quiet"]
    size = ["--width-px", "640", "--height-px", "480"]
    assert main(["convert", *words, str(tmp_path / "out.npz"), "--to", "npz", *size]) == 0
    assert read(tmp_path / "out.npz") == ROWS
    assert main(["info", str(path), *WORDS, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["streams"][0]["events"] == len(ROWS)
    assert main(["info", str(path)]) == 2


@pytest.mark.parametrize("kind", ["hdf5", "npz", "csv", "parquet"])
def test_a_recording_states_columns(tmp_path, kind):
    folder = rewritten(
        write_sequence(tmp_path / "ours", "pinhole", cameras=1), tmp_path / "a", "npz"
    )
    before = open_recording(folder)
    path = stated_file(folder / "f", kind)
    toml = folder / "recording.toml"
    head, _, tail = toml.read_text().partition("events = [\n")
    text = head + tail.partition("]\n")[2]
    text += f'\n[[events]]\nfile = "{path.name}"\ntime_unit = "ns"\n\n[events.columns]\n'
    toml.write_text(text + 'x = "ev/xs"\ny = "ev/ys"\nt = "ev/ts"\np = "ev/on"\n')
    recording = open_recording(folder)
    assert recording.event_span_us(0) == (ROWS[0][0], ROWS[-1][0])
    assert recording.rig.camera_names == before.rig.camera_names
    toml.write_text(text + 'x = "ev/xs"\ny = "ev/ys"\nt = "ev/ts"\n')
    refused(r"columns\.p", open_recording, folder)


def test_text_without_header_in_another_order(tmp_path):
    (tmp_path / "f.txt").write_text("# x y t p\n3 4 0.5 1\n5 6 0.75 -1\n")
    columns = ColumnMap("0", "1", "2", "3", "ms")
    assert read(tmp_path / "f.txt", columns) == [(500, 3, 4, 1), (750, 5, 6, 0)]
    (tmp_path / "g.txt").write_text("500 3 4 1\n")
    assert read(tmp_path / "g.txt", ColumnMap(time_unit="ms")) == [(500_000, 3, 4, 1)]


@pytest.mark.parametrize(("stated", "message"), [
    (("x=a,y=b,t=c", "us"), "p missing"),
    (("x=a,y=b,t=c,p=d", ""), "need one of s, ms, us, ns"),
    (("x=a,y=b,t=c,p=d", "min"), "need one of s, ms, us, ns"),
    (("x=a,y=b,t=c,p=d,q=e", "us"), "needs x=..., y=..., t=..., p=..., each once"),
    (("x=a,x=b,t=c,p=d", "us"), "each once"), (("x=a[,y=b,t=c,p=d", "us"), "needs a name"),
    (("", "min"), "one of"),
])  # fmt: skip
def test_statements_that_are_none(stated, message):
    refused(message, column_map, *stated)


@pytest.mark.parametrize("kind", ["hdf5", "npz", "csv", "parquet"])
def test_a_column_that_is_not_there_is_named(tmp_path, kind):
    path = stated_file(tmp_path / "f", kind)
    words = r"no (column|data set|separate column) none|0 columns none"
    refused([words, path], open_events, path, dataclasses.replace(MAP, x="none"))


TABLES = {"v2e", "e2calib", "npz", "npy", "mat", "parquet", "text", "esim-text", "csv"}


@pytest.mark.parametrize("kind", [kind for kind in ALL if kind not in TABLES])
def test_formats_that_say_what_they_hold_take_no_statements(tmp_path, kind):
    write_any(tmp_path / "f", kind, (640, 480), [naive.events_of(ROWS)])
    stated = [ColumnMap(time_unit="ns")]
    if kind not in ("dsec", "tumvie", "mvsec", "m3ed", "prophesee-hdf5"):
        stated.append(MAP)
    for columns in stated:
        refused(f"is {kind}, which defines.*leave", open_events, tmp_path / "f", columns)


BAD = {
    "N x 3": (np.zeros((5, 3), int), "N, 4"),
    "one row of numbers": (np.zeros(5), "N, 4"),
    "objects": (np.array([[1, "a"]], object), "N, 4|plain numbers"),
    "neither order": (np.full((5, 4), 70_000), "neither"),
    "NaN times": (np.array([[np.nan, 1, 2, 1]]), "neither"),
    "negative pixels": (np.array([[70_000, -1, 2, 1]]), "neither"),
    "polarity 2": (np.array([[70_000, 1, 2, 2]]), "neither"),
    "fields without time": (np.zeros(5, [("x", "u2"), ("y", "u2"), ("p", "?")]), "needs x, y"),
    "two times": (np.zeros(5, [(n, "u2") for n in ("x", "y", "p", "t", "ts")]), "needs x, y"),
    "an object field": (
        np.zeros(5, [("x", "u2"), ("y", "u2"), ("p", "?"), ("t", "O")]), "plain numbers|npy header",
    ),
    "text": (np.array([["a", "b", "c", "d"]]), "plain numbers"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
@pytest.mark.parametrize("kind", ["npy", "npz"])
def test_bad_arrays_end_in_one_line(tmp_path, name, kind):
    rows, message = BAD[name]
    with (tmp_path / "f").open("wb") as file:
        (np.save if kind == "npy" else np.savez)(file, rows)
    refused([message, tmp_path / "f"], open_events, tmp_path / "f")


LATER = {  # behind the rows that tell the order; one bad event in each
    "negative pixels": (1, -1, "whole pixels"), "fractions": (1, 0.5, "whole pixels"),
    "NaN times": (0, np.nan, "finite times"), "polarity 2": (3, 2, "0 or 1"),
    "negative times": (0, -1.0, "0 to 2"),
}  # fmt: skip


@pytest.mark.parametrize("name", LATER)
@pytest.mark.parametrize("kind", ["npy", "npz", "hdf5"])
def test_a_bad_event_in_front_is_refused_when_it_is_read(tmp_path, name, kind):
    column, value, message = LATER[name]
    rows = np.concatenate([matrix("txyp", float, 1e-6)] * 2)
    rows[3, column] = value
    reader = open_events(saved(tmp_path / "f", kind, rows))
    refused(message, list, reader.chunks("events"))


def test_unsorted_events_stay_as_the_file_holds_them(tmp_path):
    t, x, y, p = columns_of()
    k = np.random.default_rng(2).permutation(len(t))
    saved(tmp_path / "f", "npy", np.stack([t[k], x[k], y[k], p[k]], axis=1))
    assert read(tmp_path / "f") == [ROWS[j] for j in k]
    with h5py.File(tmp_path / "v2e.h5", "w") as file:
        file["events"] = np.stack([t[k], x[k], y[k], p[k]], axis=1).astype(np.uint32)
    assert read(tmp_path / "v2e.h5") == [ROWS[j] for j in k]


def test_e2calib_with_floating_times_needs_a_unit(tmp_path):
    t, x, y, p = columns_of()
    with h5py.File(tmp_path / "f", "w") as file:
        file["x"], file["y"], file["p"], file["t"] = x, y, p, t / 1e3
    refused("set `time_unit`", open_events, tmp_path / "f")
    assert read(tmp_path / "f", ColumnMap(time_unit="ms")) == ROWS
    assert read(tmp_path / "f", ColumnMap("x", "y", "t", "p", "ms")) == ROWS


def test_hdf5_rows_that_are_no_events(tmp_path):
    for rows in (np.zeros((5, 3)), np.zeros(4), np.array([b"abcd"] * 4)):
        with h5py.File(tmp_path / "f", "w") as file:
            file["events"] = rows
        refused(r"\(N, 4\), or set `columns`", open_events, tmp_path / "f")


def parquet_table(path, **changes):
    pyarrow, writer = the_library()
    t, x, y, p = columns_of()
    columns = {"t": t, "x": x, "y": y, "p": p} | changes
    table = pyarrow.table({name: values for name, values in columns.items() if values is not None})
    writer.write_table(table, path, row_group_size=777)
    return path


@pytest.mark.parametrize("unit", ["s", "ms", "us", "ns"])
def test_parquet_time_stamps_say_their_unit(tmp_path, unit):
    t = 1_000_000 * np.arange(5)
    stamps = (t // {"s": 10**6, "ms": 1000}.get(unit, 1) * (1000 if unit == "ns" else 1)).astype(
        f"datetime64[{unit}]"
    )
    x = np.arange(5)
    path = parquet_table(tmp_path / "f", t=stamps, x=x, y=x, p=x > 2)
    assert [row[0] for row in read(path)] == t.tolist()


@pytest.mark.parametrize(("changes", "message"), [
    ({"t": None}, "set `columns`"),
    ({"x": ["a"] * len(ROWS)}, "of type 'string'; needs plain numbers"),
    ({"x": [None, *range(1, len(ROWS))]}, "1 values of x are missing"),
    ({"t": np.full(len(ROWS), np.nan)}, "finite times"),
    ({"y": np.full(len(ROWS), -1)}, "whole pixels"),
    ({"p": np.full(len(ROWS), 2)}, "0 or 1"),
])  # fmt: skip
def test_bad_parquet_ends_in_one_line(tmp_path, changes, message):
    path = parquet_table(tmp_path / "f", **changes)
    refused([message, path], lambda: list(open_events(path).chunks("events")))


def test_parquet_without_its_library_says_how_to_get_it(tmp_path, monkeypatch):
    (tmp_path / "f").write_bytes(b"PAR1" + bytes(90))
    monkeypatch.delitem(sys.modules, "pyarrow.parquet", raising=False)
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    refused(r"needs pyarrow, which .*pip install 'pyarrow", open_events, tmp_path / "f")
