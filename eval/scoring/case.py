"""All numbers of one case: its maps, those on poses found from events, and the poses themselves."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.results.results import DEFAULT_MAPPER, Results, Sample, mapper_method
from eventsweep.eval.results.table import EVENTS, POOLED, tidy, together
from eventsweep.eval.scoring.metric_versions import metric_versions
from eventsweep.eval.scoring.pairing import REFERENCE, Estimate
from eventsweep.eval.scoring.run_folder import Scored, Tracked, provenance, with_truth
from eventsweep.eval.scoring.score import rig_rows, score_windows
from eventsweep.eval.scoring.trajectories.own_poses import own_estimates, pose_rows
from eventsweep.eval.scoring.trajectories.score import metric_versions as trajectory_versions

if TYPE_CHECKING:
    import pandas as pd

Estimates = Iterator[Mapping[str, Estimate]]
_EVENTS, _TRUTH = "cam0/events.h5", "cam0/truth.h5"


@dataclass(frozen=True)
class CaseMaps:
    """What there is to score of a case.

    Attributes:
        recording: what was mapped; with ground truth, but for `describe_case`.
        windows: by mapper.
        own: by mapper, the map on poses that were found from events.
        poses: those poses, or why there are none; None where nobody looked for them.
        config: of the mapper, where there is one for all.
        scene: hash over what defines the scene.
    """

    name: str
    recording: Scored
    windows: Mapping[str, Sequence[StoredWindow]]
    own: Mapping[str, StoredMap] = field(default_factory=dict)
    poses: Trajectory | str | None = None
    config: MapperConfig | None = None
    scene: str = ""

    @classmethod
    def of_map(
        cls, name: str, recording: Scored, stored: StoredMap, tracked: Tracked | None = None,
        scene: str = "",
    ) -> CaseMaps:  # fmt: skip
        """What a map folder holds, with what a tracker found."""
        own = {} if tracked is None else {DEFAULT_MAPPER: tracked.map}
        poses = None if tracked is None else tracked.poses
        windows = {DEFAULT_MAPPER: stored.windows}
        return cls(name, recording, windows, own, poses, stored.info.config, scene)

    def with_truth(self, config: EvalConfig) -> CaseMaps:
        """Without the windows that have no ground truth at their reference time; one must have."""
        kept = {
            mapper: with_truth(windows, self.recording, config)
            for mapper, windows in self.windows.items()
        }
        return replace(self, windows=kept)


def score_case(
    case: CaseMaps, config: EvalConfig, others: Estimates | None = None, *, in_suite: bool = False
) -> Results:
    """Scores every window, all of them pooled, and their mean, for each mapper.

    There are rows about the events, which a gate looks at, and all methods are compared with the
    reference method on common pixels. In a suite every window must have ground truth. In a run
    there are rows about the rig's parallax, too, and windows without it are left out and counted.

    Args:
        case: what there is.
        config: how.
        others: for each window that has ground truth, by name, depth maps of other methods.
        in_suite: whether it is the case of a suite.
    """
    scored = case if in_suite else case.with_truth(config)
    tables: list[pd.DataFrame] = []
    for mapper, windows in scored.windows.items():
        own = own_estimates(case.own[mapper], windows) if mapper in case.own else None
        estimates = own if others is None else others if own is None else _both(others, own)
        rows = score_windows(case.name, case.recording, windows, config, estimates, REFERENCE)
        tables.append(rows.assign(method=[mapper_method(m, mapper) for m in rows["method"]]))
    tables.insert(1, _context_rows(scored, in_suite=in_suite))
    configuration, versions = _settings_of(case, scored), metric_versions()
    if case.poses is not None:
        rows, notes = pose_rows(case.name, case.recording.trajectory, case.poses)
        tables.append(rows)
        versions |= trajectory_versions()
        configuration["track"] = _tracking_of(case, notes)
    sample = sample_of(scored, versions)
    return Results(together(tables), {case.name: configuration}, (sample,), {}, "")


def describe_case(case: CaseMaps) -> Results:
    """What can be said of maps without ground truth: the events that made them, and their depths.

    Of each method the number of pixels with a depth, `reported`, and `median_depth`, m, of all
    windows together: enough to see that a program's maps of a recording have changed.
    """
    (windows,) = case.windows.values()
    depths_m = (
        (method, _depths_m([window.depth_map(method) for window in windows]))
        for method in windows[0].info.methods
    )
    rows = together(
        [event_rows(case.name, map(_counted, windows)), _depth_rows(case.name, depths_m)]
    )
    settings = {"rig": case.recording.rig.name, **_map_settings(case)}
    settings["windows"] = {"scored": 0, "without_truth": len(windows)}
    return Results(rows, {case.name: settings}, (sample_of(case, {}),), {}, "")


def _depths_m(maps: Sequence[DepthMap]) -> NDArray[np.float32]:
    return np.concatenate([one.depth_m[one.mask] for one in maps])


def _depth_rows(case: str, depths_m: Iterable[tuple[str, NDArray[np.float32]]]) -> pd.DataFrame:
    rows: list[dict[str, Any]] = []
    for method, depth_m in depths_m:
        about = {"case": case, "window": POOLED, "method": method}
        count, median_m = depth_m.size, float(np.median(depth_m)) if depth_m.size else math.nan
        rows += [
            {**about, "metric": "reported", "value": count, "unit": "px", "direction": "higher"},
            {
                **about,
                "metric": "median_depth",
                "value": median_m,
                "unit": "m",
                "direction": "none",
            },
        ]
    return tidy(rows)


def _counted(window: StoredWindow) -> tuple[Iterable[Mapping[str, int]], NDArray[np.integer]]:
    return window.info.counts.values(), window.event_image


def _context_rows(case: CaseMaps, *, in_suite: bool) -> pd.DataFrame:
    first = next(iter(case.windows.values()))
    events = event_rows(case.name, map(_counted, first))
    if in_suite:
        return events
    return together([events, rig_rows(case.name, case.recording, [w.info for w in first])])


def _settings_of(case: CaseMaps, scored: CaseMaps) -> dict[str, Any]:
    settings = provenance(case.recording) | _map_settings(case)
    counts = [sum(map(len, maps.windows.values())) for maps in (scored, case)]
    if counts[0] < counts[1]:
        settings["windows"] = {"scored": counts[0], "without_truth": counts[1] - counts[0]}
    return settings


def _map_settings(case: CaseMaps) -> dict[str, Any]:
    return {} if case.config is None else {"map": case.config.model_dump(mode="json")}


def _tracking_of(case: CaseMaps, notes: Sequence[str]) -> dict[str, Any]:
    maps = case.own.values()
    counts = {
        "windows": sum(len(own.windows) for own in maps),
        "skipped": sum(len(own.info.skipped) for own in maps),
    }
    return {**counts, "notes": list(notes)}


def _both(others: Estimates, own: Estimates) -> Estimates:
    """Depth maps of others beside those on poses that were found, for each window."""
    return ({**a, **b} for a, b in zip(others, own, strict=True))


def sample_of(case: CaseMaps, metrics: Mapping[str, str]) -> Sample:
    """Where the numbers of a case come from."""
    windows = {
        window.info.name: (window.info.t0_us, window.info.t1_us, window.info.t_ref_us)
        for stored in case.windows.values()
        for window in stored
    }
    if not isinstance(case.recording, EventSequence):
        return Sample(case.name, metrics=dict(metrics), windows=windows)
    manifest = case.recording.manifest
    hashes = {name: file.sha256 for name, file in manifest.files.items()}
    return Sample(
        case.name, manifest.seed, manifest.digest(), hashes.get(_EVENTS, ""),
        hashes.get(_TRUTH, ""), case.scene, manifest.renderer, manifest.configuration,
        manifest.versions, dict(metrics), windows,
    )  # fmt: skip


def event_rows(
    case: str, windows: Iterable[tuple[Iterable[Mapping[str, int]], NDArray[np.integer]]]
) -> pd.DataFrame:
    """Event statistics: a fault may lose some without a trace in the depth.

    Each window has the counts of its cameras, and (2, H, W) events per pixel of camera 0: darker
    and brighter ones.
    """
    counts: list[Mapping[str, int]] = []
    image = np.zeros(2, np.int64)
    for of_cameras, event_image in windows:
        counts += of_cameras
        image += event_image.sum((1, 2), dtype=np.int64)
    total = {name: sum(camera[name] for camera in counts) for name in counts[0]}
    outcomes = ("counted", "outside_image", "behind_camera")
    votes = sum(total[f"votes_{outcome}"] for outcome in outcomes)
    shares = {
        "brighter_share": (image[1], image.sum(), "none"),
        "voting_share": (total["voting"], total["events"], "higher"),
        "votes_in_image_share": (total["votes_counted"], votes, "none"),
    }
    numbers: list[tuple[str, float, str, str]] = [
        ("events", float(total["events"]), "events", "none"),
        ("dropped_tail", float(total["dropped_tail"]), "events", "lower"),
    ]
    for name, (part, whole, direction) in shares.items():
        share = 100 * float(part) / float(whole) if whole else math.nan
        numbers.append((name, share, "%", direction))
    about: dict[str, Any] = {"case": case, "window": POOLED, "method": EVENTS}
    names = ("metric", "value", "unit", "direction")
    return tidy(about | dict(zip(names, number, strict=True)) for number in numbers)
