"""One camera's sensor: frames in, labelled events out, with everything that is wrong with it.

The chain, in this order: lens (blur), photoreceptor (bandwidth), leak and comparator (mismatch),
shot noise and hot pixels, refractory period, latency, row arbiter, clock. The page `sensor` has the
sources.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.sim.compensation.interval import Passage
from eventsweep.sim.config import PixelConfig
from eventsweep.sim.sensor import esim_kernels, readout_kernels
from eventsweep.sim.sensor.esim import NEVER_US, EventSimulator, check_intensity, time_before
from eventsweep.sim.sensor.frame_camera import DENSE_PX, blurred
from eventsweep.sim.sensor.labels import Drop, Label, LabelledEvents, count_names
from eventsweep.sim.sensor.noise import Noise
from eventsweep.sim.sensor.pixels import Batch, Pixels, Randomness, Use
from eventsweep.sim.sensor_presets import SensorParameters

State = dict[str, NDArray[Any]]


class Sensor:
    """The event sensor of one camera.

    Equal arguments and frames give equal events, whatever runs beside and however often the work
    was taken out with `state` and put back with `restore`.

    Args:
        camera_index: of the rig; cameras differ in all that is drawn.
        width_px: columns.
        height_px: rows.
        config: thresholds, refractory period and `sensor`.
        seed: of all that is drawn.
        always_full: run the full chain even where the ideal one gives the same events sooner.

    Raises:
        InputError: a negative seed.
    """

    def __init__(
        self, camera_index: int, width_px: int, height_px: int, config: PixelConfig, seed: int,
        *, always_full: bool = False,
    ) -> None:  # fmt: skip
        parameters, randomness = config.sensor.resolved(), Randomness(seed, camera_index)
        self._chain: _FullChain | EventSimulator
        if parameters.ideal_pixels and parameters.ideal_readout and not always_full:
            self._chain = EventSimulator(width_px, height_px, config)
        else:
            self._chain = _FullChain((height_px, width_px), config, randomness)
        self._t_us: int | None = None
        self._counts = np.zeros(len(count_names()), np.int64)

    @property
    def counts(self) -> dict[str, int]:
        """Events sent by cause and dropped by reason, since `start`."""
        return dict(zip(count_names(), self._counts.tolist(), strict=True))

    def start(self, intensity: NDArray[np.float32], t_us: int) -> None:
        """Takes the first frame (H, W), linear, full scale 1; all pixels have settled on it."""
        self._chain.start(intensity, t_us)
        self._counts[:] = 0
        self._t_us = t_us

    def step(self, intensity: NDArray[np.float32], t_us: int) -> LabelledEvents:
        """The events sent between the last frame and this one (H, W), linear, full scale 1.

        They are sorted by time, none before those of earlier steps and none after `t_us`. With a
        clock coarser than 1 µs, time stamps may lie before the frame before.

        Raises:
            InputError: what `EventSimulator.step` refuses.
        """
        time_before(self._t_us, t_us)
        if isinstance(self._chain, _FullChain):
            return self._counted(*self._chain.step(intensity, t_us), t_us)
        before = self._chain.suppressed
        return self._ideal(self._chain.step(intensity, t_us), before, t_us)

    def between(self, passage: Passage) -> LabelledEvents:
        """Returns the events that come out on the way to the next fine frame, and have not yet.

        Ideal pixels are followed one by one as finely as their thresholds ask for; imperfect ones
        need the whole time series and get pictures half a pixel of motion apart.
        """
        t_us = passage.interval.after_us
        time_before(self._t_us, t_us)
        if isinstance(self._chain, _FullChain):
            times_us = passage.times_us(DENSE_PX)
            pictures = zip(passage.pictures(times_us), times_us, strict=True)
            return LabelledEvents.joined([self.step(*picture) for picture in pictures])
        before = self._chain.suppressed
        return self._ideal(self._chain.between(passage), before, t_us)

    def finish(self) -> int:
        """Ends the recording at the last frame: drops and counts what has not come out yet."""
        left = 0 if isinstance(self._chain, EventSimulator) else self._chain.discard()
        self._counts[len(Label) + Drop.AFTER_END] += left
        return left

    def state(self) -> State:
        """Everything that later events depend on; valid until the next `step`."""
        head = {"sensor/t_us": np.array(self._t_us), "sensor/counts": self._counts.copy()}
        return head | {f"chain/{name}": value for name, value in self._chain.state().items()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`, of a sensor that was made with the same arguments."""
        self._t_us = int(state["sensor/t_us"])
        self._counts = np.array(state["sensor/counts"], np.int64)
        self._chain.restore(part_of(state, "chain"))

    def _ideal(self, events: Events, suppressed_before: int, t_us: int) -> LabelledEvents:
        assert isinstance(self._chain, EventSimulator)
        dropped = np.array([self._chain.suppressed - suppressed_before, 0, 0])
        return self._counted(LabelledEvents(events, np.zeros(len(events), np.uint8)), dropped, t_us)

    def _counted(
        self, labelled: LabelledEvents, dropped: NDArray[np.int64], t_us: int
    ) -> LabelledEvents:
        self._t_us = t_us
        self._counts[: len(Label)] += np.bincount(labelled.label, minlength=len(Label))
        self._counts[len(Label) :] += dropped
        return labelled


class _FullChain:
    """The whole chain; parts that are ideal are passed by."""

    def __init__(self, shape: tuple[int, int], config: PixelConfig, randomness: Randomness) -> None:
        p, number = config.sensor.resolved(), shape[0] * shape[1]
        thresholds = config.contrast_threshold_pos, config.contrast_threshold_neg
        self._parameters, self._shape = p, shape
        self._refractory_us = config.refractory_period_us
        self._pixels = Pixels(shape, thresholds, config.log_eps, p, randomness)
        self._noise = Noise(number, p, randomness)
        self._latency = Latency(number, p, randomness)
        self._arbiter = Arbiter(shape, p)
        self._last_us = np.full(number, NEVER_US, np.int64)
        self._t_us = NEVER_US

    def start(self, intensity: NDArray[np.float32], t_us: int) -> None:
        self._pixels.start(self._seen(intensity))
        self._t_us = t_us

    def step(
        self, intensity: NDArray[np.float32], t_us: int
    ) -> tuple[LabelledEvents, NDArray[np.int64]]:
        before_us, dropped = self._t_us, np.zeros(len(Drop), np.int64)
        events = self._pixels.step(self._seen(intensity), before_us, t_us)
        light = self._pixels.frame_before, self._pixels.frame
        noise = self._noise.step(*light, before_us, t_us)
        events = events.joined(noise).in_time_order()
        events, dropped[Drop.REFRACTORY] = self._awake(events)
        if self._parameters.latency_us:
            events = self._latency.step(events, light[1], before_us, t_us)
        if self._parameters.limited_readout:
            events, dropped[Drop.OVERFLOW] = self._arbiter.step(events, t_us)
        self._t_us = t_us
        return self._labelled(events), dropped

    def discard(self) -> int:
        return self._noise.discard() + self._latency.discard() + self._arbiter.discard()

    def state(self) -> State:
        head = {"t_us": np.array(self._t_us), "last_us": self._last_us.copy()}
        for name, part in self._parts.items():
            head |= {f"{name}/{key}": value for key, value in part.state().items()}
        return head

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        self._t_us, self._last_us = int(state["t_us"]), state["last_us"].copy()
        for name, part in self._parts.items():
            part.restore(part_of(state, name))

    @property
    def _parts(self) -> dict[str, Pixels | Noise | Latency | Arbiter]:
        return {
            "pixels": self._pixels, "noise": self._noise,
            "latency": self._latency, "arbiter": self._arbiter,
        }  # fmt: skip

    def _seen(self, intensity: NDArray[np.float32]) -> NDArray[np.float32]:
        """What the lens leaves of a picture; blur must not hide what is no light."""
        if self._parameters.lens_blur_px:
            check_intensity(intensity, self._shape)
            intensity = intensity.astype(np.float32, copy=False)
        return blurred(intensity, self._parameters.lens_blur_px)

    def _awake(self, events: Batch) -> tuple[Batch, int]:
        if not (self._refractory_us and len(events)):
            return events, 0
        kept = np.empty(len(events), np.bool_)
        esim_kernels.awake(events.pixel, events.t_us, self._refractory_us, self._last_us, kept)
        return events.take(kept), int(len(kept) - np.count_nonzero(kept))

    def _labelled(self, events: Batch) -> LabelledEvents:
        y, x = np.divmod(events.pixel, np.int32(self._shape[1]))
        clock_us = self._parameters.timestamp_resolution_us
        t_us = events.t_us if clock_us == 1 else events.t_us // clock_us * clock_us
        columns = Events(x.astype(np.uint16), y.astype(np.uint16), t_us, events.p)
        return LabelledEvents(columns, events.label)


class Latency:
    """Delays events by a gamma-distributed time whose mean falls with intensity.

    Events that come out after the last frame are kept for the steps to come.
    """

    def __init__(self, number: int, parameters: SensorParameters, randomness: Randomness) -> None:
        self._parameters, self._randomness = parameters, randomness
        self._last_us = np.full(number, NEVER_US, np.int64)
        self._pending = Batch.empty()

    def step(self, events: Batch, light: NDArray[np.float32], before_us: int, t_us: int) -> Batch:
        """Takes events in order of time and intensity (P,); returns requests up to `t_us`."""
        requested_us = events.t_us + self._delay_us(light[events.pixel], before_us)
        readout_kernels.in_turn(events.pixel, requested_us, self._last_us)
        delayed = Batch(events.pixel, requested_us, events.p, events.label)
        all_ = self._pending.joined(delayed).in_time_order()
        ready = int(np.searchsorted(all_.t_us, t_us, side="right"))
        self._pending = all_.take(slice(ready, None))
        return all_.take(slice(ready))

    def discard(self) -> int:
        """Forgets what has not come out; returns how many events that were."""
        left, self._pending = len(self._pending), Batch.empty()
        return left

    def _delay_us(self, light: NDArray[np.float32], before_us: int) -> NDArray[np.int64]:
        p = self._parameters
        delay_us = p.latency_us * (1 + p.dark_level) / (light.astype(float) + p.dark_level)
        if p.latency_jitter:
            rng = self._randomness.at(Use.LATENCY, before_us)
            variance = p.latency_jitter**2
            delay_us *= rng.gamma(1 / variance, variance, len(light))
        return np.rint(delay_us).astype(np.int64)

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return {"last_us": self._last_us.copy(), **self._pending.columns()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        self._last_us = state["last_us"].copy()
        self._pending = Batch.from_columns(state)


class Arbiter:
    """Passes requests on row by row, no faster than the read-out can."""

    def __init__(self, shape: tuple[int, int], parameters: SensorParameters) -> None:
        self._shape = shape
        rates_hz = parameters.readout_rows_per_s, parameters.readout_events_per_s
        self._row_us, self._event_us = (1e6 / rate if rate else 0.0 for rate in rates_hz)
        self._capacity = parameters.readout_queue_events
        self._waiting, self._free_us = Batch.empty(), float(NEVER_US)

    def step(self, requests: Batch, t_us: int) -> tuple[Batch, int]:
        """Takes requests up to `t_us`; returns events sent until then, and how many were lost."""
        all_ = self._waiting.joined(requests)
        number = len(all_)
        served, served_us = np.empty(number, np.int64), np.empty(number, np.int64)
        fate = np.empty(number, np.uint8)
        links = np.empty((3, max(number, self._shape[0])), np.int64)
        row = all_.pixel // np.int32(self._shape[1])
        n, self._free_us = readout_kernels.arbitrate(
            row, all_.t_us, len(self._waiting), self._free_us, t_us, self._row_us,
            self._event_us, self._capacity, links, served, served_us, fate,
        )  # fmt: skip
        self._waiting = all_.take(fate == readout_kernels.WAITING)
        sent = all_.take(served[:n])
        lost = int(np.count_nonzero(fate == readout_kernels.DROPPED))
        return Batch(sent.pixel, served_us[:n], sent.p, sent.label), lost

    def discard(self) -> int:
        """Forgets what has not come out; returns how many events that were."""
        left, self._waiting = len(self._waiting), Batch.empty()
        return left

    def state(self) -> dict[str, NDArray[Any]]:
        """Everything that later events depend on."""
        return {"free_us": np.array(self._free_us), **self._waiting.columns()}

    def restore(self, state: Mapping[str, NDArray[Any]]) -> None:
        """Goes on from `state`."""
        self._free_us, self._waiting = float(state["free_us"]), Batch.from_columns(state)


def part_of(state: Mapping[str, NDArray[Any]], name: str) -> State:
    """The entries of a state that belong to one part."""
    prefix = f"{name}/"
    return {k.removeprefix(prefix): v for k, v in state.items() if k.startswith(prefix)}
