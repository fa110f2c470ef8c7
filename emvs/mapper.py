"""Algorithm 1: stereo event fusion across cameras, for any number of cameras."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from emvs import fusion
from emvs.backproject import back_project
from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.depthmap import extract
from emvs.errors import InputError
from emvs.fusion import Method
from emvs.progress import Progress, Stopwatch, silent
from emvs.rays import Rays
from emvs.result import CameraCounts, Slices, WindowResult
from emvs.running import RunningMaxima
from emvs.sweep import Scratch, VoteCounts, batch_planes, batches, cast_all
from emvs.threads import use_threads
from emvs.view import ReferenceView, reference_view
from emvs.volume import SliceRecorder, volume_writer
from emvs.window import choose_window


def map_window(
    recording: Recording,
    config: MapperConfig,
    progress: Progress = silent,
    *,
    dsi_dir: Path | None = None,
) -> WindowResult:
    """Maps one window of a recording by every requested method at once (paper, Alg. 1).

    Args:
        recording: events, poses and calibration.
        config: window, planes, methods, thresholds.
        progress: told the stage (`rays`, then `sweep`), what is done and how much there is.
        dsi_dir: where `save_dsi` writes the fused volumes.

    Raises:
        InputError: a window that events or poses do not cover, no events in it, an impossible depth
            range, an unknown method.
    """
    stopwatch = Stopwatch()
    methods = fusion.methods(config.methods, len(recording.rig), reference=config.is_reference)

    # 1. Input: events of one interval, camera poses and calibration.
    window = choose_window(recording, config)

    # 2. The reference view: camera 0 at the middle of the interval, unless told otherwise.
    view = reference_view(recording, config, window.t_ref_us)
    _check_request(config, view, dsi_dir)

    # 3. Back-project the events of each camera.
    rays, event_image = back_project(recording, config, window, view, progress)
    stopwatch.lap("rays")

    # 3. and 4. One volume per camera, fused by every method at once; plane by plane, none is kept.
    swept = _sweep(rays, view, methods, config, dsi_dir, progress)
    stopwatch.lap("sweep")

    # 5. Depth and confidence from the maxima over planes.
    depth_maps = {
        method.name: extract(method.name, swept.maxima.of(k), view, config)
        for k, method in enumerate(methods)
    }
    stopwatch.lap("depth")

    return WindowResult(
        window=window,
        view=view,
        depth_maps=depth_maps,
        counts=tuple(CameraCounts(r.counts, v) for r, v in zip(rays, swept.votes, strict=True)),
        slices=swept.slices,
        event_image=event_image,
        seconds=stopwatch.seconds,
    )


@dataclass(frozen=True, eq=False)
class _Swept:
    maxima: RunningMaxima
    slices: Slices
    votes: list[VoteCounts]


def _sweep(
    rays: list[Rays],
    view: ReferenceView,
    methods: Sequence[Method],
    config: MapperConfig,
    dsi_dir: Path | None,
    progress: Progress,
) -> _Swept:
    width_px, height_px = view.camera.width_px, view.camera.height_px
    row_px = height_px // 2 if config.slice_row is None else config.slice_row
    threads = use_threads(config.threads)
    scratch = Scratch(len(rays), batch_planes(config.planes, threads), width_px, height_px)
    maxima = RunningMaxima(methods, width_px, height_px)
    slices = SliceRecorder(methods, config.planes, width_px, row_px)
    votes = [VoteCounts()] * len(rays)
    shape = (config.planes, height_px, width_px)
    with volume_writer(dsi_dir if config.save_dsi else None, methods, shape) as volumes:
        for first, last in batches(config.planes, threads):
            cast = cast_all(scratch, rays, view.rho[first:last])
            maxima.fold(scratch.votes, last - first)
            slices.take(first, scratch.images(last - first))
            volumes.take(scratch.images(last - first))
            votes = [before + now for before, now in zip(votes, cast, strict=True)]
            progress("sweep", last, config.planes)
    return _Swept(maxima, Slices(row_px, view.rho, slices.values), votes)


def _check_request(config: MapperConfig, view: ReferenceView, dsi_dir: Path | None) -> None:
    """Refuses before any work what would fail after it."""
    rows = view.camera.height_px
    if config.slice_row is not None and config.slice_row >= rows:
        raise InputError(f"slice_row is {config.slice_row}: the image has rows 0..{rows - 1}")
    if config.save_dsi and dsi_dir is None:
        raise InputError("save_dsi is set: needs an output folder for the volumes")
