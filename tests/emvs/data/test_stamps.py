"""Files of times: every layout of the field, exact to the microsecond, and nothing guessed."""

from decimal import Decimal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eventsweep.emvs.data.stamps import read_stamps
from refusals import refused

US = [0, 33_333, 1_600_000_000_123_457]


@pytest.mark.parametrize(
    ("text", "unit", "names"),
    [
        ("0.0\n0.033333\n1600000000.123457\n", "s", ()),  # vid2e
        ("0.0 a.png\n0.033333 b.png\n1600000000.123457 c d.png", "s",
         ("a.png", "b.png", "c d.png")),
        ("# timestamp [ns],filename\n0,a.png\n33333000,b.png\n1600000000123457000,c.png\n", "ns",
         ("a.png", "b.png", "c.png")),
        ("timestamp_us\n0\n33333\n1600000000123457\n", "us", ()),
        ("t (ms)\n0\n33.333\n1600000000123.457\n\n", "ms", ()),
        ("# color images\n# file: 'x.bag'\n# timestamp filename\n0.0 a.png # first\n"
         "0.033333 b.png\n1600000000.123457 c.png", "s", ("a.png", "b.png", "c.png")),  # TUM RGB-D
    ],
)  # fmt: skip
def test_layouts_of_the_field(tmp_path, text, unit, names):
    path = tmp_path / "t.txt"
    path.write_text(text)
    stamps = read_stamps(path)
    assert list(stamps.t_us) == US
    assert (stamps.unit, stamps.names) == (unit, names)


@given(
    st.lists(st.integers(-(2**61), 2**61), min_size=1, max_size=5),
    st.sampled_from(["s", "ms", "us", "ns"]),
)
def test_a_written_time_comes_back_exactly(tmp_path_factory, times_us, unit):
    path = tmp_path_factory.mktemp("stamps") / "t.txt"
    power = {"s": -6, "ms": -3, "us": 0, "ns": 3}[unit]
    path.write_text("\n".join(f"{Decimal(t).scaleb(power):f}" for t in times_us))
    assert list(read_stamps(path, unit).t_us) == times_us


@pytest.mark.parametrize(("text", "message"), [
    ("", "no times"), ("# nothing\n\n", "no times"),
    ("0\n33333\n66667\n", "times such as 66667 have no unit: set unit to s, ms, us or ns"),
    ("a.png 0.5\nb.png 0.6", "no times|is not a time"),
    ("0.5\nhalf\n", "line 2: half is not a time"),
    ("0.5 a.png\n0.6\n", "1 of 2 lines name an image"),
    ("0.5\nnan\n", "below 2|is not a time"), ("0.5\ninf\n", "below 2|is not a time"),
    ("0.5\n1e999999999\n", "below 2|is not a time"),
    ("0.5\n1e400\n", "below 2|is not a time"),
    ("0.5\n" + "9" * 5000, "below 2|is not a time"), (b"\x89PNG\xff\xfe", "not a text file"),
    (None, "No such file"),
])  # fmt: skip
def test_what_is_no_file_of_times_is_refused_in_one_line(tmp_path, text, message):
    path = tmp_path / "t.txt"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    said = refused(message, read_stamps, path)
    assert len(said) < 400
