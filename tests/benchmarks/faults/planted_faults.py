"""One-line breakages of mapper and simulator, for the test that the gate sees each of them."""

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

ROOT = Path(__file__).resolve().parents[3]
PACKAGES = ("emvs", "sim", "scenes", "eval", "eventsweep")


class Edit(Protocol):
    """A change of one line of `file`."""

    @property
    def file(self) -> str: ...

    def applied(self, text: str) -> str: ...


@dataclass(frozen=True)
class Fault:
    """`old` becomes `new` in one line of `file`."""

    name: str
    file: str
    old: str
    new: str

    def applied(self, text: str) -> str:
        """The file's text with the fault in it."""
        if text.count(self.old) != 1:
            raise ValueError(f"{self.name}: {self.file} has {text.count(self.old)} such lines")
        return text.replace(self.old, self.new)


FAULTS = (
    Fault(
        "wrong sign of the baseline",
        "emvs/dsi/rays_kernels.py",
        "ox, oy, oz = offset_m[0], offset_m[1], offset_m[2]",
        "ox, oy, oz = -offset_m[0], offset_m[1], offset_m[2]",
    ),
    Fault(
        "pose at the packet's start", "emvs/dsi/rays.py", "_PACKET_POSE = 512", "_PACKET_POSE = 0"
    ),
    Fault(
        "off by half a pixel",
        "emvs/dsi/rays.py",
        "        _bearings(camera), *poses,",
        "        _bearings(camera) + 0.5 / camera.fx_px, *poses,",
    ),
    Fault(
        "swapped cameras",
        "emvs/dsi/backprojection.py",
        "recording.events(k, window.t0_us",
        "recording.events(len(recording.rig) - 1 - k, window.t0_us",
    ),
    Fault(
        "C+ and C- exchanged",
        "sim/sensor/esim.py",
        "self._config.contrast_threshold_pos, self._config.contrast_threshold_neg",
        "self._config.contrast_threshold_neg, self._config.contrast_threshold_pos",
    ),
    Fault(
        "planes off by one",
        "emvs/reference_view.py",
        "position.astype(np.float64)",
        "position.astype(np.float64) + 1",
    ),
    Fault(
        "median off",
        "emvs/depth/depth_map.py",
        "position = masked_median(position, mask, config.median_px)",
        "position = position.copy()",
    ),
    Fault("eps of H times ten", "emvs/dsi/fusion_kernels.py", "np.float32(0.1)", "np.float32(1)"),
    Fault(
        "depth in the wrong frame",
        "emvs/reference_view.py",
        "recording.rig.T_body_cam[0].copy()",
        "recording.rig.T_body_cam[-1].copy()",
    ),
    Fault(
        "dropped tail",
        "emvs/dsi/rays.py",
        "return events, events.t_us",
        "return (kept := events.slice(0, len(events) // PACKET * PACKET)), kept.t_us",
    ),
)


def broken_copy(folder: Path, *edits: Edit, more: tuple[str, ...] = ()) -> Path:
    """Copies the packages, and `more`, and changes one line for each edit.

    Links stay links: what `eventsweep` links to is then the copy too. What was in the folder is
    gone. Numba finds kernels again by place and time of change: copies made one after the other in
    one folder compile only what an edit changes.
    """
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    for name in (*PACKAGES, *more):
        place = ROOT / name
        if place.is_dir():
            shutil.copytree(place, folder / name, symlinks=True)
        else:
            shutil.copy2(place, folder / name)
    for edit in edits:
        file = folder / edit.file
        file.write_text(edit.applied(file.read_text(encoding="utf-8")), encoding="utf-8")
    return folder
