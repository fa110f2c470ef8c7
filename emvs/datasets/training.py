"""Windows of events with the depth at their end, to learn from: as a data set, and as files.

Depth lies at the event camera's own pixels, where its events do, lens and all; a window ends when
its depth was taken, so that nothing in it comes from later. Nothing of torch is imported:
`torch.utils.data.DataLoader` takes anything with `__len__` and `__getitem__`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ground_truth import TruthRecording
from eventsweep.emvs.errors import InputError, check_type
from eventsweep.emvs.geometry.warp import reproject_depth
from eventsweep.emvs.utils.outputs import atomic_dir

Window = dict[str, Any]
MANIFEST = "windows.json"
WINDOW_S = 0.05


class TrainingWindows:
    """The windows of a recording with ground truth: a map-style data set.

    A window is a dict of NumPy values:

    - `x`, `y` (N,) uint16, `t_us` (N,) int64, `p` (N,) uint8: events with `t0_us <= t < t1_us`;
    - `depth_m` (H, W) float32: z-depth at `t1_us` at the sensor's pixels, m; NaN where unknown;
    - `t0_us`, `t1_us`: begin and end, µs;
    - `T_world_cam` (4, 4) float64: the camera's pose at `t1_us`;
    - `K` (3, 3) float64, `distortion` (k,) float64, `lens` (`pinhole`, `radtan` or `kb4`).

    Windows have different numbers of events, which torch's own collation cannot stack: give its
    `DataLoader` a `transform` here that makes arrays of one shape, or `collate_fn=list` there.

    Args:
        recording: a sequence or data set with ground truth, or its path.
        window_s: length of a window, s.
        stride_s: least time from one window's end to the next one's, s; by default each time with
            ground truth ends a window.
        camera: which camera; data sets have truth of the first.
        transform: what makes something else of each window.

    Raises:
        InputError: no ground truth of that camera, no window that the events cover, or an
            impossible length.
    """

    def __init__(
        self,
        recording: TruthRecording | str | Path,
        *,
        window_s: float = WINDOW_S,
        stride_s: float = 0.0,
        camera: int = 0,
        transform: Callable[[Window], Any] | None = None,
    ) -> None:
        opened = open_recording(recording) if isinstance(recording, (str, Path)) else recording
        check_type("camera", camera, int)
        if not 1e-6 <= window_s < 1e6 or not 0 <= stride_s < 1e6:
            raise InputError(
                f"windows of {window_s:g} s, {stride_s:g} s apart: needs a window_s of 1e-6 to "
                "1e6 s and a stride_s of 0 to 1e6 s"
            )
        if not 0 <= camera < len(opened.rig):
            raise InputError(f"{opened.name}: no camera {camera}, there are {len(opened.rig)}")
        if not hasattr(opened, "truth_times_us"):
            raise InputError(
                f"{opened.name}: a recording without ground truth; there is nothing to learn from"
            )
        self.recording: Any = opened
        self.window_s, self.stride_s, self.camera = window_s, stride_s, camera
        self._transform = transform
        self._ends_us = self._chosen_ends_us()

    def __repr__(self) -> str:
        return f"TrainingWindows({self.recording.name!r}, {len(self)} of {self.window_s:g} s)"

    def __len__(self) -> int:
        return len(self._ends_us)

    def __iter__(self) -> Iterator[Any]:
        return (self[k] for k in range(len(self)))

    def __getitem__(self, k: int) -> Any:
        """Reads a window; a negative number counts from the end.

        Raises:
            IndexError: there is none of that number.
            InputError: damaged files.
        """
        window = self._window(int(self._ends_us[k]))
        return window if self._transform is None else self._transform(window)

    def _window(self, t1_us: int) -> Window:
        recording, sensor = self.recording, self.recording.rig.cameras[self.camera]
        t0_us = t1_us - round(self.window_s * 1e6)
        events = recording.events(self.camera, t0_us, t1_us)
        T_world_body = recording.trajectory.at(t1_us)
        return {
            "x": events.x, "y": events.y, "t_us": events.t_us, "p": events.p,
            "depth_m": self._depth_m(t1_us), "t0_us": t0_us, "t1_us": t1_us,
            "T_world_cam": T_world_body @ recording.rig.T_body_cam[self.camera],
            "K": sensor.K, "distortion": np.array(sensor.distortion, np.float64),
            "lens": sensor.model,
        }  # fmt: skip

    def _depth_m(self, t_us: int) -> NDArray[np.float32]:
        if isinstance(self.recording, Sequence):
            depth_m = self.recording.truth_depth_m(self.camera, t_us)
        else:
            view_m = self.recording.truth_view_depth_m(self.camera, t_us)
            sensor = self.recording.rig.cameras[self.camera]
            depth_m = reproject_depth(view_m, sensor.undistorted(), sensor)
        known = np.isfinite(depth_m) & (depth_m > 0)
        return np.where(known, depth_m, np.nan).astype(np.float32)

    def _chosen_ends_us(self) -> NDArray[np.int64]:
        """Times of ground truth that end a window which events and poses cover."""
        recording, name = self.recording, self.recording.name
        times_us = np.sort(recording.truth_times_us(self.camera))
        if not len(times_us):
            raise InputError(
                f"{name}: no ground truth for camera {self.camera}; there is nothing to learn from"
            )
        first_us, last_us = recording.event_span_us(self.camera)
        pose_first_us, pose_last_us = recording.trajectory.span_us
        covered = (times_us - round(self.window_s * 1e6) >= first_us) & (times_us <= last_us)
        covered &= (times_us >= pose_first_us) & (times_us <= pose_last_us)
        chosen: list[int] = []
        for t_us in times_us[covered].tolist():
            if not chosen or t_us - chosen[-1] >= round(self.stride_s * 1e6):
                chosen.append(t_us)
        if not chosen:
            raise InputError(
                f"{name}: no window of {self.window_s:g} s before a time with ground truth lies in "
                f"{first_us} to {last_us} µs; needs a shorter window_s"
            )
        return np.array(chosen, np.int64)


def write_windows(
    windows: TrainingWindows,
    out: Path,
    *,
    force: bool = False,
    inputs: Collection[Path] = (),
    on_written: Callable[[int], None] | None = None,
) -> int:
    """Writes `000000.npz` ... with the fields of each window, and `windows.json` that lists them.

    Args:
        windows: without a transform.
        out: the folder; it appears whole or not at all.
        force: whether to replace an existing folder that this wrote.
        inputs: what it is made from, which it never replaces.
        on_written: called with the number of windows written so far; in the end it is returned.
    """
    with atomic_dir(out, force=force, inputs=inputs) as folder:
        rows = []
        for k, window in enumerate(windows):
            name = f"{k:06d}.npz"
            np.savez_compressed(folder / name, **window)
            events = len(window["t_us"])
            times = {name: window[name] for name in ("t0_us", "t1_us")}
            rows.append({"file": name, **times, "events": events})
            if on_written is not None:
                on_written(k + 1)
        rig, lengths = windows.recording.rig, ("window_s", "stride_s")
        manifest = {
            "schema_version": 1,
            "recording": windows.recording.name,
            "camera": rig.camera_names[windows.camera],
            "calibration": rig.cameras[windows.camera].to_json(),
            **{name: getattr(windows, name) for name in lengths},
            "windows": rows,
        }
        (folder / MANIFEST).write_text(json.dumps(manifest, indent=1) + "\n")
    return len(rows)
