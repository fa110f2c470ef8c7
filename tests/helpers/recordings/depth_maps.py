"""Depth maps compared: bit by bit, and in steps of the planes."""

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.windows import choose_window

FIELDS = ("depth_m", "confidence", "mask", "argmax", "reliability")


def assert_same_bits(one, other):
    """The same depth map, not only nearly."""
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def steps_off(result, method, depth_m):
    """How far a map's points lie from a depth, in steps of inverse depth: the median."""
    depth = result.depth_maps[method]
    assert depth.points > 0
    step = abs(float(result.view.rho[1] - result.view.rho[0]))
    return np.median(np.abs(1 / depth.depth_m - 1 / depth_m)[depth.mask]) / step


def mapper(config):
    """What maps a recording by named methods, with some values of a configuration changed."""

    def mapped(recording, *names, **values):
        own = config.model_dump(exclude_unset=True) | {"methods": names} | values
        return map_window(recording, MapperConfig.model_validate(own))

    return mapped


def mapped_like(path, ours, config):
    """The map of a recording's first method in the window that our own sequence has.

    Our manifest knows when recording began, other layouts do not.
    """
    window = choose_window(Sequence.open(ours), config)
    result = map_window(open_recording(path), config, window=window)
    return result.depth_maps[config.methods[0]]
