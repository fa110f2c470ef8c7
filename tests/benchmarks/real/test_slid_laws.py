"""Restamped events are seen from where their pixels saw them, at the law's times."""

import argparse

import numpy as np
import pytest

import line_world
import point_world
from slid_laws import Law, Restamped
from track_slider import Cell, law_of, table

LAWS = [Law(), Law(faster=3), Law(waves=2), Law(stops=2), Law(faster=2, waves=1, back=True)]


@pytest.fixture(scope="module")
def recording():
    return line_world.recorded(point_world.sideways())


def places(path, t_us):
    return path.at(t_us)[:, :3, 3]


@pytest.mark.parametrize("law", LAWS, ids=str)
def test_every_event_is_seen_from_where_it_was(recording, law):
    restamped, (first_us, last_us) = Restamped(recording, law), recording.event_span_us(0)
    for camera in range(2):
        before, now = recording.events(camera, first_us, last_us), restamped._streams[camera]
        count = len(before)
        ends_us = restamped.trajectory.span_us
        inside = (now.t_us[:count] >= ends_us[0]) & (now.t_us[:count] <= ends_us[1])
        found = places(restamped.trajectory, now.t_us[:count][inside])
        np.testing.assert_allclose(
            found, places(recording.trajectory, before.t_us[inside]), atol=1e-3
        )
        assert (np.diff(now.t_us) >= 0).all()
        if law.back:
            np.testing.assert_array_equal(now.x[count:], before.x[::-1])
            np.testing.assert_array_equal(now.p[count:], 1 - before.p[::-1])
            turned = now.t_us[count:][::-1] + now.t_us[:count]
            assert len(set(turned.tolist())) == 1
    took_us = (last_us - first_us) / law.faster * (1 + law.back)
    assert restamped.event_span_us(0)[1] - first_us == pytest.approx(took_us, rel=0.05)


@pytest.mark.parametrize(
    ("law", "ratio"), [(Law(waves=3), 1.8 / 0.2), (Law(stops=3), 1 / 0.01)], ids=str
)
def test_the_fastest_and_the_slowest_differ_as_the_law_says(law, ratio):
    took_us = np.diff(law.times_us(np.arange(0, 100_000_001, 10_000), (0, 100_000_000)))
    assert took_us.max() / took_us.min() == pytest.approx(ratio, rel=0.02)


def test_a_law_is_read_from_its_words():
    assert law_of("2.5") == Law(faster=2.5)
    assert law_of("2,waves3,back") == Law(faster=2, waves=3, back=True)
    assert str(law_of("stops4")) == "×1, 4 stops"


@pytest.mark.parametrize("text", ["nonsense", "0", "-2", "nan", "wavesx", "waves-1", ""])
def test_another_word_is_refused_with_what_is_needed(text):
    with pytest.raises(argparse.ArgumentTypeError, match="needs a factor of speed above 0"):
        law_of(text)


def test_a_table_counts_what_is_wrong():
    cells = [Cell(0.2, 0.1, is_wrong=False), Cell(9.0, 0.6, is_wrong=True)]
    text = table([(Law(), cells)], [0.05], [0.1])
    assert "| Speed | 5 cm | three, 10 cm |" in text
    assert "| ×1 | 0.20 | 9.00 (doubted) **wrong** |" in text
    assert "In the median 4.60 %, 9.00 % at worst; silently wrong: 1 of 2." in text
