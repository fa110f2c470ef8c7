"""What mapping needs at the very least, against what there is: hopeless requests end at once."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import DerivedRecording, Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.reference_view import ReferenceView
from eventsweep.emvs.utils.files import bytes_text, free_bytes
from eventsweep.emvs.utils.runtime import available_bytes
from eventsweep.emvs.windows import Window, time_steps

_EVENT_BYTES = 13 + 16  # columns of the event, float32 of its ray
_PIXEL_BYTES = 4 + 4 + 4 + 1  # depth, confidence, argmax, mask


def check_view_fits(view: ReferenceView, methods: int, config: MapperConfig, out: Path) -> None:
    """Refuses planes and images of so many methods that memory, or with `save_dsi` the disk, lacks.

    `out` is a folder on the disk that takes the volumes; its parents may not exist yet.
    """
    pixels = view.camera.width_px * view.camera.height_px
    rows = len(view.rho) * view.camera.width_px
    what = f"{methods} maps of {view.camera.width_px} x {view.camera.height_px} px and "
    what += f"{len(view.rho)} planes"
    need_memory(methods * (_PIXEL_BYTES * pixels + 4 * rows), what, "lower the planes or methods")
    volumes = 4 * methods * len(view.rho) * pixels
    free = free_bytes(out)
    if config.save_dsi and volumes > free:
        raise InputError(
            f"{out}: save_dsi of {what} needs {bytes_text(volumes)}, {bytes_text(free)} are free "
            "on that disk: lower the planes or methods, or leave save_dsi out"
        )


def check_window_fits(recording: Recording, window: Window) -> None:
    """Refuses a window whose events alone are more than memory holds; counts them only in doubt."""
    known = getattr(_stored(recording), "event_count", None)
    cameras = range(len(recording.rig))
    available = available_bytes()
    if known is not None and _EVENT_BYTES * sum(map(known, cameras)) <= available:
        return
    events = 0
    for t0_us, t1_us in time_steps(recording, window.t0_us, window.t1_us):
        events += sum(len(recording.events(camera, t0_us, t1_us)) for camera in cameras)
        what = f"a window of {(window.t1_us - window.t0_us) / 1e6:g} s with {events} events or more"
        need_memory(_EVENT_BYTES * events, what, "choose a shorter one")


def _stored(recording: Recording) -> Recording:
    """The recording that another was made from: it has all of its events, and maybe more."""
    while isinstance(recording, DerivedRecording):
        recording = recording.recording
    return recording


def need_memory(needed: int, what: str, cure: str) -> None:
    """Refuses what needs more memory than there is."""
    available = available_bytes()
    if needed > available:
        raise InputError(
            f"{what} needs at least {bytes_text(needed)} of memory, "
            f"{bytes_text(available)} are free: {cure}"
        )
