"""Disturbs recordings, and asks whether `track` notices: `track_faults --out FOLDER`.

Noise, a camera that falls silent, missing packets, jumps of the clock, moving bodies and darkness,
from the beginning or later, for a while or to the end, are put into short twins. A run is right if
poses that are said to be `tracking` lie within 2 % of their way (aligned rigidly, root mean
square) and 3 % of scale, and if at least 80 % of the poses that the fault does not touch are said
to be. With `--recording` other recordings are disturbed; every run prints a line.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.pose import Status
from eventsweep.plugins.track.odometry.recorded import Tracked, track
from track_scores import FEWEST_POSES, MOST_OFF, MOST_SCALE, Twin, simulated

TWINS = Twin("mvsec-flying", "davis346", 0, 1.2), Twin("desk", "davis346", 0, 1.2)
_MUST_CLAIM, _LEAST_WAY_M = 0.8, 0.01  # share
_SETTLES_US = 60_000  # before a fault: a batch may reach into it
_HZ = 0.3, 8.0  # of noise, per pixel
_GAP_US, _GAPS = 5_000, 0.3
_JUMPS_US = 200_000, 3_600_000_000
_BODY_SHARE, _BODY_PX_S, _BODY_M, _BODY_DOTS = (0.08, 0.2), (60.0, 300.0), (0.6, 2.0), 150
_VERDICTS = "tracking, right", "doubted, right", "tracking, wrong", "doubted, no need"

Streams = list[Events]
Span = tuple[int, int]


def nothing(streams: Streams, _rig: Rig, _span_us: Span, _rng: np.random.Generator) -> Streams:
    """The recording as it is: to be tracked."""
    return streams


def noise(streams: Streams, rig: Rig, span_us: Span, rng: np.random.Generator) -> Streams:
    """Nothing but events at random pixels."""
    hz = np.exp(rng.uniform(*np.log(_HZ)))
    return [
        _mixed(_outside(s, span_us), _scattered(camera, span_us, hz, rng))
        for s, camera in zip(streams, rig.cameras, strict=True)
    ]


def darkness(streams: Streams, _rig: Rig, span_us: Span, _rng: np.random.Generator) -> Streams:
    """No events at all."""
    return [_outside(stream, span_us) for stream in streams]


def silent(streams: Streams, rig: Rig, span_us: Span, rng: np.random.Generator) -> Streams:
    """One camera without events."""
    which = rng.integers(len(rig))
    return [_outside(s, span_us) if k == which else s for k, s in enumerate(streams)]


def missing(streams: Streams, _rig: Rig, span_us: Span, rng: np.random.Generator) -> Streams:
    """Packets of 5 ms missing, of every camera its own."""
    first_us, last_us = span_us
    kept = []
    for stream in streams:
        lost = rng.random((last_us - first_us) // _GAP_US + 1) < _GAPS
        packet = np.clip((stream.t_us - first_us) // _GAP_US, 0, len(lost) - 1)
        kept.append(stream.take(~(lost[packet] & _within(stream, span_us))))
    return kept


def moving_body(streams: Streams, rig: Rig, span_us: Span, rng: np.random.Generator) -> Streams:
    """A dotted disc that crosses the images of all cameras and hides what is behind it."""
    camera = rig.cameras[0]
    radius_px = rng.uniform(*_BODY_SHARE) * camera.width_px
    depth_m, speed_px_s = rng.uniform(*_BODY_M), rng.uniform(*_BODY_PX_S)
    heading = rng.uniform(0, 2 * np.pi)
    velocity = speed_px_s * np.array([np.cos(heading), np.sin(heading)])
    middle = np.array([camera.width_px, camera.height_px]) * rng.uniform(0.3, 0.7, 2)
    turn, away = rng.uniform(0, 2 * np.pi, _BODY_DOTS), np.sqrt(rng.random(_BODY_DOTS))
    dots = radius_px * away[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])
    halfway_us = (span_us[0] + min(span_us[1], int(streams[0].t_us[-1]))) // 2
    seen = []
    for stream, T_body_cam in zip(streams, rig.T_body_cam, strict=True):
        at = middle - [camera.fx_px * T_body_cam[0, 3] / depth_m, 0]
        over_s = (stream.t_us - halfway_us) / 1e6
        places = at + over_s[:, None] * velocity - np.column_stack([stream.x, stream.y])
        hidden = (np.linalg.norm(places, axis=1) < radius_px) & _within(stream, span_us)
        ends_us = span_us[0], min(span_us[1], int(stream.t_us[-1]))
        step_us = round(1e6 / speed_px_s)
        t_us = np.arange(*ends_us, step_us)
        when = (t_us[:, None] + rng.integers(0, step_us, (len(t_us), len(dots)))).ravel()
        there = (
            at
            + dots[None]
            + ((when.reshape(len(t_us), -1) - halfway_us) / 1e6)[..., None] * velocity
        )
        body = _events(np.rint(there.reshape(-1, 2)), when, camera.width_px, camera.height_px)
        seen.append(_mixed(stream.take(~hidden), body.take(body.t_us < ends_us[1])))
    return seen


Change = Callable[[Streams, Rig, Span, np.random.Generator], Streams]
CHANGES: dict[str, Change] = {
    "nothing": nothing, "noise": noise, "darkness": darkness, "silent camera": silent,
    "missing packets": missing, "moving body": moving_body,
}  # fmt: skip
JUMP = "jump of the clock"
KINDS = (*CHANGES, JUMP)


class Disturbed(DerivedRecording):
    """A recording in which something goes wrong during a stretch of time."""

    def __init__(self, recording: Recording, kind: str, span_us: Span, seed: int) -> None:
        super().__init__(recording)
        first_us, last_us = recording.event_span_us(0)
        rng, cameras = np.random.default_rng(seed), range(len(recording.rig))
        self._streams = [recording.events(k, first_us, last_us + 1) for k in cameras]
        self._path, self._jump_us = recording.trajectory, 0
        if kind == JUMP:
            self._jump_us = int(rng.choice(_JUMPS_US))
            self._streams = [self._later(s, span_us[0]) for s in self._streams]
            path = self._path
            t_us = path.t_us + np.where(path.t_us >= span_us[0], self._jump_us, 0)
            self._path = Trajectory(t_us, path.positions_m, path.quats_xyzw)
        else:
            self._streams = CHANGES[kind](self._streams, recording.rig, span_us, rng)
        self._span_us = first_us, last_us + self._jump_us

    def _later(self, stream: Events, since_us: int) -> Events:
        t_us = stream.t_us + np.where(stream.t_us >= since_us, self._jump_us, 0)
        return Events(stream.x, stream.y, t_us, stream.p)

    @property
    def trajectory(self) -> Trajectory:
        """`T_world_body` over time, on the clock of the events."""
        return self._path

    def event_span_us(self, camera: int) -> Span:
        """First and last instant, µs."""
        self.rig.check_camera(camera)
        return self._span_us

    def events(self, camera: int, t0_us: int, t1_us: int) -> Events:
        """Events of a camera with `t0_us <= t < t1_us`."""
        return self._streams[camera].between(t0_us, t1_us)


def _within(stream: Events, span_us: Span) -> NDArray[np.bool_]:
    inside: NDArray[np.bool_] = (stream.t_us >= span_us[0]) & (stream.t_us < span_us[1])
    return inside


def _outside(stream: Events, span_us: Span) -> Events:
    return stream.take(~_within(stream, span_us))


def _scattered(camera: Camera, span_us: Span, hz: float, rng: np.random.Generator) -> Events:
    size = camera.width_px, camera.height_px
    count = rng.poisson(hz * size[0] * size[1] * (span_us[1] - span_us[0]) / 1e6)
    return _events(rng.integers(0, size, (count, 2)), rng.integers(*span_us, count), *size)


def _events(uv: NDArray[Any], t_us: NDArray[np.int64], width: int, height: int) -> Events:
    """Events at (N, 2) pixels, in order of time; those outside the image are left out."""
    kept = ((uv >= 0) & (uv < (width, height))).all(axis=1)
    uv, t_us = uv[kept], t_us[kept]
    order = np.argsort(t_us, kind="stable")
    x, y = uv[order].T.astype(np.uint16)
    return Events(x, y, t_us[order], (np.arange(len(x)) % 2).astype(np.uint8))


def _mixed(*parts: Events) -> Events:
    events = Events.concat(parts)
    return events.take(np.argsort(events.t_us, kind="stable"))


@dataclass(frozen=True)
class Verdict:
    """What a run said, and how far off what it claimed is.

    Attributes:
        claimed: share of its poses that are `tracking`.
        off_percent: of their way, root mean square; NaN where too few are claimed to say.
        scale_percent: by which their scale is off.
        untouched: share that is `tracking` of the poses that the fault does not touch.
    """

    claimed: float
    off_percent: float
    scale_percent: float
    untouched: float

    @property
    def is_wrong(self) -> bool:
        """Whether what it claims is far off."""
        return self.off_percent > MOST_OFF or self.scale_percent > MOST_SCALE

    @property
    def in_words(self) -> str:
        """One of `_VERDICTS`."""
        if self.is_wrong:
            return _VERDICTS[2]
        if self.untouched < _MUST_CLAIM:
            return _VERDICTS[3]
        return _VERDICTS[self.claimed < _MUST_CLAIM]


def judged(tracked: Tracked, truth: Trajectory, untouched_us: Span) -> Verdict:
    """How right a run's statuses are; poses within `untouched_us` are to be `tracking`."""
    path, claims = tracked.trajectory, np.array([s is Status.TRACKING for s in tracked.statuses])
    inside = (path.t_us >= untouched_us[0]) & (path.t_us < untouched_us[1])
    untouched = float(claims[inside].mean()) if inside.any() else 1.0
    off = scale = np.nan
    if claims.sum() >= FEWEST_POSES:
        claimed = Trajectory(path.t_us[claims], path.positions_m[claims], path.quats_xyzw[claims])
        values = score_poses(truth, claimed).values
        if values["way"] > _LEAST_WAY_M:
            off, scale = values["ate_share"], values["scale_error"]
    return Verdict(float(claims.mean()), off, scale, untouched)


def faults(recording: Recording, runs: int, seed: int) -> Iterator[tuple[str, Span]]:
    """Kinds in turns, each from the beginning or later, for a while or to the end."""
    first_us, last_us = recording.event_span_us(0)
    length_us = last_us - first_us
    for k in range(runs):
        rng = np.random.default_rng([seed, k])
        begins = (k // len(KINDS)) % 3 != 0
        begin_us = first_us + round(rng.uniform(0.35, 0.6) * length_us) * begins
        for_us = length_us if rng.random() < 0.4 else round(rng.uniform(0.05, 0.3) * length_us)
        yield KINDS[k % len(KINDS)], (begin_us, min(begin_us + for_us, last_us + 1))


def run(recording: Recording, kind: str, span_us: Span, seed: int) -> tuple[Verdict, str]:
    """Tracks a disturbed recording; what was said, and why it doubted first."""
    disturbed = Disturbed(recording, kind, span_us, seed)
    try:
        tracked = track(disturbed)
    except InputError as error:  # it never began: nothing is claimed
        return Verdict(0.0, np.nan, np.nan, 1.0), str(error)
    ends_us = span_us[0] - _SETTLES_US
    verdict = judged(tracked, disturbed.trajectory, (tracked.span_us[0], ends_us))
    return verdict, next((c.reason for c in tracked.changes[1:] if c.reason), "")


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints a line per run and the table; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of twins")
    parser.add_argument("--runs", type=int, default=30, help="of each recording")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--recording", type=Path, action="append", default=[])
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        paths = asked.recording or [simulated(twin, asked.out) for twin in TWINS]
        counts: dict[str, Counter[str]] = {kind: Counter() for kind in KINDS}
        for path in paths:
            recording = open_recording(path)
            for k, (kind, span_us) in enumerate(faults(recording, asked.runs, asked.seed)):
                verdict, reason = run(recording, kind, span_us, k)
                counts[kind][verdict.in_words] += 1
                sys.stdout.write(_line(path.name, kind, recording, span_us, verdict, reason))
                sys.stdout.flush()
        sys.stdout.write(table(counts))
    return ended.value


def _line(
    name: str, kind: str, recording: Recording, span_us: Span, verdict: Verdict, reason: str
) -> str:
    first_us = recording.event_span_us(0)[0]
    begin_s, end_s = ((t_us - first_us) / 1e6 for t_us in span_us)
    return (
        f"{name} {kind} {begin_s:.2f} to {end_s:.2f} s: {verdict.in_words}; tracking "
        f"{verdict.claimed:.2f}, untouched {verdict.untouched:.2f}, off {verdict.off_percent:.2f} "
        f"%, scale {verdict.scale_percent:.2f} %; {reason}\n"
    )


def table(counts: dict[str, Counter[str]]) -> str:
    """Verdicts by kind, and the share that is right."""
    lines = [f"| Fault | {' | '.join(_VERDICTS)} |", "|---|--:|--:|--:|--:|"]
    lines += [
        f"| {kind} | {' | '.join(str(said[v]) for v in _VERDICTS)} |"
        for kind, said in counts.items()
    ]
    total = sum(counts.values(), Counter())
    right = total[_VERDICTS[0]] + total[_VERDICTS[1]]
    return "\n".join([*lines, f"\nRight: {right} of {total.total()}", ""])


if __name__ == "__main__":
    raise SystemExit(main())
