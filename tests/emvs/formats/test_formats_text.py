"""Texts of events as programs of the field write them: headers, comments, units, words."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import naive_formats as naive
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.formats import open_events
from eventsweep.emvs.formats.tables.columns import ColumnMap
from refusals import refused

ROWS = [(1_000_000, 1, 2, 1), (1_500_000, 3, 4, 0), (2_000_000, 5, 6, 1)]
SCALE = {"s": 1e-6, "ms": 1e-3, "us": 1, "ns": 1000}


def read(path, columns=None):
    reader = open_events(path, columns)
    return naive.rows_of(Events.concat(list(reader.chunks("events"))))


def wrote(path, text, encoding="utf-8"):
    path.write_bytes(text.encode(encoding))
    return path


def lines(order, unit="us", gap=",", index=False):
    text = ""
    for k, row in enumerate(ROWS):
        named = dict(zip("txyp", row, strict=True))
        named["t"] = f"{named['t'] * SCALE[unit]:.6f}" if unit == "s" else round(
            named["t"] * SCALE[unit])  # fmt: skip
        text += gap.join([str(k)] * index + [str(named[c]) for c in order]) + "\n"
    return text


TEXTS = {
    "pandas": ",x,y,t,p\n" + lines("xytp", index=True),
    "pandas, tabs": "\tx\ty\tt\tp\n" + lines("xytp", gap="\t", index=True),
    "pandas, saved twice": "Unnamed: 0,x,y,t,p\n" + lines("xytp", index=True),
    "R": '"","x","y","t","p"\n' + lines("xytp", index=True),
    "metavision": "%geometry:1280,720\n" + lines("xypt"),
    "brackets": "timestamp [ns],x [px],y [px],polarity []\n" + lines("txyp", "ns"),
    "parentheses, blanks": "time(ms) x y pol\n" + lines("txyp", "ms", " "),
    "nsec": "x;y;p;ts_nsec\n" + lines("xypt", "ns", ";"),
    "a comment of another order": "# x y p t\n" + lines("xypt", gap=" "),
    "a comment with a unit": "# events of cam0\n# t[s] x y p\n" + lines("txyp", "s", " "),
    "a comment that names ns": "# t_ns, x, y, p\n" + lines("txyp", "ns"),
    "MATLAB": "% x y t p\n" + lines("xytp", gap=" "),
    "a comment of no columns": "# made by hand, x to the right\n" + lines("txyp", gap=" "),
    "two columns of time": "secs,nsecs,x,y,p\n1,0,1,2,1\n1,500000000,3,4,0\n1,999999999,5,6,1\n",
    "upper case": "Timestamp,X,Y,Polarity\n" + lines("txyp"),
    "faery": "t,x@1280,y@720,on\n" + lines("txyp"),
    "whole seconds": "t_s,x,y,p\n1,1,2,1\n1.5,3,4,0\n2,5,6,1\n",
}


@pytest.mark.parametrize("name", TEXTS)
@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("end", ["\n", "\r\n"])
def test_texts_of_the_field(tmp_path, name, encoding, end):
    path = wrote(tmp_path / "f", TEXTS[name].replace("\n", end), encoding)
    assert read(path) == ROWS
    sized = name in ("metavision", "faery")
    assert open_events(path).width_px == (1280 if sized else None)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig"])
@pytest.mark.parametrize("text", [lines("txyp", gap=" "), lines("txyp", "s"), "# t x y p\n" + lines(
    "txyp", gap="\t"), "240 180\n" + lines("txyp", "s", " ")])  # fmt: skip
def test_texts_without_names(tmp_path, text, encoding):
    path = wrote(tmp_path / "f", text, encoding)
    assert read(path) == ROWS
    assert open_events(path).format == ("esim-text" if text.startswith("240") else "text")


@given(st.permutations("txyp"), st.sampled_from(list(SCALE)), st.sampled_from(",; \t"),
       st.booleans(), st.sampled_from(["", "x", "n", "1"]))  # fmt: skip
def test_every_order_is_read_by_its_header(tmp_path_factory, order, unit, gap, is_comment, more):
    names = [f"t_{unit}" if c == "t" else c for c in order] + ["other"] * bool(more)
    body = lines(order, unit, gap)
    body = body.replace("\n", f"{gap}{more}\n") if more else body
    head = "# " * is_comment + gap.join(names) + "\n"
    path = wrote(tmp_path_factory.mktemp("text") / "f", head + body)
    assert read(path) == ROWS


@pytest.mark.parametrize(("yes", "no"), [("True", "False"), ("true", "false"), ("TRUE", "FALSE")])
def test_polarity_in_words(tmp_path, yes, no):
    text = lines("txyp").replace(",1\n", f",{yes}\n").replace(",0\n", f",{no}\n")
    assert read(wrote(tmp_path / "f", f"timestamp,x,y,polarity\n{text}")) == ROWS
    assert read(wrote(tmp_path / "f", text)) == ROWS
    for word in ("Trues", "Tru", "t", "yes", "ON", "Truf", "nan", "None"):
        bad = wrote(tmp_path / "f", f"t,x,y,p\n{text}3000000,1,1,{word}\n")
        refused("line 5.*is not an event", read, bad)


@pytest.mark.parametrize(("head", "body", "times"), [
    ("t_us,x,y,p", "1000,2,3,2", "µs, as stated"), ("t_ns,x,y,p", "1000,2,3,2", "ns, as stated"),
    ("timestamp [ms],x,y,p", "1000,2,3,2", "ms, as stated"),
    ("t,x,y,p", "1000,2,3,2", "a whole number of µs, as the file begins"),
    ("t,x,y,p", "0.5,2,3,2", "seconds, as the file begins"),
    ("t_s,x,y,p", "1000,2,3,2", "seconds, as stated"),
])  # fmt: skip
def test_a_refusal_names_the_unit_that_was_read(tmp_path, head, body, times):
    refused(rf"\({times}\)", read, wrote(tmp_path / "f", f"{head}\n{body}\n"))


@pytest.mark.parametrize(("text", "columns", "words"), [
    ("t_us,x,y,p\n1,2,3,1\n", ColumnMap(time_unit="ns"), "counts time in us, the setting in ns"),
    ("# t [s] x y p\n1 2 3 1\n", ColumnMap(time_unit="us"), "counts time in s"),
    ("t,x,y,p\n1,2,3,1\n", ColumnMap("y", "x", "t", "p", "us"), "column y is stated as x"),
    ("# x y t p\n1 2 3 1\n", ColumnMap("1", "2", "0", "3", "us"), "stated as x, but its name"),
    ("x,y,t,t_ns,p\n1,2,3,4,1\n", None, "t twice"), ("x,y,t\n1,2,3\n", None, "lacks p"),
    ("# t x y\n1 2 3 1\n# z\n", ColumnMap("0", "1", "2", "3", "us"), None),
    ("# t x y q\n1 2 3 1\n", None, "lacks p"), ("t [frames],x,y,p\n1,2,3,1\n", None, "not read"),
    ("secs,x,y,p\n1,2,3,1\n", ColumnMap(time_unit="ms"), "counts time in s"),
])  # fmt: skip
def test_headers_that_contradict_are_refused(tmp_path, text, columns, words):
    path = wrote(tmp_path / "f", text)
    if words is None:
        assert read(path, columns)
    else:
        refused([words, "f"], read, path, columns)


def test_stated_columns_whose_name_says_another_unit_are_refused():
    refused("counts time in ns, the setting in us", ColumnMap, "x", "y", "t_ns", "p", "us")
    refused("counts time in s", ColumnMap, "x", "y", "ev[t_s]", "p", "us")
    assert ColumnMap("x", "y", "ev/t_ns", "p", "ns").unit_s == 1e-9


EPOCH_S = 1_600_000_000


@pytest.mark.parametrize("kind", ["csv", "text", "npz", "npy", "rows"])
@pytest.mark.parametrize(("scale", "fits"), [(10**9, "ns"), (10**6, None)])
def test_whole_times_without_a_unit_that_cannot_be_microseconds(tmp_path, kind, scale, fits):
    t = EPOCH_S * scale + np.array([0, 100_000_000 * scale // 10**9])
    path, one = tmp_path / "f", np.ones(2, np.uint16)
    if kind in ("csv", "text"):
        head = "t,x,y,p\n" if kind == "csv" else ""
        wrote(path, head + "".join(f"{time},1,1,1\n" for time in t))
    else:
        with path.open("wb") as file:
            if kind == "npz":
                np.savez(file, t=t, x=one, y=one, p=one)
            elif kind == "npy":
                fields = np.zeros(2, [("t", "i8"), ("x", "u2"), ("y", "u2"), ("p", "u1")])
                fields["t"] = t
                np.save(file, fields)
            else:
                np.save(file, np.stack([t, one, one, one], axis=1))
    if fits is None:
        assert read(path)[0][0] == EPOCH_S * 10**6
    else:
        said = refused("as µs, reach the year 526", read, path)
        assert f"set `time_unit` to {fits}" in said
        assert read(path, ColumnMap(time_unit=fits))[0][0] == EPOCH_S * 10**6


def test_names_with_a_unit_are_known_in_archives(tmp_path):
    for name, unit in (("timestamp_ns", 1000), ("time_us", 1), ("ts_ms", 1e-3)):
        one = np.ones(3, np.uint16)
        t = (unit * np.array([1_000_000, 2_000_000, 3_000_000])).astype(np.int64)
        np.savez(tmp_path / "f.npz", x=one, y=one, p=one, **{name: t})
        assert [row[0] for row in read(tmp_path / "f.npz")] == [1_000_000, 2_000_000, 3_000_000]
        refused("the setting in s", open_events, tmp_path / "f.npz", ColumnMap(time_unit="s"))


@pytest.mark.parametrize("data", [
    lines("txyp").encode("utf-16"), "t,x,y,p\n1,2,3,1\n".encode("utf-32"),
])  # fmt: skip
def test_other_encodings_are_named(tmp_path, data):
    (tmp_path / "f").write_bytes(data)
    refused("UTF-16 or UTF-32; save it as UTF-8", open_events, tmp_path / "f")


def test_a_raw_file_stays_one_whatever_its_words(tmp_path):
    words = np.array([0x8000, 0x6005, 0x2003], "<u2").tobytes()
    wrote(tmp_path / "f", "% evt 3.0\n% geometry 640x480\n% end\n")
    with (tmp_path / "f").open("ab") as file:
        file.write(words)
    assert open_events(tmp_path / "f").format == "evt3"
