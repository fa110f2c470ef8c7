"""Draws the README's moving picture: `python docs/figures/draw_demo.py docs/images/demo.webp`.

A stereo pair moves like a head before the scene `desk`. Beside each other: what the left camera
sees, its events of the last 10 ms, and the points of all windows mapped so far, with the pair.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import eventsweep as es
from eventsweep import scenery

SECONDS, WINDOW_S, STRIDE_S = 1.0, 0.1, 0.02
EVENTS_US = 10_000
METHOD = "Focus/H"
VOXEL_M, WINDOWS = 0.012, 2  # a voxel is shown once as many windows have a point in it
PANEL_PX, HEAD_PX, FOCAL_PX = (400, 300), 26, 330.0
TURNS_DEG = np.r_[np.linspace(0, 35, 12), np.linspace(35, 0, 12)]
FRAME_MS, BACKGROUND, INK = 70, (14, 17, 23), (225, 228, 235)
RED, BLUE, RIG = (255, 96, 64), (80, 150, 255), (255, 214, 90)

FRUSTUM_M = np.array(
    [(0, 0, 0), (-0.08, -0.06, 0.1), (0.08, -0.06, 0.1), (0.08, 0.06, 0.1), (-0.08, 0.06, 0.1)]
)
"""A camera as it is drawn: its centre and the corners of its picture."""

Picture = NDArray[np.uint8]


class Cloud:
    """Voxels with a point, and in how many windows they had one."""

    def __init__(self) -> None:
        self.windows: dict[tuple[int, int, int], int] = {}

    def add(self, points_m: NDArray[np.floating[Any]]) -> None:
        """Counts the points of one window."""
        for voxel in {tuple(row) for row in np.floor(points_m / VOXEL_M).astype(int).tolist()}:
            self.windows[voxel] = self.windows.get(voxel, 0) + 1

    def points_m(self) -> NDArray[np.float64]:
        """Middles of the voxels that enough windows agree on, (N, 3)."""
        kept = [voxel for voxel, count in self.windows.items() if count >= WINDOWS]
        return VOXEL_M * (np.array(kept, np.float64).reshape(-1, 3) + 0.5)


def projected(
    points_m: NDArray[np.floating[Any]], T_world_seen: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Pixels (N, 2) and depths (N,) of points in the panel; depth 0 or less is behind."""
    seen = (points_m - T_world_seen[:3, 3]) @ T_world_seen[:3, :3]
    uv = FOCAL_PX * seen[:, :2] / np.maximum(seen[:, 2:], 1e-6) + np.array(PANEL_PX) / 2
    return np.round(np.clip(uv, -1e5, 1e5)).astype(np.int64), seen[:, 2]


def cloud_panel(
    points_m: NDArray[np.float64],
    eye: NDArray[np.float64],
    T_world_seen: NDArray[np.float64],
    cameras: list[NDArray[np.float64]],
) -> Image.Image:
    """Points, coloured by their distance from the eye from red to blue, and the pair's frusta."""
    picture = np.full((PANEL_PX[1], PANEL_PX[0], 3), BACKGROUND, np.uint8)
    uv, depth_m = projected(points_m, T_world_seen)
    inside = (depth_m > 0.05) & ((uv >= 1) & (uv < np.array(PANEL_PX) - 1)).all(axis=1)
    order = np.flatnonzero(inside)[np.argsort(-depth_m[inside])]
    far_m = np.linalg.norm(points_m[order] - eye, axis=1)
    shade = np.clip(np.log(far_m / 0.5) / np.log(4.0 / 0.5), 0, 1)
    colours = (255 * mpl.colormaps["turbo_r"](0.08 + 0.84 * shade)[:, :3]).astype(np.uint8)
    for du, dv in ((0, 0), (1, 0), (0, 1), (1, 1)):
        picture[uv[order, 1] + dv, uv[order, 0] + du] = colours
    image = Image.fromarray(picture)
    draw = ImageDraw.Draw(image)
    for T_world_cam in cameras:
        corners = FRUSTUM_M @ T_world_cam[:3, :3].T + T_world_cam[:3, 3]
        found, _ = projected(corners, T_world_seen)
        a, *b = (tuple(row) for row in found.tolist())
        draw.line([*b, b[0]], fill=RIG, width=2)
        for corner in b:
            draw.line([a, corner], fill=RIG, width=1)
    return image


def events_panel(events: es.Events, shape: tuple[int, int]) -> Image.Image:
    """Red where pixels became brighter, blue where darker."""
    picture = np.full((*shape, 3), BACKGROUND, np.uint8)
    picture[events.y, events.x] = np.where(events.p[:, None] == 1, RED, BLUE)
    return Image.fromarray(picture).resize(PANEL_PX, Image.Resampling.BILINEAR)


def frame_panel(intensity: Picture) -> Image.Image:
    """Linear light as it is: brightened for a screen, the scene's light walls look pale."""
    return Image.fromarray(intensity).resize(PANEL_PX, Image.Resampling.BICUBIC).convert("RGB")


def beside(panels: list[Image.Image], titles: list[str]) -> Image.Image:
    """Panels in a row, each with its title above."""
    whole = Image.new("RGB", (PANEL_PX[0] * len(panels), PANEL_PX[1] + HEAD_PX), BACKGROUND)
    draw, font = ImageDraw.Draw(whole), ImageFont.load_default(size=15)
    for k, (panel, title) in enumerate(zip(panels, titles, strict=True)):
        whole.paste(panel, (k * PANEL_PX[0], HEAD_PX))
        draw.text((k * PANEL_PX[0] + 8, 4), title, fill=INK, font=font)
    return whole


def frames(sequence: es.Sequence, stored: es.StoredMap) -> list[Image.Image]:
    """The pictures, in order."""
    eye = sequence.trajectory.at(round(0.5e6 * SECONDS))[:3, 3]
    ahead = sequence.trajectory.at(round(0.5e6 * SECONDS))[:3, 2]
    target = eye + 1.1 * ahead
    cloud, pictures, left, middle = Cloud(), list[Image.Image](), None, None
    titles = ["left camera", f"events of {EVENTS_US / 1e3:g} ms", ""]

    def seen_from(turn_deg: float) -> NDArray[np.float64]:
        turn = np.deg2rad(turn_deg)
        about_z = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0],
                            [0, 0, 1]])  # fmt: skip
        side = np.cross(ahead, (0, 0, 1))
        off = about_z @ (-2.1 * ahead - 0.75 * side + (0, 0, 0.75))
        return scenery.look_at(tuple(target + off), tuple(target))

    for window in stored.windows:
        t_us = window.info.t_ref_us
        depth_map = window.depth_map(METHOD)
        cloud.add(es.back_project_map(depth_map).points_world)
        T_world_body = sequence.trajectory.at(t_us)
        cameras = [T_world_body @ T for T in sequence.rig.T_body_cam]
        points_m = cloud.points_m()
        left = frame_panel(sequence.truth_intensity(0, t_us))
        events = sequence.events(0, t_us - EVENTS_US, t_us)
        size = sequence.rig.cameras[0]
        middle = events_panel(events, (size.height_px, size.width_px))
        titles[2] = f"points after {len(pictures) + 1} windows: {len(points_m):,}"
        panel = cloud_panel(points_m, eye, seen_from(0), cameras)
        pictures.append(beside([left, middle, panel], titles))
    assert left is not None
    assert middle is not None
    for turn_deg in TURNS_DEG:
        panel = cloud_panel(points_m, eye, seen_from(float(turn_deg)), cameras)
        pictures.append(beside([left, middle, panel], titles))
    return pictures


def main(path: Path) -> None:
    """Simulates, maps, and writes the picture."""
    with tempfile.TemporaryDirectory() as name:
        config = es.SimConfig(duration_s=SECONDS, truth_interval_s=STRIDE_S / 2)
        sequence = es.simulate("desk", f"{name}/sequence", config, seed=0)
        mapped = es.MapperConfig(methods=(METHOD,), window_s=WINDOW_S, stride_s=STRIDE_S)
        pictures = frames(sequence, es.map_windows(sequence, f"{name}/map", mapped))
    first, *others = pictures
    first.save(
        path, save_all=True, append_images=others, duration=FRAME_MS, loop=0, quality=60, method=6
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
