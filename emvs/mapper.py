"""Algorithms 1 and 2: event fusion across cameras and over time, for any number of cameras."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from emvs import methods
from emvs.baselines import DepthEstimator
from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depth.depth_map import DepthMap, extract, union
from emvs.depth.focus import extract_in_focus, parallax_baseline_m
from emvs.dsi import device as devices
from emvs.dsi.backprojection import back_project
from emvs.dsi.device import Device
from emvs.dsi.method import WHOLE, Method, single_cameras
from emvs.dsi.rays import RayCounts
from emvs.dsi.slices import Slices
from emvs.dsi.sweep import Swept, grouped, sweep
from emvs.dsi.voting import VoteCounts
from emvs.errors import ByName, InputError
from emvs.reference_view import ReferenceView, reference_view
from emvs.utils.runtime import Progress, Stopwatch, check_openmp, silent
from emvs.windows import Window, choose_window


def map_window(
    recording: Recording,
    config: MapperConfig,
    progress: Progress = silent,
    *,
    window: Window | None = None,
    dsi_dir: Path | None = None,
    device: Device | None = None,
) -> WindowResult:
    """Maps one window of a recording by every requested method at once (paper, Alg. 1 and 2).

    Args:
        recording: events, poses and calibration.
        config: window, planes, methods, thresholds.
        progress: told the stage (`rays`, then `sweep`, then each method without a volume by its
            name), what is done and how much there is.
        window: one window of a plan (`emvs.windows`); by default what the configuration says.
        dsi_dir: where `save_dsi` writes the fused volumes.
        device: what computes (`emvs.dsi.device.for_methods`); by default what the configuration
            says.

    Raises:
        InputError: a window that events or poses do not cover, no events in it, an impossible depth
            range, an unknown method, a GPU that is not there or has too little memory.
    """
    stopwatch = Stopwatch()
    asked = methods.methods(config.methods, len(recording.rig), mcemvs=config.is_mcemvs)
    by_volume = methods.with_volume(asked)
    estimators = [method for method in asked if not isinstance(method, Method)]
    device = devices.for_methods(config.device, asked) if device is None else device

    # 1. Input: events of one interval, camera poses and calibration.
    window = choose_window(recording, config) if window is None else window

    # 2. The reference view: camera 0 at the middle of the interval, unless told otherwise.
    view = reference_view(recording, config, window.t_ref_us)
    check_request(config, view, dsi_dir)
    by_focus = any(method.focus for method in by_volume)
    baseline_m = parallax_baseline_m(recording, window) if by_focus else 0.0

    # 3. Back-project the events of each camera, in sub-intervals where a method asks for them.
    groups = grouped(by_volume, len(recording.rig))
    splits = [group.split for group in groups] or [WHOLE]
    projector = devices.projector(device)
    projected = back_project(recording, config, window, view, progress, splits, projector)
    stopwatch.lap("rays")

    # 3. and 4. One volume per camera, fused by every method at once; plane by plane, none is kept.
    swept = sweep(projected, view, groups, config, dsi_dir, progress, device)
    stopwatch.lap("sweep")

    # 5. Depth and confidence from the maxima over planes.
    depth_maps = _extracted(by_volume, swept, view, config, len(recording.rig), baseline_m)
    stopwatch.lap("depth")

    # Methods without a volume see the same input and answer in the same reference view.
    for done, estimator in enumerate(estimators, 1):
        progress(estimator.name, done, len(estimators))
        estimated = estimator.estimate(recording, window, view, config)
        depth_maps[estimator.name] = replace(estimated, method=estimator.name)
        stopwatch.lap(estimator.name)

    return WindowResult(
        window=window,
        view=view,
        depth_maps={method.name: depth_maps[method.name] for method in asked},
        counts=tuple(
            map(CameraCounts, projected.counts, swept.votes or [VoteCounts()] * len(recording.rig))
        ),
        slices=_with_empty(swept.slices, estimators, view),
        event_image=projected.event_image,
        seconds=stopwatch.seconds,
        config=config,
        device=device.name,
    )


def _extracted(
    methods: Sequence[Method], swept: Swept, view: ReferenceView, config: MapperConfig,
    n_cameras: int, baseline_m: float,
) -> dict[str, DepthMap]:  # fmt: skip
    """Every method's depth map, in order; late fusion joins those of the single cameras."""
    maps: dict[str, DepthMap] = {}
    by_focus = {method.name for method in methods if method.focus}
    for name, votes in swept.maxima.items():
        found = swept.focus.get(name)
        if found is not None and name in by_focus:
            maps[name] = extract_in_focus(name, votes, found, view, config, baseline_m)
        else:
            maps[name] = extract(name, votes, view, config, found.maximum if found else None)
    for method in methods:
        if method.late:
            single = [maps[one.name] for one in single_cameras(n_cameras)]
            maps[method.name] = union(method.name, single)
    return maps


def _with_empty(
    slices: Slices, estimators: Sequence[DepthEstimator], view: ReferenceView
) -> Slices:
    """The slices, with one of no planes for every method that has no volume."""
    empty = np.empty((0, view.camera.width_px), np.float32)
    return replace(slices, values={**slices.values, **{one.name: empty for one in estimators}})


def check_request(config: MapperConfig, view: ReferenceView, dsi_dir: Path | None) -> None:
    """Refuses before any work what would fail after it."""
    check_openmp()
    rows = view.camera.height_px
    if config.slice_row is not None and config.slice_row >= rows:
        raise InputError(f"slice_row is {config.slice_row}: the image has rows 0..{rows - 1}")
    if config.save_dsi and dsi_dir is None:
        raise InputError("save_dsi is set: needs an output folder for the volumes")


@dataclass(frozen=True)
class CameraCounts:
    """What became of one camera's events and of their votes.

    Attributes:
        events: by event; `events.rays` of them voted, once per plane.
        votes: by event and plane.
    """

    events: RayCounts
    votes: VoteCounts

    def to_json(self) -> dict[str, int]:
        """Plain numbers; `events` is the sum of the five that follow it."""
        return {
            "events": self.events.events,
            "voting": self.events.rays,
            "without_pose": self.events.without_pose,
            "without_ray": self.events.without_ray,
            "looking_backwards": self.events.backwards,
            "dropped_tail": self.events.dropped,
            "votes_counted": self.votes.counted,
            "votes_outside_image": self.votes.outside,
            "votes_behind_camera": self.votes.behind,
        }


@dataclass(frozen=True, eq=False)
class WindowResult:
    """One window, mapped.

    Attributes:
        window: the stretch of time.
        view: the reference view.
        depth_maps: method name -> depth map.
        counts: one per camera.
        slices: one image row of every fused volume.
        event_image: (2, H, W) uint32 events of camera 0 per pixel: darker, brighter.
        seconds: wall time per stage.
        config: what was asked for.
        device: what computed the sweep: `cpu`, or the name of a GPU; `cpu` where only rivals ran.
    """

    window: Window
    view: ReferenceView
    depth_maps: Mapping[str, DepthMap]
    counts: tuple[CameraCounts, ...]
    slices: Slices
    event_image: NDArray[np.uint32]
    seconds: Mapping[str, float]
    config: MapperConfig
    device: str = "cpu"

    def __post_init__(self) -> None:
        object.__setattr__(self, "depth_maps", ByName("method", self.depth_maps))

    def __repr__(self) -> str:
        camera, window = self.view.camera, self.window
        points = ", ".join(f"{name} {found.points}" for name, found in self.depth_maps.items())
        return (
            f"WindowResult({window.t0_us} to {window.t1_us} µs, view of {camera.width_px} x "
            f"{camera.height_px} px at {window.t_ref_us} µs, on {self.device};\n"
            f"  points: {points})"
        )
