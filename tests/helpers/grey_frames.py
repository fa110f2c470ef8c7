"""Frames of 8 bits, as videos have them."""

import numpy as np


def grey_video(count, height, width):
    """A smooth random texture that swings to and fro, in 8 bits."""
    rng = np.random.default_rng(7)
    waves = rng.uniform(-0.5, 0.5, (12, 2))
    phase = rng.uniform(0, 2 * np.pi, 12)
    y, x = np.mgrid[:height, :width]
    frames = []
    for k in range(count):
        shift = 8 * np.sin(2 * np.pi * k / 80)
        angle = waves[:, 0, None, None] * (x + shift) + waves[:, 1, None, None] * y
        picture = np.sin(angle + phase[:, None, None]).sum(axis=0)
        frames.append(np.rint(127.5 + 127.5 * np.tanh(picture / 4)) / 255)
    return np.asarray(frames, np.float32)
