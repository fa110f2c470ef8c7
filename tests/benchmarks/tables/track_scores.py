"""Scores `eventsweep track` on noisy twins: `python tests/benchmarks track_scores --out FOLDER`.

Simulates each twin, tracks it by the verb, and scores its poses against the true ones, and maps on
them against maps on the true ones. A finished row is kept, so that the command can be interrupted;
after a change of the program take another folder, or remove the rows. With `--page` the
table is written into a page. `--scene desk=2-4` chooses a scene's seeds, `--seconds 1` a length.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterator, Sequence
from contextlib import redirect_stderr
from dataclasses import asdict, dataclass, replace
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize_scalar

import eventsweep as es
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import RecordingInfo, read_map
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.emvs.windows import Window
from eventsweep.eval.cli import job_flags
from eventsweep.eval.cli.exit_codes import INTERRUPTED, exit_code
from eventsweep.eval.cli.main import main as eventsweep
from eventsweep.eval.config import EvalConfig, TrajectoryConfig
from eventsweep.eval.found_poses import FOUND_FILE, found_poses, method_on_own_poses
from eventsweep.eval.own_poses import map_on_poses
from eventsweep.eval.results.table import POOLED
from eventsweep.eval.scoring.score import score_windows
from eventsweep.eval.scoring.trajectories.own_poses import own_estimates
from eventsweep.eval.scoring.trajectories.score import score_poses
from eventsweep.plugins.track.odometry.pose import Status
from markdown_blocks import show
from table_code import Code, of_scenes

MARK = "track-scores"
TWINS = {
    "desk": ("desk", "davis346", 1.5, ""), "mvsec-flying": ("mvsec-flying", "davis346", 1.5, ""),
    "rpg-boxes": ("rpg-boxes", "davis240", 1.5, ""),
    "rpg-reader": ("rpg-reader", "davis240", 1.5, ""),
    "rpg-monitor": ("rpg-monitor", "davis240", 10, ""), "rpg-bin": ("rpg-bin", "davis240", 10, ""),
    "tumvie-6dof": ("tumvie-6dof", "gen4", 0.5, ""),
    "dsec-street": ("dsec-street", "gen4", 1.5, ""),
    "repetitive": ("repetitive", "davis346", 1.5, ""),
    "moving-objects": ("moving-objects", "davis346", 1.5, ""),
    "desk-dark": ("desk", "low-light", 1.5, ""), "desk-rpg": ("desk", "davis240", 1.5, "rpg"),
}  # fmt: skip
"""By name: the scene, the sensor, how long a sequence is, s, and the rig if not the scene's."""
MOST_OFF, MOST_SCALE, FEWEST_POSES = 2.0, 3.0, 5  # %; %; poses reported as tracking
OPENED = frozenset({0, 1})
"""Seeds that were looked at while the tracker was built."""
# A car taught the tracker to expect more speed, a wide image to map more events; the others were
# looked at when the length of a map's window was chosen, directions of lines, events' delay, speed,
# the beginning, covariances, how long a way must be.
_OPENED_TOO = frozenset(
    {
        ("moving-objects", 2),
        ("mvsec-flying", 16),
        ("desk", 17),
        ("rpg-boxes", 21),
        ("dsec-street", 4),
        ("dsec-street", 6),
        ("tumvie-6dof", 4),
        ("rpg-reader", 4),
    }
    | {("rpg-reader", seed) for seed in (21, 22, 23)}
    | {("rpg-boxes", seed) for seed in (22, 23, 24)}
    | {(scene, seed) for scene in ("rpg-boxes", "rpg-reader") for seed in range(400, 404)}
    | {(scene, seed) for scene in ("rpg-bin", "rpg-monitor") for seed in (400, 401)}
    | {(scene, 21) for scene in ("desk", "mvsec-flying", "repetitive", "rpg-bin", "rpg-monitor")}
    | {("rpg-reader", seed) for seed in (8, 9, 10)}
    | {("tumvie-6dof", 5), ("tumvie-6dof", 6)}
    | {("desk", seed) for seed in (3, 4, 9, 10, 11, 12)}
    | {("rpg-boxes", seed) for seed in (2, 6, 7, 8, 9, 10, 11, 12, 13)}
    | {("mvsec-flying", seed) for seed in (2, 3, 4, 8, 9, 10)}
    | {(scene, seed) for scene in ("desk", "mvsec-flying", "rpg-monitor") for seed in (31, 32)}
    | {(scene, seed) for scene in ("rpg-boxes", "rpg-reader") for seed in (31, 32, 33)}
)
_MOSTLY = 50.0  # %, of a sequence's poses
_LIKELY = 12.592  # chi-squared of 6 degrees of freedom, 95 %
_METHOD = "Focus/H"
_HALF_US, _EVERY_US, _MOST_WINDOWS = 100_000, 300_000, 3  # of what is mapped on both poses
_CLOCK_S, _END_MS = (-0.015, 0.005), 0.2  # what an events' clock may be off by; near its ends
_TRACKED, _ENDED_LOST = 0, 1  # exit codes of the verb
_NEVER_BEGAN = "tracking could not start"


@dataclass(frozen=True)
class Twin:
    """One simulated sequence."""

    scene: str
    sensor: str
    seed: int
    seconds: float
    rig: str = ""

    @property
    def drawn(self) -> str:
        """The scene, and the rig if it is not the scene's own."""
        return f"{self.scene}@{self.rig}" if self.rig else self.scene

    @property
    def name(self) -> str:
        """Of its files."""
        return f"{self.drawn}-{self.sensor}-{self.seed}-{self.seconds:g}s"

    @property
    def is_opened(self) -> bool:
        """Whether it was looked at while the tracker was built."""
        return self.seed in OPENED or (self.scene, self.seed) in _OPENED_TOO


@dataclass(frozen=True)
class Row:
    """What tracking a twin gave.

    Attributes:
        twin: which.
        failure: why there are no poses, or nothing.
        ate_m: root mean square of the errors of position after rigid alignment.
        ate_percent: the same, of the true way.
        covered_percent: of the time.
        lost: how often track was lost.
        ratio: median error of depth on these poses / on the true ones, each on its own pixels.
        cpu_s: CPU time of the verb, all threads, after another run in the same process.
        claimed_percent: of the poses that are said to be `tracking`.
        is_wrong: whether those are off by over 2 % of their way, or 3 % of scale.
        within_percent: of all poses, in whose 95 % region the true one lies.
        clock_ms: what added to the times of the poses makes `ate_percent` least; at an end of what
            `at_its_clock` tries it says nothing.
        clock_percent: the least.
    """

    twin: Twin
    failure: str
    ate_m: float | None
    ate_percent: float | None
    covered_percent: float
    lost: int
    cpu_s: float
    ratio: float | None = None
    claimed_percent: float = 0.0
    is_wrong: bool = False
    within_percent: float | None = None
    clock_ms: float | None = None
    clock_percent: float | None = None


def measured(twins: Sequence[Twin], folder: Path) -> list[Row]:
    """A row per twin; those that the folder holds are not made again.

    Raises:
        InputError: a twin that cannot be simulated, or a damaged row.
    """
    rows, warm = [], False
    for twin in twins:
        kept = folder / f"{twin.name}.json"
        if not kept.exists():
            recording = simulated(twin, folder)
            if not warm:
                warm_up(recording)
                warm = True
            row = _tracked(twin, recording, folder / twin.name / "track")
            with atomic_path(kept) as partial:
                partial.write_text(json.dumps(asdict(row), indent=2) + "\n", encoding="utf-8")
        rows.append(_read(kept))
    return rows


def table(rows: Sequence[Row]) -> str:
    """A line per scene in Markdown, and what seeds that were held out come to together.

    ATE in the median and at worst; of the rest the worst, but for medians of depth and CPU time.
    """
    lines = [
        "Written by `python tests/benchmarks track_scores`; aligned rigidly; CPU of all threads.",
        f"Depth: median error of `{_METHOD}` on these poses / on true ones. Tracking:",
        "least share of poses said to be; wrong: sequences in which those are off by 2 % of the",
        "way, or 3 % of scale. Likely: true poses in the 95 % regions of those found, on average.",
        "Late: by how much events come later than what they show, if the clock that makes the ATE",
        "least is right; fitted: the ATE by that clock. Both are medians.",
        "",
        "| Scene | Sensor | s | Seeds | ATE, % of the way | At worst | Late, ms | Fitted, % "
        "| Tracking, % | Wrong | Likely, % | Covered, % | Lost | Depth | CPU s per s |",
        "|---|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for is_opened in (False, True):
        found = [row for row in rows if row.twin.is_opened == is_opened]
        kinds = dict.fromkeys((row.twin.drawn, row.twin.sensor) for row in found)
        lines += [
            _line([r for r in found if (r.twin.drawn, r.twin.sensor) == kind], is_opened)
            for kind in kinds
        ]
    held_out = [row for row in rows if not row.twin.is_opened]
    if held_out:
        lines += ["", _summary(held_out)]
    return "\n".join(lines) + "\n"


def _line(rows: Sequence[Row], is_opened: bool) -> str:
    twin, percent = rows[0].twin, _percent(rows)
    seeds = ", ".join(str(row.twin.seed) for row in rows) + " (seen)" * is_opened
    ratios = [row.ratio for row in rows if row.ratio is not None]
    clocks = [
        (row.clock_ms, row.clock_percent)
        for row in rows
        if row.clock_ms is not None and row.clock_percent is not None and _is_inside(row.clock_ms)
    ]
    cells = (
        f"`{twin.drawn}`", f"`{twin.sensor}`", f"{twin.seconds:g}", seeds,
        _share(float(np.median(percent))), _share(max(percent)),
        _median([-clock_ms for clock_ms, _ in clocks], 1),
        _median([percent for _, percent in clocks], 2),
        f"{min(row.claimed_percent for row in rows):.0f}", f"{sum(r.is_wrong for r in rows)}",
        _likely(rows),
        f"{min(row.covered_percent for row in rows):.1f}",
        f"{sum(bool(row.failure) or row.lost > 0 for row in rows)}",
        _median(ratios, 2),
        f"{np.median([row.cpu_s / row.twin.seconds for row in rows]):.1f}",
    )  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _percent(rows: Sequence[Row]) -> list[float]:
    """Sequences without poses count as worse than any with poses."""
    return [np.inf if row.ate_percent is None else row.ate_percent for row in rows]


def _is_inside(clock_ms: float) -> bool:
    """Whether a clock fits better than those a little before and after it."""
    first_ms, last_ms = (1e3 * end_s for end_s in _CLOCK_S)
    return first_ms + _END_MS < clock_ms < last_ms - _END_MS


def _median(values: Sequence[float], decimals: int) -> str:
    return f"{np.median(values):.{decimals}f}" if values else "–"


def _share(percent: float) -> str:
    return f"{percent:.2f}" if np.isfinite(percent) else "no poses"


def _summary(rows: Sequence[Row]) -> str:
    wrong = sum(row.is_wrong for row in rows)
    kept = sum(not row.failure and not row.lost for row in rows)
    said = (
        f"Held-out seeds, {len(rows)} sequences: {_errors(rows)}. Never lost on {kept}, silently "
        f"wrong on {wrong}; {_likely(rows)} % of true poses lie in the 95 % regions of those found."
    )
    sure = [row for row in rows if row.claimed_percent >= _MOSTLY]
    if len(sure) in (0, len(rows)):
        return said
    return f"{said} On the {len(sure)} where most poses are `tracking`: {_errors(sure)}."


def _errors(rows: Sequence[Row]) -> str:
    percent = _percent(rows)
    median, worst = (
        f"{_share(value)} %" if np.isfinite(value) else _share(value)
        for value in (float(np.median(percent)), max(percent))
    )
    ratios = [np.inf if row.ratio is None else row.ratio for row in rows]
    fitted = [row.clock_percent for row in rows if row.clock_percent is not None]
    return (
        f"ATE {median} of the way in the median, {worst} at worst, {_median(fitted, 2)} % in the "
        f"median by the best clock; depth errors {np.median(ratios):.2f} times those on true poses "
        f"in the median, {np.max(ratios):.2f} at worst"
    )


def _likely(rows: Sequence[Row]) -> str:
    """Each track counts alike."""
    shares = [row.within_percent for row in rows if row.within_percent is not None]
    return f"{np.mean(shares):.1f}" if shares else "–"


def simulated(twin: Twin, folder: Path) -> Path:
    """A twin's recording in the folder; made where it is not there."""
    path = folder / twin.name / "recording"
    if not path.exists():
        flags = ("--seconds", f"{twin.seconds:g}", "--seed", str(twin.seed), "--quiet")
        sensor = ("--sim.sensor.preset", twin.sensor, *(("--rig", twin.rig) if twin.rig else ()))
        code, said = _verb("simulate", twin.scene, "--out", str(path), *sensor, *flags)
        if code:
            raise InputError(f"{twin.name} could not be simulated: {said}")
    return path


def _verb(*arguments: str) -> tuple[int, str]:
    """Exit code of a command, and what it said."""
    said = StringIO()
    with redirect_stderr(said):
        code = eventsweep(arguments)
    if code == INTERRUPTED:
        raise KeyboardInterrupt
    return code, said.getvalue().strip()


def warm_up(path: Path) -> None:
    """Tracks a recording once for nothing: the first row's time shall hold no more than others'.

    The first run of the verb in a process loads or compiles kernels, and imports all of the page.
    """
    with TemporaryDirectory() as folder:
        _verb("track", str(path), "--out", str(Path(folder) / "track"), "--quiet")


def _tracked(twin: Twin, recording: Path, out: Path) -> Row:
    began_s = time.process_time()
    code, said = _verb("track", str(recording), "--out", str(out), "--force", "--quiet")
    cpu_s = time.process_time() - began_s
    if _NEVER_BEGAN in said:
        return Row(twin, "never began", None, None, 0.0, 0, cpu_s)
    if code not in (_TRACKED, _ENDED_LOST):  # a full disk is no result
        raise InputError(f"{twin.name} could not be tracked: {said}")
    values = es.score_trajectory(out, recording).values
    facts = json.loads((out / "track.json").read_text("utf-8"))
    lost = sum(change["status"] == Status.LOST.value for change in facts["changes"])
    ate_m, ate_percent, covered_percent = (
        float(values[metric]) for metric in ("ate_rmse", "ate_share", "time_covered")
    )
    poses = read_poses(out / FOUND_FILE)
    claims = claimed(poses, facts["changes"])
    return Row(
        twin, "", ate_m, ate_percent, covered_percent, lost, cpu_s, _depth_ratio(recording, out),
        100 * float(claims.mean()), is_wrong(recording, poses, claims), within(recording, out),
        *at_its_clock(es.open_recording(recording).trajectory, poses),
    )  # fmt: skip


def at_its_clock(truth: Trajectory, poses: Trajectory) -> tuple[float, float]:
    """The clock, ms later than that of the events, by which the ATE is least, and that, % of way.

    Poses lie on the events' clock, and events come later than what they show: how much, hangs on
    sensor and light, and events alone do not tell.
    """

    def ate(offset_s: float) -> float:
        config = TrajectoryConfig(offset_s=offset_s, associate="interpolate")
        return float(score_poses(truth, poses, config).values["ate_share"])

    best = minimize_scalar(ate, bounds=_CLOCK_S, method="bounded", options={"xatol": 1e-4})
    return 1e3 * float(best.x), float(best.fun)


def claimed(poses: Trajectory, changes: Sequence[dict[str, Any]]) -> NDArray[np.bool_]:
    """Which poses are said to be `tracking`, by the changes of status in `track.json`."""
    says = np.array([change["status"] == Status.TRACKING.value for change in changes])
    since_us = [change["t_us"] for change in changes]
    claims: NDArray[np.bool_] = says[np.searchsorted(since_us, poses.t_us, side="right") - 1]
    return claims


def is_wrong(recording: Path, poses: Trajectory, claims: NDArray[np.bool_]) -> bool:
    """Whether the poses that are claimed, aligned by themselves, are far from the true ones."""
    if claims.sum() < FEWEST_POSES:
        return False
    truth = es.open_recording(recording).trajectory
    kept = (poses.t_us[claims], poses.positions_m[claims], poses.quats_xyzw[claims])
    values = score_poses(truth, Trajectory(*kept)).values
    return bool(values["ate_share"] > MOST_OFF or values["scale_error"] > MOST_SCALE)


def within(recording: Path, out: Path) -> float:
    """Share, %, of poses whose true one is likely: in their 95 % region of position and turn.

    Of those that have a true one; the first of them is moved onto it.
    """
    found, truth = read_poses(out / FOUND_FILE), es.open_recording(recording).trajectory
    has_truth = (truth.t_us[0] <= found.t_us) & (found.t_us <= truth.t_us[-1])
    times_us = found.t_us[has_truth]
    T_world_body, T_true = found.at(times_us), truth.at(times_us)
    T_true = T_world_body[0] @ se3.inverse(T_true[0]) @ T_true
    covariances = np.zeros((len(found), 6, 6))
    covariances[:, *np.triu_indices(6)] = np.loadtxt(out / "covariances.txt", ndmin=2)[:, 1:]
    covariances += np.triu(covariances, 1).swapaxes(1, 2)
    covariances = covariances[has_truth]
    off = np.array([_off(*poses) for poses in zip(T_true, T_world_body, strict=True)])
    squares = np.einsum("ni,ni->n", off, np.linalg.solve(covariances, off[..., None])[..., 0])
    return 100 * float((squares[1:] < _LIKELY).mean())


def _off(T_true: NDArray[np.float64], T_world_body: NDArray[np.float64]) -> NDArray[np.float64]:
    """Errors (6,) of position, m, and turn, rad, along the world's axes, as in `drift`."""
    turn = np.eye(4)
    turn[:3, :3] = T_true[:3, :3] @ T_world_body[:3, :3].T
    return np.concatenate([T_true[:3, 3] - T_world_body[:3, 3], se3.log(turn)[3:]])


def _depth_ratio(path: Path, tracked: Path) -> float | None:
    """Maps the same windows on true poses and on those that were found; ratio of median errors."""
    recording = EventSequence.open(path)
    first_us, last_us = recording.event_span_us(0)
    times_us = range(first_us + 2 * _HALF_US, last_us - _HALF_US, _EVERY_US)
    there = set(recording.truth_times_us(0).tolist())
    windows = {
        f"w{k:03d}": Window(t_us - _HALF_US, t_us + _HALF_US, t_us, (0, 0))
        for k, t_us in enumerate([t_us for t_us in times_us if t_us in there][:_MOST_WINDOWS])
    }
    config, about = MapperConfig(methods=(_METHOD,)), RecordingInfo(name=path.name, path=str(path))
    poses = {"true": recording.trajectory, "found": found_poses(tracked)}
    with TemporaryDirectory() as folder:
        for name, trajectory in poses.items():
            out = Path(folder) / name
            map_on_poses(recording, trajectory, windows, config, out, about, clouds=False)
        true, found = (read_map(Path(folder) / name) for name in poses)
        own = own_estimates(found, true.windows)
        rows = score_windows("twin", recording, true.windows, EvalConfig(), own)
    pooled = rows[(rows["window"] == POOLED) & (rows["metric"] == "median_error")]
    errors_m = pooled.set_index("method")["value"]
    ratio = float(errors_m[method_on_own_poses(_METHOD)] / errors_m[_METHOD])
    return ratio if np.isfinite(ratio) else None


def _read(path: Path) -> Row:
    try:
        stored = json.loads(path.read_text("utf-8"))
        row = Row(**stored)
        return replace(row, twin=Twin(**stored["twin"]))
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: no row of this tool ({error}): remove the file") from error


def twins_of(scenes: Sequence[str], seeds: str, length_s: float | None = None) -> Iterator[Twin]:
    """Twins of `SCENE` or `SCENE=SEEDS`; of their own length if none is given."""
    for asked in scenes:
        scene, _, own = asked.partition("=")
        if scene not in TWINS:
            raise InputError(f"no twin {scene!r}: choose from {', '.join(TWINS)}")
        for seed in job_flags.seed_numbers(own or seeds, "--seeds") or ():
            drawn, sensor, seconds, rig = TWINS[scene]
            yield Twin(drawn, sensor, seed, length_s or seconds, rig)


def _length_s(text: str) -> float:
    seconds = float(text)
    if not 0 < seconds < np.inf:
        raise ValueError(text)
    return seconds


_VERBS = (
    "eventsweep.plugins.track.odometry.recorded", "eventsweep.eval.stages.simulate",
    "eventsweep.eval.scoring.trajectories.score",
)  # fmt: skip
"""What the verbs `simulate` and `track` run, and what scores poses."""


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        f"plugins/track/odometry.md#{MARK}": Code(
            (
                "track_scores:table",
                "track_scores:_depth_ratio",
                "track_scores:is_wrong",
                "track_scores:within",
                "track_scores:TWINS",
            ),
            _VERBS,
        )
        + of_scenes(scene for scene, *_ in TWINS.values())
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Prints the table, or writes it into a page; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(":")[0])
    parser.add_argument("--out", type=Path, required=True, help="folder of sequences and rows")
    parser.add_argument("--page", type=Path, help="page to write the table into")
    parser.add_argument("--scene", action="append", default=[], help="SCENE or SCENE=SEEDS")
    parser.add_argument("--seeds", default="4", help="seeds, such as 0,2-4")
    parser.add_argument("--seconds", type=_length_s, help="of every sequence, not the scene's own")
    asked = parser.parse_args(arguments)
    with exit_code() as ended:
        twins = list(twins_of(asked.scene or list(TWINS), asked.seeds, asked.seconds))
        show(table(measured(twins, asked.out)), asked.page, MARK, code)
    return ended.value


if __name__ == "__main__":
    raise SystemExit(main())
