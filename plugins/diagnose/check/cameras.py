"""Checks of the calibration: intrinsics that no lens has, distortion that folds, baselines."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.plugins.diagnose.check import limits
from eventsweep.plugins.diagnose.check.events import worst_camera
from eventsweep.plugins.diagnose.check.findings import Finding, Series, judged
from eventsweep.plugins.diagnose.check.limits import LIMITS, verdict_of

Floats = NDArray[np.float64]


def check_cameras(rig: Rig) -> list[Finding]:
    """Checks that need only the calibration."""
    findings = [
        worst_camera(list(map(check, rig.cameras)), rig.camera_names)
        for check in (_ratio, _centre, _field, _folds)
    ]
    return findings + ([_baseline(rig), _overlap(rig)] if len(rig) > 1 else [])


def _ratio(camera: Camera) -> Finding:
    ratio = camera.fx_px / camera.fy_px
    return judged(
        "focal-ratio", ratio,
        f"fx {camera.fx_px:.6g} px beside fy {camera.fy_px:.6g} px, a ratio of {ratio:.4g}",
        verdict=LIMITS["focal-ratio"].verdict(abs(np.log(ratio))),
    )  # fmt: skip


def _centre(camera: Camera) -> Finding:
    across = (camera.cx_px - (camera.width_px - 1) / 2) / (camera.width_px / 2)
    down = (camera.cy_px - (camera.height_px - 1) / 2) / (camera.height_px / 2)
    off, times = max(abs(across), abs(down)), image_times(camera)
    like = ", as if cx and cy were exchanged" if is_centre_exchanged(camera) else (
        f", as if of an image {times:.3g} times as large" if times != 1 else ""
    )  # fmt: skip
    return judged(
        "principal-point", off,
        f"at ({camera.cx_px:.4g}, {camera.cy_px:.4g}) px of {camera.width_px} x "
        f"{camera.height_px} px, {off:.0%} of half the image from its centre{like}",
        verdict="wrong" if like else None,
    )  # fmt: skip


def image_times(camera: Camera) -> float:
    """How many times as large an image is whose centre is the principal point; 1 if like this one.

    The principal point is then as far off in rows as in columns. Resolutions are simple ratios.
    """
    across, down = 2 * camera.cx_px / camera.width_px - 1, 2 * camera.cy_px / camera.height_px - 1
    off = max(abs(across), abs(down))
    usual = off <= LIMITS["principal-point"].usual[1]
    if usual or abs(across - down) >= limits.ALIKE * off or is_centre_exchanged(camera):
        return 1.0
    times = 1 + (across + down) / 2
    return min(limits.RATIOS, key=lambda ratio: abs(np.log(max(times, 1e-3) / ratio)))


def is_centre_exchanged(camera: Camera) -> bool:
    """Whether cx and cy are exchanged, on a sensor that is not square."""
    width, height = camera.width_px, camera.height_px
    if abs(width - height) < limits.OBLONG * max(width, height):
        return False
    as_given = np.hypot(camera.cx_px - width / 2, camera.cy_px - height / 2)
    exchanged = np.hypot(camera.cy_px - width / 2, camera.cx_px - height / 2)
    return bool(exchanged < limits.OBLONG * height and as_given > 2 * exchanged)


def field_deg(camera: Camera) -> float:
    """Field of view along the longer side, deg, without distortion but for a fisheye's."""
    half = max(camera.width_px / (2 * camera.fx_px), camera.height_px / (2 * camera.fy_px))
    return float(np.degrees(2 * (half if camera.model == "kb4" else np.arctan(half))))


def _field(camera: Camera) -> Finding:
    row, field = LIMITS["field-of-view"], field_deg(camera)
    most = [limits.FISHEYE_DEG] * 2 if camera.model == "kb4" else [row.usual[1], row.possible[1]]
    verdict = verdict_of(field, (row.usual[0], most[0]), (row.possible[0], most[1]))
    words = f"{field:.3g} deg with f {camera.fx_px:.4g} px on {camera.width_px} px"
    return judged("field-of-view", field, words, verdict=verdict)


def _folds(camera: Camera) -> Finding:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        bearing = camera.bearing_table()
    beyond = _beyond(camera)
    lost = float((np.isnan(bearing).any(axis=2) & ~beyond).mean())
    moved_px = _moved_px(camera, bearing)
    most_px = float(np.nanmax(moved_px)) if np.isfinite(moved_px).any() else 0.0
    bent = most_px / float(np.hypot(camera.width_px, camera.height_px) / 2)
    verdict = LIMITS["distortion"].verdict(lost)
    if verdict != "wrong" and camera.model == "radtan" and bent > limits.BENT[0]:
        verdict = "wrong" if bent > limits.BENT[1] else "doubtful"
    plain = (moved_px < limits.SEEN_PX).all()
    return judged(
        "distortion", lost,
        f"{lost:.1%} of the pixels have no ray; the most distorted is moved by {bent:.0%} of half "
        "the diagonal"
        + (f"; {beyond.mean():.1%} see beyond 180 deg: they are left out" if beyond.any() else ""),
        verdict=verdict,
        series=None if plain else Series(moved_px, y_label="moved by distortion, px"),
    )  # fmt: skip


def _beyond(camera: Camera) -> NDArray[np.bool_]:
    """(H, W) which pixels of a fisheye see beyond 180 deg: a sound lens may have some."""
    size = camera.height_px, camera.width_px
    if camera.model != "kb4":
        return np.zeros(size, bool)
    theta = np.linspace(0, np.pi / 2, 256)
    powers = theta[:, None] ** (3, 5, 7, 9)
    radius = theta + powers @ np.array(camera.distortion, float)
    if not (np.diff(radius) > 0).all():
        return np.zeros(size, bool)
    rows, columns = np.indices(size)
    x, y = (columns - camera.cx_px) / camera.fx_px, (rows - camera.cy_px) / camera.fy_px
    return np.asarray(np.hypot(x, y) >= radius[-1], bool)


def _moved_px(camera: Camera, bearing: Floats) -> Floats:
    """(H, W) how far each pixel lies from where a pinhole camera sees its ray, px."""
    columns, rows = np.meshgrid(np.arange(camera.width_px), np.arange(camera.height_px))
    straight = bearing * (camera.fx_px, camera.fy_px) + (camera.cx_px, camera.cy_px)
    return np.asarray(np.linalg.norm(straight - np.stack([columns, rows], axis=-1), axis=2))


def _baseline(rig: Rig) -> Finding:
    length_m = rig.baseline_m()
    suspect = "" if length_m > 0 else "extrinsics missing"
    words = f"cameras 0 and 1 are {length_m:.4g} m apart"
    return judged("baseline", length_m, words, suspect=suspect)


def _overlap(rig: Rig) -> Finding:
    axes = [T[:3, 2] for T in rig.T_body_cam]
    angle = float(np.degrees(np.arccos(np.clip(axes[0] @ axes[1], -1, 1))))
    share = angle / max(min(map(field_deg, rig.cameras[:2])), 1e-6)
    words = f"the optical axes of cameras 0 and 1 are {angle:.3g} deg apart"
    return judged("cameras-overlap", angle, words, verdict=LIMITS["cameras-overlap"].verdict(share))


def check_rectification(recording: Recording, t0_us: int, t1_us: int) -> Finding:
    """Offset between the rows of two rectified cameras, from their events per row.

    Where rows correspond, activity by row and short slice of time is the same in both cameras: the
    shift at which the two correlate best is the residual of the rectification.

    Args:
        recording: with two cameras.
        t0_us: begin of the stretch.
        t1_us: its end.
    """
    (first, whole), (second, whole_1) = (_row_activity(recording, k, t0_us, t1_us) for k in (0, 1))
    shared = np.flatnonzero(whole & whole_1)
    if len(shared) < limits.FEWEST_ROWS:
        few = f"rectified cameras share {len(shared)} rows"
        return Finding("rectification", "good", None, "px", f"{few}: too few for a verdict")
    rows = slice(int(shared[0]), int(shared[-1]) + 1)
    shifts, agreement = _agreement(_whitened(first[:, rows]), _whitened(second[:, rows]))
    best = int(np.argmax(agreement))
    residual_px, clear = _vertex(shifts, agreement, best), agreement[best] > limits.CLEAR_ROWS
    words = f"rows of the rectified cameras agree best {residual_px:+.1f} px apart"
    return judged(
        "rectification", residual_px,
        f"{words} (correlation {agreement[best]:.2f}{'' if clear else ', too low for a verdict'})",
        verdict=LIMITS["rectification"].verdict(abs(residual_px)) if clear else "good",
        series=Series(agreement, shifts, "shift, px", "correlation"),
    )  # fmt: skip


def _row_activity(
    recording: Recording, camera: int, t0_us: int, t1_us: int
) -> tuple[Floats, NDArray[np.bool_]]:
    """(slices, rows) events per pixel of each rectified row, and which rows a camera sees whole."""
    rig = recording.rig
    events = recording.events(camera, t0_us, t1_us)
    row, rows = _rectified_rows(rig, camera), 2 * rig.cameras[0].height_px
    pixels = np.bincount(row[row >= 0], minlength=rows)
    at = row[events.y, events.x]
    slices = max((t1_us - t0_us) // limits.SLICE_US, 1)
    when = np.clip((events.t_us - t0_us) // limits.SLICE_US, 0, slices - 1)
    cell = (when * rows + at)[at >= 0]
    counts = np.bincount(cell, minlength=slices * rows).reshape(slices, rows)
    seen = pixels[pixels > 0]
    whole = pixels > 0.9 * (np.median(seen) if len(seen) else np.inf)
    return np.sqrt(counts / np.maximum(pixels, 1)), whole


def _rectified_rows(rig: Rig, camera: int) -> NDArray[np.int64]:
    """(H, W) row of each pixel of a camera, at camera 0's focal length, in 2 H rows; -1: none."""
    R = _rectifying(rig) @ (se3.inverse(rig.T_body_cam[0]) @ rig.T_body_cam[camera])[:3, :3]
    rays, height = rig.cameras[camera].ray_table() @ R.T, rig.cameras[0].height_px
    with np.errstate(divide="ignore", invalid="ignore"):
        row = rays[..., 1] / rays[..., 2] * rig.cameras[0].fy_px + height
    seen = (rays[..., 2] > 0) & (row >= 0) & (row < 2 * height)
    return np.where(seen, np.where(seen, row, 0).astype(np.int64), -1)


def _rectifying(rig: Rig) -> Floats:
    """(3, 3) turns camera 0's axes so that x runs along the baseline."""
    x = (se3.inverse(rig.T_body_cam[0]) @ rig.T_body_cam[1])[:3, 3]
    length = np.linalg.norm(x)
    if length < 1e-9 or abs(x[2]) > 0.7 * length:  # one behind the other: there are no common rows
        return np.eye(3)
    x = x / length * (1 if abs(x[0]) < 1e-12 or x[0] > 0 else -1)
    y = np.cross([0.0, 0.0, 1.0], x)
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)])


def _whitened(rows: Floats) -> Floats:
    """Activity minus that of the rows around: a slope over the image must not correlate."""
    from scipy.ndimage import gaussian_filter1d

    return np.asarray(gaussian_filter1d(rows, 1.0, axis=1) - gaussian_filter1d(rows, 8.0, axis=1))


def _agreement(first: Floats, second: Floats) -> tuple[Floats, Floats]:
    most = first.shape[1] // limits.SHARE_OF_ROWS
    shifts = np.arange(-most, most + 1)
    inner = slice(most, -most)
    a = first[:, inner]
    values = []
    for shift in shifts:
        b = np.roll(second, -shift, axis=1)[:, inner]
        norm = np.sqrt((a * a).sum() * (b * b).sum())
        values.append(float((a * b).sum() / norm) if norm else 0.0)
    return shifts.astype(np.float64), np.array(values)


def _vertex(x: Floats, y: Floats, best: int) -> float:
    if not 0 < best < len(x) - 1:
        return float(x[best])
    bend = y[best - 1] - 2 * y[best] + y[best + 1]
    return float(x[best] + (0.5 * (y[best - 1] - y[best + 1]) / bend if bend else 0.0))
