"""Algorithms 1 and 2: event fusion across cameras and over time, for any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.depth.focus import parallax_baseline_m
from eventsweep.emvs.depth.kept_votes import KeptVotes
from eventsweep.emvs.dsi.backprojection import back_project
from eventsweep.emvs.dsi.device import Device, projector_on
from eventsweep.emvs.dsi.fusion import Target
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.dsi.sweep import slice_row, splits_of, sweep
from eventsweep.emvs.dsi.voting import VoteCounts
from eventsweep.emvs.errors import InputError, check_type
from eventsweep.emvs.methods import (
    check_methods,
    device_for_methods,
    methods_by_name,
    with_volume,
    without_volume,
)
from eventsweep.emvs.methods.method import Method, Swept
from eventsweep.emvs.reference_view import ReferenceView, reference_view
from eventsweep.emvs.utils.runtime import (
    Progress,
    Stopwatch,
    check_openmp,
    give_back_memory,
    silent,
)
from eventsweep.emvs.window_result import CameraCounts, WindowResult
from eventsweep.emvs.windows import Window, choose_window

_MANY_EVENTS = 1_000_000  # what fewer took is used again by the next window, at no cost


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
        progress: called with the stage (`rays`, then `sweep`, then each method without a volume by
            its name), what is done and how much there is.
        window: one of a plan (`emvs.windows`); by default what the configuration says.
        dsi_dir: where `save_dsi` writes the fused volumes.
        device: what computes (`emvs.methods.device_for_methods`); by default the configuration's.

    Raises:
        InputError: a window that events or poses do not cover, no events in it, an impossible depth
            range, an unknown method, a GPU that is not there or has too little memory.
    """
    stopwatch = Stopwatch()
    n_cameras = len(recording.rig)
    requested = methods_by_name(config.methods, n_cameras, mcemvs=config.is_mcemvs)
    methods, estimators = with_volume(requested), without_volume(requested)
    device = device_for_methods(config, requested) if device is None else device

    # 1. Input: events of one interval, camera poses and calibration.
    window = choose_window(recording, config) if window is None else window

    # 2. The reference view: by default camera 0 at the middle of the interval.
    view = reference_view(recording, config, window.t_ref_us)
    check_request(config, view, dsi_dir)
    check_methods(config, requested)
    baseline_m = baseline_for(methods, recording, window)

    # 3. Back-project the events of each camera, in sub-intervals where a fusion asks for them.
    targets = targets_of(methods, n_cameras, config)
    projected = back_project(
        recording, window, view, splits_of(targets), projector_on(device), progress,
        polarities=config.polarities, packets=config.is_mcemvs, min_events=config.min_events,
    )  # fmt: skip
    is_large = sum(count.events for count in projected.counts) >= _MANY_EVENTS
    if is_large:
        give_back_memory()  # of events, and of rays before they were grouped
    stopwatch.lap("rays")

    # 3. and 4. One volume per camera, fused in every way at once; plane by plane, none is kept
    # unless an extraction looks at the votes again.
    size = view.camera.height_px, view.camera.width_px
    keeps = any(method.extraction.keeps_votes for method in methods)
    kept = KeptVotes(n_cameras, len(view.rho), *size, config.polarities) if keeps else None
    result = sweep(
        projected, view, targets, config, progress, device,
        dsi_dir=dsi_dir if config.save_dsi else None, keep=None if kept is None else kept.take,
    )  # fmt: skip
    rays, event_image = projected.counts, projected.event_image
    del projected  # the rays themselves take more memory than what follows
    if is_large:
        give_back_memory()
    stopwatch.lap("sweep")

    # 5. Depth and confidence from the maxima over planes.
    swept = Swept(result, view, config, kept, baseline_m)
    depth_maps = {method.name: swept.depth_map(method) for method in methods}
    stopwatch.lap("depth")

    # Methods without a volume see the same input and answer in the same reference view.
    for done, estimator in enumerate(estimators, 1):
        progress(estimator.name, done, len(estimators))
        estimated = estimator.estimate(recording, window, view, config)
        depth_maps[estimator.name] = _checked(estimator.name, estimated, view)
        stopwatch.lap(estimator.name)

    empty = np.empty((0, view.camera.width_px), np.float32)
    rows = {method.name: result.rows.get(method.name, empty) for method in requested}
    return WindowResult(
        window=window,
        view=view,
        depth_maps={method.name: depth_maps[method.name] for method in requested},
        counts=tuple(map(CameraCounts, rays, result.votes or [VoteCounts()] * n_cameras)),
        slices=Slices(slice_row(view, config), view.rho, rows),
        event_image=event_image,
        seconds=stopwatch.seconds,
        config=config,
        device=device.name,
    )


def targets_of(
    methods: Sequence[Method], n_cameras: int, config: MapperConfig
) -> tuple[Target, ...]:
    """What the sweep does: the volumes of the methods, then of others whose maps they need."""
    requested = {method.name: method.target(config) for method in methods}
    parts = (part for method in methods for part in method.extraction.parts(n_cameras))
    needed = {part.name: part.target(config, requested=False) for part in parts}
    return tuple((requested | {n: t for n, t in needed.items() if n not in requested}).values())


def baseline_for(methods: Sequence[Method], recording: Recording, window: Window) -> float | None:
    """What disparities refer to, m; None where no extraction needs it and there is none."""
    try:
        return parallax_baseline_m(recording, window)
    except InputError:
        if any(method.extraction.needs_baseline for method in methods):
            raise
        return None


def _checked(name: str, estimated: DepthMap, view: ReferenceView) -> DepthMap:
    """The depth map of a method without a volume, under its name; refused if it is not of the view.

    Raises:
        InputError: names the method, what it gave and what is needed.
    """
    check_type(f"what {name} gives", estimated, DepthMap)
    shape = view.camera.height_px, view.camera.width_px
    images = (estimated.depth_m, estimated.mask, estimated.confidence, estimated.argmax)
    shapes = [np.shape(image) for image in images]
    if {*shapes} != {shape}:
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


def check_request(config: MapperConfig, view: ReferenceView, dsi_dir: Path | None) -> None:
    """Refuses before any work what would fail after it."""
    check_openmp()
    rows = view.camera.height_px
    if config.slice_row is not None and config.slice_row >= rows:
        raise InputError(f"slice_row is {config.slice_row}: the image has rows 0..{rows - 1}")
    if config.save_dsi and dsi_dir is None:
        raise InputError("save_dsi is set: needs an output folder for the volumes")
