"""Algorithms 1 and 2: event fusion across cameras and over time, for any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eventsweep.emvs.baselines import DepthEstimator
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap, extract, union
from eventsweep.emvs.depth.focus import extract_in_focus, parallax_baseline_m
from eventsweep.emvs.depth.precision import check_precision, stated
from eventsweep.emvs.dsi.backend import SweepSettings
from eventsweep.emvs.dsi.backprojection import back_project
from eventsweep.emvs.dsi.device import Device, device_for_methods, projector_on
from eventsweep.emvs.dsi.maxima import Measures
from eventsweep.emvs.dsi.method import WHOLE, Method, single_cameras
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.dsi.sweep import SweepResult, group_by_split, sweep
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.errors import InputError, check_type
from eventsweep.emvs.learned.derd import check_derd, extract_derd
from eventsweep.emvs.learned.extract import extract_learned
from eventsweep.emvs.learned.kept_votes import KeptVotes
from eventsweep.emvs.learned.network import network
from eventsweep.emvs.methods import AnyMethod, methods_by_name, with_volume
from eventsweep.emvs.reference_view import ReferenceView, reference_view
from eventsweep.emvs.utils.runtime import Progress, Stopwatch, check_openmp, silent
from eventsweep.emvs.window_result import CameraCounts, WindowResult
from eventsweep.emvs.windows import Window, choose_window


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
        device: what computes (`emvs.dsi.device.device_for_methods`); by default what the
            configuration says.

    Raises:
        InputError: a window that events or poses do not cover, no events in it, an impossible depth
            range, an unknown method, a GPU that is not there or has too little memory.
    """
    stopwatch = Stopwatch()
    n_cameras = len(recording.rig)
    requested = methods_by_name(config.methods, n_cameras, mcemvs=config.is_mcemvs)
    fusions = with_volume(requested)
    estimators = [method for method in requested if not isinstance(method, Method)]
    device = device_for_methods(config.device, requested) if device is None else device

    # 1. Input: events of one interval, camera poses and calibration.
    window = choose_window(recording, config) if window is None else window

    # 2. The reference view: camera 0 at the middle of the interval, unless told otherwise.
    view = reference_view(recording, config, window.t_ref_us)
    check_request(config, view, dsi_dir)
    check_reliability(config, requested)
    baseline_m = _baseline_m(recording, window, needed=any(method.focus for method in fusions))

    # 3. Back-project the events of each camera, in sub-intervals where a method asks for them.
    groups = group_by_split(fusions, n_cameras)
    splits = [group.split for group in groups] or [WHOLE]
    projected = back_project(
        recording, window, view, splits, projector_on(device), progress,
        polarities=config.polarities, packets=config.is_mcemvs, min_events=config.min_events,
    )  # fmt: skip
    stopwatch.lap("rays")

    # 3. and 4. One volume per camera, fused by every method at once; plane by plane, none is kept
    # unless a network looks at the votes again.
    kept = votes_to_keep(fusions, view, config, n_cameras)
    swept = sweep(
        projected, view, groups, sweep_settings(config), progress, device,
        slice_row=config.slice_row, dsi_dir=dsi_dir if config.save_dsi else None,
        keep=None if kept is None else kept.take,
    )  # fmt: skip
    rays, event_image = projected.counts, projected.event_image
    del projected  # the rays themselves take more memory than what follows
    stopwatch.lap("sweep")

    # 5. Depth and confidence from the maxima over planes.
    depth_maps = _extracted(fusions, swept, kept, view, config, n_cameras, baseline_m)
    stopwatch.lap("depth")

    # Methods without a volume see the same input and answer in the same reference view.
    for done, estimator in enumerate(estimators, 1):
        progress(estimator.name, done, len(estimators))
        estimated = estimator.estimate(recording, window, view, config)
        depth_maps[estimator.name] = _answered(estimator.name, estimated, view)
        stopwatch.lap(estimator.name)

    return WindowResult(
        window=window,
        view=view,
        depth_maps={method.name: depth_maps[method.name] for method in requested},
        counts=tuple(map(CameraCounts, rays, swept.votes or [VoteCounts()] * n_cameras)),
        slices=_with_empty(swept.slices, estimators, view),
        event_image=event_image,
        seconds=stopwatch.seconds,
        config=config,
        device=device.name,
    )


def sweep_settings(config: MapperConfig) -> SweepSettings:
    """What the mapper's configuration says of the sweep."""
    return SweepSettings(
        sums="nearest" if config.voting == "nearest" else config.voting_precision,
        polarities=config.polarities,
        measures=Measures(config.extraction, config.focus_measure, config.focus_sigma_px),
        threads=config.threads,
    )


def _baseline_m(recording: Recording, window: Window, *, needed: bool) -> float | None:
    """What disparities refer to, m; None where nothing needs it and there is none."""
    try:
        return parallax_baseline_m(recording, window)
    except InputError:
        if needed:
            raise
        return None


def votes_to_keep(
    methods: Sequence[Method], view: ReferenceView, config: MapperConfig, n_cameras: int
) -> KeptVotes | None:
    """Room for every camera's votes, where a method looks at them after the sweep; else None."""
    if not any(method.keeps_votes for method in methods):
        return None
    size = view.camera.height_px, view.camera.width_px
    return KeptVotes(n_cameras, len(view.rho), *size, config.polarities)


def _extracted(
    methods: Sequence[Method], swept: SweepResult, kept: KeptVotes | None, view: ReferenceView,
    config: MapperConfig, n_cameras: int, baseline_m: float | None,
) -> dict[str, DepthMap]:  # fmt: skip
    """Every method's depth map, in order; late fusion joins those of the single cameras."""
    per_rho_px = None if baseline_m is None else baseline_m * view.camera.fx_px
    maps: dict[str, DepthMap] = {}
    asked = {method.name: method for method in methods}
    for name, votes in swept.maxima.items():
        focus, method = swept.focus.get(name), asked.get(name)
        if method is not None and method.focus and focus is not None and baseline_m is not None:
            if method.learned and kept is not None:
                maps[name] = extract_learned(method, votes, focus, kept, view, config, baseline_m)
            else:
                maps[name] = extract_in_focus(name, votes, focus, view, config, baseline_m)
        elif method is not None and method.derd and kept is not None:
            maps[name] = extract_derd(method, votes, kept, view, config)
        else:
            found = extract(name, votes, view, config, focus.maximum if focus else None)
            maps[name] = stated(found, per_rho_px, config)
    for method in methods:
        if method.late:
            single = [maps[one.name] for one in single_cameras(n_cameras)]
            maps[method.name] = union(method.name, single)
    return maps


def _answered(name: str, estimated: DepthMap, view: ReferenceView) -> DepthMap:
    """A depth map that somebody's method made, under its name; refused if it is none of the view.

    Raises:
        InputError: names the method, what it gave and what is needed.
    """
    check_type(f"what {name} gives", estimated, DepthMap)
    shape = view.camera.height_px, view.camera.width_px
    images = (estimated.depth_m, estimated.mask, estimated.confidence, estimated.argmax)
    shapes = [np.shape(image) for image in images]
    if any(one != shape for one in shapes):
        raise InputError(
            f"{name} gives depth, mask, confidence and argmax of {', '.join(map(str, shapes))}: "
            f"the reference view has {shape}"
        )
    finite = np.isfinite(estimated.depth_m)
    bad = int(np.count_nonzero(estimated.mask & ~(finite & (estimated.depth_m > 0))))
    if bad:
        raise InputError(
            f"{name} gives {bad} depths that are not finite and positive: clear them in its mask"
        )
    # Finite everywhere, as all depth maps are.
    depth_m = np.where(finite, estimated.depth_m, np.float32(1))
    return replace(estimated, method=name, depth_m=depth_m.astype(np.float32, copy=False))


def _with_empty(
    slices: Slices, estimators: Sequence[DepthEstimator], view: ReferenceView
) -> Slices:
    """The slices, with one of no planes for every method that has no volume."""
    empty = np.empty((0, view.camera.width_px), np.float32)
    return replace(slices, values={**slices.values, **{one.name: empty for one in estimators}})


def check_reliability(config: MapperConfig, methods: Sequence[AnyMethod]) -> None:
    """Refuses before any work what networks cannot do, and a precision that nobody knows."""
    if any(isinstance(method, Method) and method.learned for method in methods):
        network(config.learned_weights)
    if any(isinstance(method, Method) and method.derd for method in methods):
        check_derd(config)
    check_precision(config.min_precision, [method.name for method in methods])


def check_request(config: MapperConfig, view: ReferenceView, dsi_dir: Path | None) -> None:
    """Refuses before any work what would fail after it."""
    check_openmp()
    rows = view.camera.height_px
    if config.slice_row is not None and config.slice_row >= rows:
        raise InputError(f"slice_row is {config.slice_row}: the image has rows 0..{rows - 1}")
    if config.save_dsi and dsi_dir is None:
        raise InputError("save_dsi is set: needs an output folder for the volumes")
