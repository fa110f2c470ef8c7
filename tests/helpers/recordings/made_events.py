"""Events that are made up, and whether two streams are the same."""

import numpy as np

from eventsweep.emvs.data.events import Events

COLUMNS = ("x", "y", "t_us", "p")


def events_at(rng, t_us, width, height):
    """Events at these times, on pixels anywhere on a sensor, of either polarity."""
    t_us = np.asarray(t_us, np.int64)
    x, y = (rng.integers(0, most, len(t_us), np.uint16) for most in (width, height))
    return Events(x, y, t_us, rng.integers(0, 2, len(t_us), np.uint8))


def random_events(rng, n, width, height, t0_us, t1_us):
    """So many events at sorted times from `t0_us` on and before `t1_us`."""
    return events_at(rng, np.sort(rng.integers(t0_us, t1_us, n)), width, height)


def columns_of(events, chosen=slice(None)):
    """Every column, or the chosen part of it."""
    return tuple(getattr(events, name)[chosen] for name in COLUMNS)


def part_of(events, chosen):
    """The events at these places, in this order."""
    return Events(*columns_of(events, chosen))


def same_events(one, other):
    """Whether they are the same, event by event."""
    return all(map(np.array_equal, columns_of(one), columns_of(other)))


def assert_same_events(one, other):
    """Event by event, and of the same types."""
    for name, a, b in zip(COLUMNS, columns_of(one), columns_of(other), strict=True):
        np.testing.assert_array_equal(a, b, err_msg=name)
        assert a.dtype == b.dtype, name
