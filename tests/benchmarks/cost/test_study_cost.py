import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cost_limits
from cost_growth import Growth, Load, growth
from cost_limits import SENSORS, Figure, LimitsEffort
from cost_stream import WINDOW_US, MovingEdges
from eventsweep.emvs.errors import InputError
from markdown_blocks import into_page
from study_cost import growth_table, limit_table

TINY = Load(events=2000, planes=4, width_px=32)


@given(
    exponent=st.floats(-2, 2), factor=st.floats(0.01, 100),
    amounts=st.lists(st.integers(1, 10**6), min_size=2, max_size=6, unique=True),
)  # fmt: skip
def test_the_fit_finds_a_power_law(exponent, factor, amounts):
    seconds = tuple(factor * amount**exponent for amount in amounts)
    grown = Growth("events", tuple(amounts), seconds)
    assert grown.exponent == pytest.approx(exponent, abs=1e-6)
    assert grown.last_exponent == pytest.approx(exponent, abs=1e-6)


def test_every_series_is_measured_around_the_load():
    series = {"pixels": (16, 32), "windows": (1, 2), "cameras": (1, 3)}
    grown = growth(TINY, series, 1)
    assert [one.quantity for one in grown] == list(series)
    assert grown[0].amounts == (16 * 12, 32 * 24)
    assert all(second > 0 for one in grown for second in one.seconds)
    assert growth_table(grown).count("\n") == 5


def test_windows_and_cameras_hold_the_events_that_are_asked_for():
    recording = MovingEdges((32, 24), 500, cameras=3, windows=2)
    for camera in range(3):
        for window in range(2):
            begin = window * WINDOW_US
            events = recording.events(camera, begin, begin + WINDOW_US)
            assert len(events) == 500
            assert (int(events.t_us[0]), int(events.t_us[-1])) == (begin, begin + WINDOW_US - 1)
            events.checked(32, 24)
    assert recording.trajectory.span_us[1] >= recording.event_span_us(0)[1]


def test_the_same_events_come_every_time():
    one, other = (MovingEdges((32, 24), 500).events(1, 0, WINDOW_US) for _ in range(2))
    for name in ("x", "y", "t_us", "p"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@pytest.mark.parametrize(
    ("value", "better", "held"),
    [(1.0, "lower", True), (2.1, "lower", False), (2.0, "higher", True), (1.9, "higher", False)],
)
def test_a_limit_has_a_side(value, better, held):
    assert Figure("cost", value, "ns", 2.0, better).is_held is held
    assert ("yes" if held else "**no**") in limit_table([Figure("cost", value, "ns", 2.0, better)])


def test_a_figure_without_a_limit_is_neither():
    assert Figure("cost", 1.0, "ns").is_held is None
    assert "| cost | 1.00 ns | – | – |" in limit_table([Figure("cost", 1.0, "ns")])


def test_the_votes_of_every_sensor_are_measured(monkeypatch):
    monkeypatch.setattr(cost_limits, "_PLANES_TIMED", 2)
    effort = LimitsEffort(vote_events=2000, rounds=1, touchy_rounds=1)
    figures = [one for sensor in SENSORS for one in cost_limits._votes(sensor, effort)]
    figures += cost_limits._threads(effort)
    shown = limit_table(figures)
    for sensor in SENSORS:
        for kind in ("bilinear", "nearest"):
            assert f"| {kind} vote, {sensor} |" in shown


def test_a_page_keeps_what_is_around_its_marks(tmp_path):
    page = tmp_path / "page.md"
    page.write_text("a\n<!-- x: begin -->\nold\n<!-- x: end -->\nb\n", encoding="utf-8")
    for _ in range(2):
        into_page(page, "x", "new")
    assert page.read_text() == "a\n<!-- x: begin -->\n\nnew\n<!-- x: end -->\nb\n"
    with pytest.raises(InputError, match="y: begin"):
        into_page(page, "y", "new")
