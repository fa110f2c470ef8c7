"""One picture of a frame camera, exposed by itself while the head moves."""

from itertools import pairwise

from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.sensor.frame_camera import DENSE_PX, Exposure


def mean_light(frames, start_us, end_us):
    """Mean (H, W) light over a span, of frames (t_us, light) that cover it."""
    exposing = Exposure(start_us, end_us)
    for before, after in pairwise(frames):
        exposing.add(before, after)
    return exposing.light()


def captured_light(renderer, motion, camera, start_us, config, exposure_us):
    """Mean (H, W) light of an exposure, from frames of its own."""
    limits = {"max_displacement_px": min(config.spacing_px, DENSE_PX)}
    dense = config.model_copy(update={"sampling": "linear", **limits})
    end_us = start_us + exposure_us
    taken = adaptive_frames(renderer, motion, [start_us, end_us], dense)
    frames = [(e.t_us, e.frames[camera].intensity) for e in taken]
    return mean_light(frames, start_us, end_us)
