"""`eventsweep events`: a video, or a folder of images, to events."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Group, Parameter

from eventsweep.eval.cli.app import CONFIGURED, SIM_GROUP, Configured, Force
from eventsweep.eval.cli.help import RARE
from eventsweep.sim.config import PixelConfig, VideoConfig

if TYPE_CHECKING:
    from eventsweep.eval.cli.console import Console
    from eventsweep.plugins.video.record import RecordedVideo

_VIDEO = Group.create_ordered("Video")
VideoFlags = Annotated[VideoConfig, Parameter(name="*", group=_VIDEO), RARE]
PixelFlags = Annotated[PixelConfig, Parameter(group=SIM_GROUP), RARE]


def events(
    source: Path,
    /,
    *,
    out: Path,
    to: str | None = None,
    calibration: Path | None = None,
    camera: Annotated[str | None, RARE] = None,
    poses: Path | None = None,
    seed: int = 0,
    force: Force = False,
    common: Configured = CONFIGURED,
    video: VideoFlags = VideoConfig(),  # noqa: B008 - frozen
    sim: PixelFlags = PixelConfig(),  # noqa: B008 - frozen
) -> None:
    """Turn a video, or a folder of images with times, into events.

    Args:
        source: Video file, or folder of PNG, JPEG, TIFF, EXR or npy images.
        out: Sequence folder to write, or an event file if named .h5, .raw, .aedat4, .csv ...
        to: Event format to write instead of what the name says; `eventsweep list formats`.
        calibration: Calibration of the camera that took the video.
        camera: Which camera of that file, such as cam0.
        poses: Poses of the camera in TUM format, on the video's clock.
        seed: Seed of sensor noise.
    """
    from eventsweep.plugins.video.record import View, record

    wanted = common.settings(sim=sim).sim
    console = common.console()
    with console.progress.stage("events", 1.0) as update:
        recorded = record(
            source,
            out,
            wanted,
            video,
            seed=seed,
            view=View(calibration, camera, poses),
            to=to,
            force=force,
            progress=lambda _stage, done, total: update(done / total, ""),
        )
        update(1.0, f"{recorded.events:,} events")
    _show(console, recorded)


def _show(console: Console, recorded: RecordedVideo) -> None:
    from eventsweep.eval.cli.console import dim
    from eventsweep.eval.cli.flag_names import with_flags

    duration_s = (recorded.span_us[1] - recorded.span_us[0]) * 1e-6
    line = (
        f"{recorded.events:,} events of {recorded.frames:,} frames, {recorded.width_px}x"
        f"{recorded.height_px} px, in {duration_s:g} s, {recorded.path}"
    )
    assumed = (
        f"times: {recorded.time_base}; values: {recorded.encoding}; "
        f"{recorded.lost_at_half_rate:.0%} fewer events at half the frame rate"
    )
    console.result(recorded.facts(), [line, dim(assumed)])
    for note in recorded.notes:
        console.warn(with_flags(note))
