"""Folders of images and video files that tests make, and the events of a folder on disk."""

import cv2
import numpy as np

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.formats import open_events
from eventsweep.plugins.video import frames as _quiet  # noqa: F401 - FFmpeg heeds it at its first use alone


def drifting(count, width_px=40, height_px=30, step_px=0.7, colour=False):
    """Frames (N, H, W[, 3]) uint8 of a smooth texture that moves sideways."""
    rng = np.random.default_rng(7)
    shape = (height_px + 20, width_px + 60 + int(count * step_px), *([3] if colour else []))
    noise = cv2.GaussianBlur(rng.random(shape, np.float32), (0, 0), 2)
    texture = cv2.normalize(noise, None, 5, 250, cv2.NORM_MINMAX)
    centre = width_px / 2 + 10, height_px / 2 + 5
    views = [
        cv2.getRectSubPix(texture, (width_px, height_px), (centre[0] + step_px * k, centre[1]))
        for k in range(count)
    ]
    return np.rint(views).astype(np.uint8)


def write_folder(folder, frames, stamps=None, suffix=".png", listed="timestamps.txt"):
    """Writes frames as `0.png`, `1.png` ..., and lines of times beside them."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, frame in enumerate(frames):
        write_image(folder / f"{k}{suffix}", frame)
    if stamps is not None:
        (folder / listed).write_text("".join(f"{stamp}\n" for stamp in stamps))
    return folder


def write_image(path, image):
    if path.suffix == ".npy":
        np.save(path, image)
    elif path.suffix == ".exr":
        import OpenEXR

        name = "RGB" if image.ndim == 3 else "Y"
        OpenEXR.File({}, {name: np.ascontiguousarray(image, np.float32)}).write(str(path))
    else:
        assert cv2.imwrite(str(path), image[..., ::-1] if image.ndim == 3 else image)


def write_video(path, frames, rate_hz=25.0, codec="MJPG"):
    """Writes colour frames (N, H, W, 3), red first."""
    size_px = frames.shape[2], frames.shape[1]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate_hz, size_px)
    assert writer.isOpened()
    for frame in frames:
        writer.write(np.ascontiguousarray(frame[..., ::-1]))
    writer.release()
    return path


def decoded(path):
    """What OpenCV decodes of a video, (N, H, W, 3), red first."""
    capture, frames = cv2.VideoCapture(str(path), cv2.CAP_FFMPEG), []
    while (read := capture.read())[0]:
        frames.append(read[1][..., ::-1])
    return np.array(frames)


def events_of(path):
    """All events of a sequence, or of an event file."""
    if path.is_dir():
        sequence = Sequence.open(path)
        first_us, last_us = sequence.manifest.span_us
        return sequence.events(0, first_us, last_us + 1)
    reader = open_events(path)
    return Events.concat(list(reader.chunks(reader.streams[0])))


def rows(events):
    """Rows (t_us, y, x, p)."""
    columns = (events.t_us, events.y, events.x, events.p)
    return list(zip(*(column.tolist() for column in columns), strict=True))
