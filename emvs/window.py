"""Which events make one map: the window, what covers it, and its reference time."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.errors import InputError
from emvs.pose_gaps import check_poses

_COUNTING_STEP_US = 1_000_000


@dataclass(frozen=True)
class Window:
    """A stretch of time, and the instant of its reference view.

    Attributes:
        t0_us: begin, included.
        t1_us: end, excluded.
        t_ref_us: time of the reference view.
        left_out: per camera, events before or after that no pose covers.
    """

    t0_us: int
    t1_us: int
    t_ref_us: int
    left_out: tuple[int, ...]


@dataclass(frozen=True)
class _Span:
    first_us: int
    last_us: int


def choose_window(recording: Recording, config: MapperConfig) -> Window:
    """Finds the window that the configuration asks for.

    Without `start_s` and `duration_s` the window is everything that the poses cover; events before
    the first or after the last pose are left out and counted. With sliding windows this is the
    stretch that they slide over, and `emvs.windows` cuts it.

    Args:
        recording: events and poses.
        config: `start_s`, `duration_s`, `reference_s`, relative to the first event; `reference`.

    Raises:
        InputError: a window or reference time that events or poses do not cover, or poses
            missing in it; says by how much.
    """
    events, poses = _event_span(recording), _Span(*recording.trajectory.span_us)
    covered = _covered(events, poses)
    t0_us, t1_us = covered.first_us, covered.last_us + 1
    if config.start_s is not None:
        t0_us, t1_us = events.first_us + _micros(config.start_s), events.last_us + 1
    if config.duration_s is not None:
        t1_us = t0_us + _micros(config.duration_s)
    _check_inside("events", events, t0_us, t1_us)
    _check_inside("poses", poses, t0_us, t1_us)
    if not config.slides:
        check_poses(recording.trajectory, t0_us, t1_us, config)
    whole = config.start_s is None and config.duration_s is None
    left_out = _left_out(recording, events, t0_us, t1_us) if whole else (0,) * len(recording.rig)
    return Window(t0_us, t1_us, _reference_us(config, events, poses, t0_us, t1_us), left_out)


def time_steps(t0_us: int, t1_us: int) -> Iterator[tuple[int, int]]:
    """Cuts a stretch into seconds, for passes over what may be longer than memory."""
    for t_us in range(t0_us, t1_us, _COUNTING_STEP_US):
        yield t_us, min(t_us + _COUNTING_STEP_US, t1_us)


def _micros(seconds: float) -> int:
    return round(seconds * 1e6)


def _event_span(recording: Recording) -> _Span:
    spans = [recording.event_span_us(camera) for camera in range(len(recording.rig))]
    return _Span(min(first for first, _ in spans), max(last for _, last in spans))


def _covered(events: _Span, poses: _Span) -> _Span:
    covered = _Span(max(events.first_us, poses.first_us), min(events.last_us, poses.last_us))
    if covered.first_us > covered.last_us:
        raise InputError(
            f"poses ({poses.first_us}..{poses.last_us} µs) and events "
            f"({events.first_us}..{events.last_us} µs) do not overlap: bring them to one clock"
        )
    return covered


def _check_inside(what: str, span: _Span, t0_us: int, t1_us: int) -> None:
    early_us, late_us = span.first_us - t0_us, t1_us - 1 - span.last_us
    if t0_us > span.last_us:
        raise InputError(
            f"window begins {(t0_us - span.last_us) / 1e6:.6f} s after the last of the {what}: "
            "choose an earlier start_s"
        )
    if early_us > 0:
        raise InputError(
            f"window begins {early_us / 1e6:.6f} s before the first of the {what}: "
            "choose a later start_s, or leave it out for everything that poses cover"
        )
    if late_us > 0:
        raise InputError(
            f"window ends {late_us / 1e6:.6f} s after the last of the {what}: "
            f"choose duration_s of at most {(span.last_us + 1 - t0_us) / 1e6:.6f}"
        )


def _reference_us(config: MapperConfig, events: _Span, poses: _Span, t0_us: int, t1_us: int) -> int:
    if config.reference_s is None:
        end_us = min(t1_us, poses.last_us)
        return end_us if config.reference == "end" else (t0_us + t1_us) // 2
    t_ref_us = events.first_us + _micros(config.reference_s)
    outside_us = max(poses.first_us - t_ref_us, t_ref_us - poses.last_us)
    if outside_us > 0:
        raise InputError(
            f"reference_s {config.reference_s:g} lies {outside_us / 1e6:.6f} s outside the poses: "
            "choose a time that they cover, or leave it out for the window's middle"
        )
    return t_ref_us


def _left_out(recording: Recording, events: _Span, t0_us: int, t1_us: int) -> tuple[int, ...]:
    return tuple(
        _count(recording, camera, events.first_us, t0_us)
        + _count(recording, camera, t1_us, events.last_us + 1)
        for camera in range(len(recording.rig))
    )


def _count(recording: Recording, camera: int, t0_us: int, t1_us: int) -> int:
    steps = time_steps(t0_us, t1_us)
    return sum(len(recording.events(camera, begin_us, end_us)) for begin_us, end_us in steps)
