"""Events of videos for users of the library: what `eventsweep events` does."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.errors import check_path, check_whole
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.plugins.video.record import RecordedVideo, View, record
from eventsweep.sim.config import PixelConfig, VideoConfig


def video_to_events(
    source: str | Path,
    out: str | Path,
    config: PixelConfig | None = None,
    video: VideoConfig | None = None,
    seed: int = 0,
    *,
    calibration: str | Path | None = None,
    camera: str | None = None,
    poses: str | Path | None = None,
    to: str | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> RecordedVideo:
    """Turns a video, or a folder of images with times, into events.

    Args:
        source: a video file, or a folder of PNG, JPEG, TIFF, EXR or npy images.
        out: folder of a sequence, or file of events, as the name's end says; whole or not at all.
        config: thresholds and what is imperfect about the sensor; by default ideal pixels.
        video: when frames were taken, and what light their values stand for.
        seed: of the sensor's noise, 0 or more.
        calibration: of the camera that took the video, so that the result can be mapped.
        camera: which of the cameras in that file, if there are several.
        poses: of that camera in TUM format, on the video's clock.
        to: `sequence` or an event format, whatever `out` is called.
        force: whether to replace `out`.
        progress: called with `events`, and how many of 1000 parts of the video are done.

    Returns:
        What was written, what was taken for granted, and what to know of it.

    Raises:
        InputError: no time base, an image that is damaged or of another size, times that do not
            rise, a codec that is not there, an existing `out`, or what else cannot be used.
    """
    for name, path in {"source": source, "out": out}.items():
        check_path(name, path)
    check_whole("seed", seed)
    view = View(
        None if calibration is None else Path(calibration),
        camera,
        None if poses is None else Path(poses),
    )
    pixels, video = PixelConfig.or_default(config), VideoConfig.or_default(video)
    return record(
        Path(source), Path(out), pixels, video,
        seed=seed, view=view, to=to, force=force,
        progress=progress,
    )  # fmt: skip
