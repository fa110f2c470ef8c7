"""How real do simulated events look? A twin of a real recording: `slider_twin --slider FOLDER`.

The recording is `slider_depth` of the Event Camera Dataset: a camera that slides to the right
before a scene at rest. Its twin sees the recording's own pictures, moved: between two frames each
pixel shifts sideways by what its depth demands, which is how far the next frame has it (a slider
has no other motion). Sensors watch this light: presets, and the one that `fit` makes of the
recording's first half. All are compared with the real events of the second half.

    python tests/benchmarks slider_twin --slider ../shared/data/slider_depth --table
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.datasets import open_recording
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.diagnose.sensing.fit import effective_thresholds, fit_pixels
from eventsweep.plugins.diagnose.sensing.folder import realism_page
from eventsweep.plugins.diagnose.sensing.frames import FrameStack, frames_of
from eventsweep.plugins.diagnose.sensing.pixel_events import PixelEvents
from eventsweep.plugins.diagnose.sensing.realism import Portrait, Realism, compared, portrait
from eventsweep.sim.config import PixelConfig
from eventsweep.sim.sensor.sensor import Sensor
from markdown_blocks import show

PAGE = Path("docs/sensor.md")
STEP_US = 2000
SMOOTH_PX = 0.7  # chosen on the first half, as all else
PRESETS = ("ideal", "davis240")
FITTED = "fitted"
LEFT_OUT = (
    "share of pixels that are active",
    "equal polarity in a row",
    "spread of pixels' rates (standard deviation of ln)",
)
Light = NDArray[np.float32]


def moved(frames: FrameStack, step_us: int = STEP_US) -> FrameStack:
    """Frames at every `step_us` or less: each pixel moves sideways from one frame to the next."""
    times_us, light = [int(frames.t_us[0])], [frames.light[0]]
    for k in range(len(frames.t_us) - 1):
        t0, t1 = int(frames.t_us[k]), int(frames.t_us[k + 1])
        steps = max(1, -(-(t1 - t0) // step_us))
        pair = frames.light[k], frames.light[k + 1]
        shift_px = sideways_px(*pair), sideways_px(*pair[::-1])
        for n in range(1, steps):
            times_us.append(t0 + n * (t1 - t0) // steps)
            light.append(between(*pair, *shift_px, n / steps))
        times_us.append(t1)
        light.append(pair[1])
    stack = np.array(light, np.float32)
    return replace(
        frames, t_us=np.array(times_us, np.int64), light=stack, usable=np.ones(stack.shape, bool)
    )


def sideways_px(one: Light, two: Light) -> Light:
    """(H, W) how far to the right each pixel of one picture lies in the other, px."""
    flow = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    first, second = (np.clip(255 * np.sqrt(a), 0, 255).astype(np.uint8) for a in (one, two))
    found = flow.calc(first, second, np.zeros((*one.shape, 2), np.float32))[..., 0]
    return np.asarray(cv2.medianBlur(np.ascontiguousarray(found), 5), np.float32)


def between(one: Light, two: Light, there: Light, back: Light, share: float) -> Light:
    """The picture at a share of the way from one to two."""
    share = float(share)
    height, width = one.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    first = cv2.remap(one, x - share * there, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    second = cv2.remap(
        two, x - (1 - share) * back, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE
    )
    blend = (1 - share) * first + share * second
    return np.clip(blend, 0, None).astype(np.float32)


def watched(frames: FrameStack, values: dict[str, Any]) -> Events:
    """What a sensor sends that watches light as a video."""
    height, width = frames.light.shape[1:]
    sensor = Sensor(0, width, height, PixelConfig(**values), 0)
    sensor.start(frames.light[0], int(frames.t_us[0]))
    parts = [
        sensor.step(light, t_us).events
        for light, t_us in zip(frames.light[1:], frames.t_us[1:].tolist(), strict=True)
    ]
    return Events.concat(parts)


def smoothed(frames: FrameStack) -> FrameStack:
    """Pictures without the noise of their pixels, which would send events."""
    light = [cv2.GaussianBlur(each, (0, 0), SMOOTH_PX) for each in frames.light]
    return replace(frames, light=np.array(light, np.float32))


def fitted_values(pixels: PixelEvents, frames: FrameStack) -> dict[str, Any]:
    """The sensor that explains events by moved light.

    What `fit` finds, but with thresholds that make as many events: between frames that are 40 ms
    apart light is known by its motion only, and what that misses would count as threshold.
    """
    light = moved(frames)
    values = {**fit_pixels(pixels, light).values()}
    pair = effective_thresholds(pixels, smoothed(light), values)
    names = ("contrast_threshold_pos", "contrast_threshold_neg")
    return {**values, **dict(zip(names, pair, strict=True))}


def judged(slider: Path) -> Iterator[tuple[str, dict[str, Any], Realism]]:
    """Each sensor's name, its settings, and its events beside the real ones of the second half."""
    recording = open_recording(slider)
    first_us, last_us = recording.event_span_us(0)
    middle_us = (first_us + last_us) // 2
    learnt = frames_of(recording, 0, (first_us, middle_us))
    frames = frames_of(recording, 0, (middle_us, last_us))
    assert learnt is not None
    assert frames is not None
    light, shape = smoothed(moved(frames)), (frames.light.shape[1], frames.light.shape[2])
    events = recording.events(0, first_us, middle_us)
    fitted = fitted_values(PixelEvents.of(events, shape, (first_us, middle_us)), learnt)
    span_us = int(frames.t_us[0]), int(frames.t_us[-1])

    def seen(name: str, events: Events) -> Portrait:
        return portrait(name, events, shape, span_us)

    real = seen("slider_depth", recording.events(0, span_us[0], span_us[1] + 1))
    sensors = {name: {"sensor": {"preset": name}} for name in PRESETS}
    for name, values in {**sensors, FITTED: fitted}.items():
        yield name, values, compared(real, seen(name, watched(light, values)))


def table_of(results: list[tuple[str, dict[str, Any], Realism]]) -> str:
    """Markdown: AUC and the statistics, a column per sensor, the real one first."""
    heads = ["", "real", *(name for name, _, _ in results)]
    lines = [f"| {' | '.join(heads)} |", f"|---{'|--:' * (len(heads) - 1)}|"]
    aucs = [f"{found.auc:.3f}" for _, _, found in results]
    lines.append(f"| AUC | – | {' | '.join(aucs)} |")
    for name, value in results[0][2].real.statistics.items():
        if name in LEFT_OUT:
            continue
        cells = [value, *(found.simulated.statistics[name] for _, _, found in results)]
        lines.append(f"| {name} | {' | '.join(f'{cell:.3g}' for cell in cells)} |")
    return "\n".join(lines) + "\n"


def main(arguments: list[str]) -> int:
    """Prints the table, or writes it into the page; `--pages` keeps the pages of `realism`."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--slider", type=Path, required=True)
    parser.add_argument("--table", action="store_true", help=f"write the table into {PAGE}")
    parser.add_argument("--pages", type=Path, help="folder for the pages")
    given = parser.parse_args(arguments)
    with exit_code() as code:
        results = list(judged(given.slider))
        for name, values, found in results:
            sys.stderr.write(f"{name}: {values}\n{found.single}\n")
            if given.pages:
                given.pages.mkdir(parents=True, exist_ok=True)
                page = realism_page(found, "slider_twin", ())
                (given.pages / f"{name}.html").write_text(page, encoding="utf-8")
        show(table_of(results), PAGE if given.table else None, "slider-twin")
    return code.value


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
