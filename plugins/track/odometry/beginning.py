"""When tracking can begin: what stretch is looked at, whether it is believed, what came before.

The stretch is as long as its motion needs: short where events say that all is fast, growing where
little moves. `start` finds its map and poses; a map that is given is begun from instead.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.plugins.track.odometry.batches import (
    NOISE,
    Batch,
    Sizes,
    batch_before,
    rising,
    shows_edges,
)
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.maps import map_config, points_of
from eventsweep.plugins.track.odometry.motion import Motion, reach_for
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.registration.fit import Registration
from eventsweep.plugins.track.odometry.start import (
    LONGEST_START_US,
    START_US,
    Found,
    Past,
    begin,
    earlier,
)
from eventsweep.plugins.track.odometry.stream import Arrived
from eventsweep.plugins.track.odometry.trust import Trust

Matrix = NDArray[np.float64]
SHORTEST_START_US = 60_000
_BATCHES_TO_BEGIN, _LEAST_STEPS = 30, 40
_JUDGED = 10  # batches of the stretch


@dataclass(frozen=True)
class Wait:
    """No beginning yet: why, and after how long to try again, µs."""

    reason: str
    wait_us: int = START_US // 4


@dataclass(frozen=True, eq=False)
class Begun:
    """A beginning.

    Attributes:
        since_us: from when on events belong to the stretch.
        status: whether it is believed.
        before: what was found before the stretch, in order of time.
        stretch: what was found in it.
        points: (N, 3) of its map, in the world of the poses, m.
    """

    since_us: int
    status: Status
    before: list[Found]
    stretch: list[Found]
    points: Matrix

    def seen_from(self, T_new_world: Matrix) -> Begun:
        """The same in another world frame."""
        before, stretch = (
            [(motion.seen_from(T_new_world), fit, status) for motion, fit, status in found]
            for found in (self.before, self.stretch)
        )
        points = se3.transform(T_new_world, self.points)
        return Begun(self.since_us, self.status, before, stretch, points)


class Beginning:
    """Looks for the first map and the first poses in what has arrived.

    Args:
        arrived: the events.
        registration: what registers; once begun, it uses the map of the beginning.
        sizes: numbers that follow from the sensor.
        trust: judges the stretch.
        config: rates, and sizes of maps.
        first_map: a depth map in whose world poses are; without one static stereo is begun from.
        T_world_body: (4, 4) where the first pose lies, if no map is given.
        past: gives again what was pushed, to find what came before the stretch.
    """

    def __init__(
        self, arrived: Arrived, registration: Registration, sizes: Sizes, trust: Trust,
        config: TrackConfig, *, first_map: DepthMap | None, T_world_body: Matrix, past: Past | None,
    ) -> None:  # fmt: skip
        self._arrived, self._registration, self._sizes = arrived, registration, sizes
        self._trust, self._config, self._past = trust, config, past
        self._first_map, self._T_world_body = first_map, T_world_body
        self._step_us = round(1e6 / config.rate_hz)

    @property
    def reach(self) -> float:
        """Of motions, by what is near."""
        return reach_for(depth_range_m(self._arrived, map_config(self._config, self._arrived))[0])

    def at(self, t_us: int, first_us: int) -> Begun | Wait:
        """The beginning in the stretch that ends at a time, if there is one.

        Args:
            t_us: all events before it have arrived.
            first_us: the first event's time.
        """
        length_us = self._stretch_us(t_us)
        since_us, shortest_us = max(first_us, t_us - length_us), min(START_US, length_us)
        missing_us = first_us + shortest_us - t_us
        if missing_us > 0:
            return Wait("too short a time", missing_us)
        step_us = min(self._step_us, length_us // _LEAST_STEPS)
        batches = self._batches(range(since_us + step_us, t_us + 1, step_us), since_us)
        shown = [batch for batch in batches if shows_edges(batch)]
        enough = shortest_us // step_us // 2
        if len(shown) < enough:
            return Wait("too few events: nothing moves" if len(batches) < enough else NOISE)
        begun = begin(
            self._arrived, shown, self._registration, self._sizes,
            map_config(self._config, self._arrived), self._given(shown), self.reach,
        )  # fmt: skip
        if isinstance(begun, str):
            return Wait(begun)
        motions, fits, points = begun
        status = self._judged(motions, shown)
        before = self._before(motions[0], range(t_us, first_us, -step_us), status)
        stretch = [(motion, fit, status) for motion, fit in zip(motions, fits, strict=True)]
        found = Begun(since_us, status, before, stretch, points)
        return found if self._first_map is not None else self._from_origin(found)

    def _stretch_us(self, t_us: int) -> int:
        """How much before `t_us` is looked at: less where events say that all is fast."""
        batch = batch_before(self._arrived.streams, t_us, self._sizes.events, 0)
        fast_us = max(_BATCHES_TO_BEGIN * 2 * (t_us - batch.t_us), SHORTEST_START_US)
        return fast_us if fast_us < START_US else LONGEST_START_US

    def _batches(self, ends_us: range, since_us: int) -> list[Batch]:
        """Those in which something moves."""
        streams, count = self._arrived.streams, self._sizes.events
        batches = rising([batch_before(streams, end_us, count, since_us) for end_us in ends_us])
        return [batch for batch in batches if len(batch) >= self._sizes.still]

    def _given(self, batches: Sequence[Batch]) -> tuple[Motion, Matrix] | None:
        first_map = self._first_map
        if first_map is None:
            return None
        T_world_body = first_map.T_world_rv @ se3.inverse(self._arrived.rig.T_body_cam[0])
        nearest = min(batches, key=lambda batch: abs(batch.t_us - first_map.t_us))
        return Motion.near(nearest.t_us, T_world_body, self.reach), points_of(first_map)

    def _judged(self, motions: Sequence[Motion], batches: Sequence[Batch]) -> Status:
        """Whether the beginning can be believed, by what all of its stretch shows."""
        seen = {batch.t_us: batch.events for batch in batches}
        self._trust.restart()
        doubt = ""
        for motion in motions[:: -(-len(motions) // _JUDGED)]:
            found, fit = self._registration.nearby(seen[motion.t_us], motion)
            doubt = self._trust.judge(fit, self._registration.evidence(found))
        return Status.UNCERTAIN if doubt else Status.TRACKING

    def _before(self, first: Motion, ends_us: range, status: Status) -> list[Found]:
        """Motions of the events before the `first` one's, on the map that registers now."""
        if self._past is None or first.t_us < ends_us.stop - ends_us.step:
            return []
        rig, sizes = self._arrived.rig, self._sizes
        return earlier(self._past, rig, self._registration, sizes, first, ends_us, status)

    def _from_origin(self, begun: Begun) -> Begun:
        """The same where the first pose lies as it should."""
        first, _, _ = (*begun.before, *begun.stretch)[0]
        return begun.seen_from(self._T_world_body @ se3.inverse(first.T_world_body))
