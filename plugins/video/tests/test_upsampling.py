"""Frames of others between frames: taken where they belong, refused where they do not."""

import numpy as np
import pytest

from eventsweep.plugins.video import film
from eventsweep.plugins.video.film import find_upsampler
from eventsweep.plugins.video.record import record
from eventsweep.sim.config import PixelConfig, VideoConfig
from refusals import refused
from video_files import drifting, events_of, rows, write_folder

BLEND = """
def blend(before, after, t0_us, t1_us):
    for k in range(1, 4):
        share = k / 4
        image = (1 - share) * before + share * after
        yield t0_us + round(share * (t1_us - t0_us)), image.astype(before.dtype)
"""


@pytest.fixture
def logs(tmp_path):
    """Logarithms of light, as floats."""
    rng = np.random.default_rng(3)
    frames = rng.uniform(-4, 0, (5, 6, 8)).astype(np.float32)
    return write_folder(tmp_path / "in", frames, [f"{k / 100:.2f}" for k in range(5)], ".npy")


@pytest.fixture
def blend(tmp_path):
    (tmp_path / "blend.py").write_text(BLEND)
    return f"{tmp_path}/blend.py:blend"


def made(source, out, name=None, **values):
    video = VideoConfig(upsample=name, **values)
    return record(source, out, PixelConfig(log_eps=1e-12), video)


def test_frames_on_the_straight_line_change_nothing(tmp_path, logs, blend):
    """The sensor draws the line in the logarithm itself, but for float32's rounding."""
    plain = made(logs, tmp_path / "a", encoding="log")
    more = made(logs, tmp_path / "b", blend, encoding="log")
    assert (plain.frames, more.frames) == (5, 17)
    a, b = (sorted((y, x, p, t) for t, y, x, p in rows(events_of(tmp_path / k))) for k in "ab")
    assert len(a) == len(b) == plain.events > 500
    assert [row[:3] for row in a] == [row[:3] for row in b]
    np.testing.assert_allclose([row[3] for row in a], [row[3] for row in b], atol=1)


def test_it_is_given_what_the_files_hold(tmp_path, monkeypatch):
    frames = drifting(3, colour=True)
    folder = write_folder(tmp_path / "in", frames, ["0.5", "0.6", "0.8"])
    calls = []

    def spy(before, after, t0_us, t1_us):
        calls.append((before.copy(), after.copy(), t0_us, t1_us))
        return [(t0_us + 1, before)]

    monkeypatch.setattr(film, "find_upsampler", None)
    monkeypatch.setattr("eventsweep.plugins.video.film.find_upsampler", lambda name: spy)
    assert made(folder, tmp_path / "out", "spy").frames == 5
    assert [call[2:] for call in calls] == [(500_000, 600_000), (600_000, 800_000)]
    np.testing.assert_array_equal([call[0] for call in calls], frames[:2])
    np.testing.assert_array_equal([call[1] for call in calls], frames[1:])


@pytest.mark.parametrize(("body", "message"), [
    ("raise RuntimeError('no\\nGPU')", r"between 0\.npy and 1\.npy fails \(no GPU\)"),
    ("yield t0_us, a", "a frame at 0 µs; needs increasing times between 0 and 10000"),
    ("yield t1_us, a", "a frame at 10000 µs"), ("yield 5, a; yield 5, a", "a frame at 5 µs"),
    ("yield 5, a[1:]", r"a frame \(5, 8\) of float32; needs \(6, 8\)"),
    ("yield 5, a.astype('float64')", "of float64; needs"),
    ("yield 5", r"needs pairs \(t_us, frame\)"),
    ("yield 'soon', a", r"needs pairs \(t_us, frame\)"),
    ("yield 5, a; 1 / 0", r"fails \(division by zero\)"),
    ("return 7", r"fails \('int' object is not iterable\)"),
])  # fmt: skip
def test_what_does_not_belong_is_refused_and_nothing_is_left(tmp_path, logs, body, message):
    (tmp_path / "bad.py").write_text(f"def bad(a, b, t0_us, t1_us):\n    {body}\n")
    refused(message, made, logs, tmp_path / "out", f"{tmp_path}/bad.py:bad", encoding="log")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("name", "message"), [
    ("no_such_module_at_all:f", "cannot be imported"),
    ("math:no_such", "cannot be imported"), ("math:pi", "needs a function"),
    ("gone.py:f", "cannot be imported"), ("here.py:g", "here.py has no function g"),
    ("broken.py:f", "cannot be imported"),
    ("film", "needs MODULE:FUNCTION or FILE.py:FUNCTION"),
])  # fmt: skip
def test_names_of_nothing_are_refused(tmp_path, monkeypatch, name, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "here.py").write_text("f = min\n")
    (tmp_path / "broken.py").write_text("def f(:\n")
    refused(message, find_upsampler, name)


def test_a_module_and_an_entry_point_are_found(monkeypatch):
    class Point:
        name = "film"

        def load(self):
            return max

    assert find_upsampler("builtins:min") is min
    monkeypatch.setattr(film, "entry_points", lambda group: [Point()] * (group == film.GROUP))
    assert find_upsampler("film") is max
    refused("registered are film", find_upsampler, "rife")
