"""Draws one picture per effect of the sensor, from runs of the sensor itself.

Run: python docs/figures/draw_sensor.py [FOLDER]; the folder is docs/images unless given.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_samples import EPS, flat, gaps_us, per_pixel, run

from eventsweep.emvs.data.events import Events
from eventsweep.sim.config import SimConfig
from eventsweep.sim.sensor.labels import Label
from eventsweep.sim.sensor.sensor import Sensor
from eventsweep.sim.sensor_presets import SensorParameters

# Okabe and Ito's colours, distinguishable to everybody.
_BLUE, _ORANGE, _GREEN, _PINK, _GREY = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#777777"


def mismatch(axes: Any) -> None:
    """Thresholds recovered from event counts on ramps, both polarities."""
    shape = (50, 50)
    low, high = flat(np.exp(-8), shape), flat(np.exp(8), shape)
    span = float(np.log(high[0, 0] + EPS) - np.log(low[0, 0] + EPS))
    events, _, _ = run([low, high, low], [0, 10**6, 2 * 10**6], threshold_sigma=0.02)
    rank = np.linspace(0, 1, shape[0] * shape[1])
    for p, colour, name in ((1, _BLUE, "C⁺ (rise)"), (0, _ORANGE, "C⁻ (fall)")):
        mine = events.p == p
        part = Events(events.x[mine], events.y[mine], events.t_us[mine], events.p[mine])
        measured = np.sort(span / (per_pixel(part, shape) + 0.5))
        axes[0].step(measured, rank, color=colour, label=name)
    x = np.linspace(0.13, 0.27, 200)
    normal = np.exp(-(((x - 0.2) / 0.02) ** 2) / 2)
    axes[0].plot(x, np.cumsum(normal) / normal.sum(), "--", color="black", label="N(0.2, 0.02)")
    axes[0].set(xlabel="threshold from counts on a ramp", ylabel="share of the pixels")
    axes[1].imshow(per_pixel(events, shape).reshape(shape), cmap="cividis")
    axes[1].set(title="events per pixel, uniform light", xticks=[], yticks=[])


def thresholds(axes: Any) -> None:
    """One pixel under a triangle of log intensity, C- twice C+."""
    times_us = list(range(0, 40_001, 100))
    wave = np.abs((np.array(times_us) / 20_000) % 2 - 1)
    log = -3 + 2 * (1 - wave)
    config = SimConfig(contrast_threshold_pos=0.15, contrast_threshold_neg=0.3, log_eps=EPS)
    sensor = Sensor(0, 1, 1, config, 0)
    frames = [flat(np.exp(v) - EPS, (1, 1)) for v in log]
    sensor.start(frames[0], 0)
    steps = [sensor.step(f, t).events for f, t in zip(frames[1:], times_us[1:], strict=True)]
    events = Events.concat(steps)
    axes[0].plot(np.array(times_us) / 1e3, log, color=_GREY, label="log intensity")
    at = np.interp(events.t_us, times_us, log)
    for p, colour, mark, name in ((1, _BLUE, "^", "C⁺ = 0.15"), (0, _ORANGE, "v", "C⁻ = 0.3")):
        mine = events.p == p
        axes[0].plot(events.t_us[mine] / 1e3, at[mine], mark, color=colour, ms=5, label=name)
    axes[0].set(xlabel="time (ms)", ylabel="ln(I + ε)")


def bandwidth(axes: Any) -> None:
    """Events of a step in bright and in dim light, and the rates of a flicker over frequency."""
    times_us = list(range(0, 20_001, 50))
    for level, colour in ((1.0, _BLUE), (0.2, _ORANGE), (0.02, _GREEN)):
        frames = [flat(level * (4 if t > 2000 else 1) / 4, (1, 1)) for t in times_us]
        events, _, _ = run(frames, times_us, bandwidth_hz=300)
        count = np.arange(1, len(events) + 1)
        axes[0].step(events.t_us / 1e3, count, where="post", color=colour, label=f"to I = {level}")
    axes[0].axvline(2, color=_GREY, lw=0.8, ls=":")
    axes[0].set(xlabel="time (ms)", ylabel="events of a fourfold step", xlim=(0, 20))
    hertz = np.geomspace(10, 2000, 12)
    for order, colour in ((1, _BLUE), (2, _ORANGE)):
        share = [_flicker(f, bandwidth_hz=300, bandwidth_order=order) / _flicker(f) for f in hertz]
        axes[1].semilogx(hertz, share, "o-", ms=3, color=colour, label=f"{order} pole(s)")
    axes[1].set(xlabel="flicker (Hz)", ylabel="share of the ideal events")


def _flicker(frequency_hz: float, **sensor: Any) -> int:
    phase = np.linspace(0, 10, 601)
    times_us = np.rint(1e6 * phase / frequency_hz).astype(int).tolist()
    frames = [flat(0.4 * np.exp(1.5 * np.sin(2 * np.pi * x)), (1, 1)) for x in phase]
    return len(run(frames, times_us, **sensor)[0])


def leak(axes: Any) -> None:
    """Times and intervals of leak events."""
    times_us, shape = list(range(0, 20_000_001, 10_000)), (30, 30)
    frames = [flat(0.3, shape)] * len(times_us)
    events, _, _ = run(frames, times_us, leak_rate_hz=5, leak_jitter=0.1)
    row = events.y == 0
    axes[0].plot(events.t_us[row] / 1e6, events.x[row], ".", ms=3, color=_BLUE)
    axes[0].set(xlabel="time (s)", ylabel="pixel", xlim=(0, 4))
    gaps_ms = gaps_us(events) / 1e3
    axes[1].hist(gaps_ms, 60, density=True, color=_BLUE, alpha=0.6, label="intervals")
    x = np.linspace(120, 280, 200)
    model = np.exp(-(((x - 200) / 20) ** 2) / 2) / (20 * np.sqrt(2 * np.pi))
    axes[1].plot(x, model, color="black", label="model, 5 Hz, 10 %")
    axes[1].set(xlabel="time from leak to leak (ms)", yticks=[])


def shot(axes: Any) -> None:
    """Rate of shot noise over intensity, and its intervals in the dark."""
    ramp = np.repeat(np.linspace(0, 1.5, 60, dtype=np.float32)[None], 60, 0)
    events, _, _ = run([ramp, ramp], [0, 60_000_000], shot_rate_dark_hz=4, shot_rate_bright_hz=1)
    rate_hz = np.bincount(events.x, minlength=60) / 60 / 60
    axes[0].plot(ramp[0], rate_hz, ".", color=_BLUE, label="measured")
    axes[0].plot(ramp[0], 4 - 3 * np.clip(ramp[0], 0, 1), color="black", label="model")
    axes[0].set(xlabel="intensity", ylabel="events per pixel (Hz)", ylim=(0, 5))
    dark = events.x == 0
    part = Events(events.x[dark], events.y[dark], events.t_us[dark], events.p[dark])
    axes[1].hist(gaps_us(part) / 1e6, 40, density=True, color=_BLUE, alpha=0.6, label="in black")
    x = np.linspace(0, 2, 100)
    axes[1].plot(x, 4 * np.exp(-4 * x), color="black", label="Poisson, 4 Hz")
    axes[1].set(xlabel="time from event to event (s)", yticks=[], xlim=(0, 2))


def hot_pixels(axes: Any) -> None:
    """Where hot pixels are, among other noise."""
    shape = (60, 80)
    events, labels, _ = run(
        [flat(0.2, shape)] * 2, [0, 1_000_000], shot_rate_dark_hz=5, shot_rate_bright_hz=1,
        hot_pixel_fraction=2e-3, hot_pixel_rate_hz=100,
    )  # fmt: skip
    counts = per_pixel(events, shape).reshape(shape)
    axes[0].imshow(np.log10(1 + counts), cmap="cividis")
    axes[0].set(title="log₁₀(1 + events) in 1 s", xticks=[], yticks=[])
    bins = np.arange(0, 150, 3)
    hot = np.unique(np.stack([events.y, events.x])[:, labels == Label.HOT], axis=1)
    mask = np.zeros(shape, bool)
    mask[hot[0], hot[1]] = True
    axes[1].hist(counts[~mask], bins, color=_GREY, label="other pixels")
    axes[1].hist(counts[mask], bins, color=_ORANGE, label="hot pixels")
    axes[1].set(xlabel="events per pixel in 1 s", ylabel="pixels", yscale="log")


def refractory(axes: Any) -> None:
    """Intervals of a noisy pixel with and without silence after every event."""
    times_us = [0, 20_000_000]
    for silence_us, colour in ((0, _GREY), (2000, _BLUE)):
        events, _, _ = run([flat(0, (20, 20))] * 2, times_us, silence_us, shot_rate_dark_hz=200)
        axes[0].hist(gaps_us(events) / 1e3, np.arange(0, 15, 0.25), color=colour, alpha=0.6,
                     label=f"{silence_us / 1000:g} ms")  # fmt: skip
    axes[0].set(xlabel="time from event to event (ms)", ylabel="events")


def latency(axes: Any) -> None:
    """Delays of one edge in three lights, and their mean over intensity."""
    settings = {"latency_us": 50.0, "latency_jitter": 0.3}
    for level, colour in ((1.0, _BLUE), (0.2, _ORANGE), (0.02, _GREEN)):
        delay_us = _delays_us(level, **settings)
        axes[0].hist(delay_us, np.arange(0, 900, 10), density=True, color=colour, alpha=0.6,
                     label=f"I = {level}")  # fmt: skip
    axes[0].set(xlabel="latency (µs)", yticks=[], xlim=(0, 900))
    levels, dark = np.geomspace(0.005, 4, 15), SensorParameters().dark_level
    mean_us = [_delays_us(level, **settings).mean() for level in levels]
    axes[1].loglog(levels, mean_us, "o", ms=4, color=_BLUE, label="measured")
    axes[1].loglog(levels, 50 * (1 + dark) / (levels + dark), color="black", label="model")
    axes[1].set(xlabel="intensity", ylabel="mean latency (µs)")


def _delays_us(level: float, **sensor: Any) -> NDArray[np.int64]:
    end = flat(level, (60, 60))
    # One crossing, between 0 and 100 µs.
    start = (end + EPS) * np.float32(np.exp(-0.3)) - np.float32(EPS)
    frames, times_us = [start, end, end], [0, 100, 10**6]
    ideal, _, _ = run(frames, times_us)
    events, _, _ = run(frames, times_us, **sensor)
    delays: NDArray[np.int64] = events.t_us - ideal.t_us[0]
    return delays


def readout(axes: Any) -> None:
    """A flash over the whole sensor through a limited read-out."""
    shape, times_us = (100, 100), list(range(0, 20_001, 200))
    light = [0.2 + 0.6 * np.exp(-(((t - 5000) / 1500) ** 2)) for t in times_us]
    frames = [flat(level, shape) for level in light]
    ideal, _, _ = run(frames, times_us, threshold_sigma=0.02)
    events, _, sensor = run(
        frames, times_us, threshold_sigma=0.02, readout_events_per_s=8e6,
        readout_rows_per_s=2e5, readout_queue_events=6000,
    )  # fmt: skip
    bins = np.arange(0, 20_001, 200)
    for stream, colour, name in ((ideal, _GREY, "requested"), (events, _BLUE, "sent")):
        counts = np.histogram(stream.t_us, bins)[0] / 200
        axes[0].step(bins[:-1] / 1e3, counts, where="post", color=colour, label=name)
    lost = sensor.counts["dropped_overflow"]
    axes[0].set(xlabel="time (ms)", ylabel="million events per s",
                title=f"{len(events)} sent, {lost} lost")  # fmt: skip
    burst = events.between(5000, 5600)
    axes[1].plot(burst.t_us / 1e3, burst.y, ".", ms=1, color=_BLUE)
    axes[1].set(xlabel="time (ms)", ylabel="row", title="row by row")


PICTURES: dict[str, tuple[Callable[[Any], None], int]] = {
    "mismatch": (mismatch, 2),
    "thresholds": (thresholds, 1),
    "bandwidth": (bandwidth, 2),
    "leak": (leak, 2),
    "shot": (shot, 2),
    "hot_pixels": (hot_pixels, 2),
    "refractory": (refractory, 1),
    "latency": (latency, 2),
    "readout": (readout, 2),
}
"""Drawing function and number of panels by name."""


def draw(folder: Path) -> list[Path]:
    """Writes all pictures as sensor_NAME.png and returns their paths."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    paths = []
    with mpl.rc_context({"font.size": 8, "axes.spines.top": False, "axes.spines.right": False}):
        for name, (function, panels) in PICTURES.items():
            figure = Figure(figsize=(3.6 * panels, 2.6), dpi=110, layout="constrained")
            axes = figure.subplots(1, panels, squeeze=False)[0]
            function(axes)
            for ax in axes:
                if ax.get_legend_handles_labels()[0]:
                    ax.legend(frameon=False)
            paths.append(folder / f"sensor_{name}.png")
            figure.savefig(paths[-1])
    return paths


if __name__ == "__main__":
    draw(Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images"))
