"""Methods on real events, beside depth that no event took part in: `real_check --slider FOLDER`.

The recording is `slider_depth` of the Event Camera Dataset: one camera on a slider, a scene at
rest. Its own frames give depth (`frame_depth`); events seen 10 cm farther on, restamped, are a real
second camera (`slid_pair`). All methods report as many pixels as Alg1/H, those that they hold most
reliable, and are scored where the frames give depth: silhouettes are not among it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray
from PIL import Image

from eventsweep.emvs.config import PLANES, MapperConfig
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ecd import EventCameraDataset
from eventsweep.emvs.depth.depth_map import DepthMap, without_border
from eventsweep.emvs.dsi.method import MethodName
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.eval.cli.exit_codes import exit_code
from eventsweep.plugins.learned.methods.learned import at_reference_px
from frame_depth import FrameDepth, depth_from_frames, undistorted
from markdown_blocks import show
from slid_pair import SlidPair, straight_way
from table_code import Code, of_methods

_COLOURS = 255
_DEPTH_M, _ERROR_PERCENT = (0.4, 2.0), (0, 3)
_JUDGED = ("Focus", "Learned")
"""Families whose reliability chooses among more candidates than they report."""


def ranks(depth_map: DepthMap, per_rho_px: float) -> NDArray[np.float32]:
    """(H, W) what ranks the pixels of a method, 0 or less where there is no candidate.

    `per_rho_px` is disparity per inverse depth, px m. Methods that hold no pixel more reliable than
    others rank those that they report.
    """
    reliability = depth_map.reliability
    if reliability is None:
        return depth_map.mask.astype(np.float32)
    if MethodName.of(depth_map.method).family == "Learned":
        return at_reference_px(reliability, per_rho_px / depth_map.depth_m)
    return reliability


def most_reliable(depth_map: DepthMap, per_rho_px: float, points: int) -> NDArray[np.bool_]:
    """As many pixels as wanted, the most reliable first; what votes rank keeps to its own."""
    judged = MethodName.of(depth_map.method).family in _JUDGED
    candidates = depth_map.mask
    if judged and depth_map.reliability is not None:
        candidates = without_border(depth_map.reliability > 0, MapperConfig().border_px)
    rank, allowed = ranks(depth_map, per_rho_px), np.flatnonzero(candidates)
    mask = np.zeros(rank.shape, np.bool_)
    mask.flat[allowed[np.argsort(-rank.flat[allowed], kind="stable")[:points]]] = True
    return mask


def draw(truth: FrameDepth, maps: Sequence[DepthMap], baseline_m: float, path: Path) -> None:
    """Writes a PNG: frame and true depth left; each method's depth above, its error below.

    All report as many points as the first one, those that they hold most reliable.
    """
    figure, axes = plt.subplots(2, 1 + len(maps), figsize=(13, 5), layout="constrained", dpi=80)
    axes[0, 0].imshow(truth.frame, cmap="gray")
    axes[0, 0].set(title="frame")
    _dots(axes[1, 0], np.where(truth.known, truth.depth_m, np.nan), "depth from frames, m", False)
    for column, one in enumerate(maps, 1):
        mask = most_reliable(one, baseline_m * one.camera.fx_px, maps[0].points)
        _dots(
            axes[0, column], np.where(mask, one.depth_m, np.nan), f"{one.method}: depth, m", False
        )
        percent = 100 * np.abs(one.depth_m - truth.depth_m) / truth.depth_m
        shown = np.where(mask & truth.known, percent, np.nan)
        _dots(axes[1, column], shown, f"{one.method}: |error|, %", True)
    for axis in axes.flat:
        axis.set_xticks([])
        axis.set_yticks([])
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # type: ignore[no-untyped-call]
    pixels = np.asarray(canvas.buffer_rgba())  # type: ignore[no-untyped-call]
    Image.fromarray(pixels).convert("RGB").quantize(_COLOURS).save(path, optimize=True)
    plt.close(figure)


def _dots(axes: Axes, image: NDArray[np.floating], title: str, is_error: bool) -> None:
    rows, columns = np.nonzero(np.isfinite(image))
    low, high = _ERROR_PERCENT if is_error else _DEPTH_M
    shown = axes.scatter(
        columns, rows, c=image[rows, columns], s=1.6, linewidths=0, vmin=low, vmax=high,
        cmap="inferno" if is_error else "turbo_r",
    )  # fmt: skip
    axes.set(title=title, xlim=(0, image.shape[1]), ylim=(image.shape[0], 0), aspect="equal")
    axes.set_facecolor("#d8d8d8")
    axes.figure.colorbar(shown, ax=axes, shrink=0.7)


BASE = "Alg1/H"
STEREO = (BASE, "Focus/H", "Learned/H", "DERD/H")
SINGLE = ("EMVS/cam0", "Focus/cam0", "Learned/cam0")
DEVELOPMENT_M, HELD_OUT_M = (0.45,), (0.3, 0.6, 0.75)
WINDOWS_S = (0.8, 0.4, 0.2)
BASELINE_M = 0.1
DEPTH_RANGE_M = 0.3, 4.0
OUTLIER = 0.05  # relative error
HELD = "within", "within_both"
# A flat board at the back of the scene: left, right, top and bottom in the world, and its depth, m
_BOARD_M, _BOARD_DEPTH_M, _BOARD_REACH_M = (0.34, 0.73, -0.55, -0.17), 2.1, 0.3
_FEWEST_ON_BOARD, _REFITS = 10, 20


@dataclass(frozen=True)
class Scores:
    """One method at one view, by one window.

    Attributes:
        points: that it reports, of as many as it may.
        with_truth: those of them where the frames give depth.
        median, mean: relative error of these.
        over: share of these beyond `OUTLIER`.
        plane: median distance from the plane through its own points on a flat board, relative;
            NaN where fewer than ten lie there.
        within: share of its own points that lie within the error that it states; NaN where it
            states none.
        within_both: share of them within that error and the truth's own together, which are
            independent: a truth as wrong as the method makes its errors look larger.
    """

    points: int
    with_truth: int
    median: float
    mean: float
    over: float
    plane: float
    within: float
    within_both: float


@dataclass(frozen=True)
class Sample:
    """One view and window: every method's scores by its name."""

    view_m: float
    window_s: float
    scores: Mapping[str, Scores]

    def ratio(self, name: str, metric: str) -> float:
        """A method's number over that of `BASE`."""
        found = getattr(self.scores[name], metric), getattr(self.scores[BASE], metric)
        return float(found[0] / found[1])


def frame_depth_at(recording: EventCameraDataset, view_m: float) -> FrameDepth:
    """What the recording's frames say of the view from `view_m` on the slider's way.

    Raises:
        InputError: no frames on both sides of it.
    """
    t_us, x_m = straight_way(recording)
    times = [int(t) for t in recording.frame_times_us(0) if t_us[0] <= t <= t_us[-1]]
    if not times:
        raise InputError(f"{recording.name}: no frames; needs images.txt and its images")
    offsets_m = np.interp(times, t_us, x_m) - view_m
    near = [k for k, offset_m in enumerate(offsets_m) if abs(offset_m) < 0.25]
    camera = recording.rig.cameras[0]
    images = [recording.frame(0, times[k]) for k in near]
    frames = [undistorted(image, camera) for image in images if image is not None]
    return depth_from_frames(frames, offsets_m[near], camera.fx_px)


def samples(
    recording: EventCameraDataset, views_m: Sequence[float], windows_s: Sequence[float], planes: int
) -> Iterator[tuple[Sample, FrameDepth, Mapping[str, DepthMap]]]:
    """Maps every view by every window; beside the scores come truth and depth maps."""
    pair = SlidPair(recording, BASELINE_M)
    t_us, x_m = straight_way(recording)
    first_us, _ = pair.event_span_us(0)
    for view_m in views_m:
        truth = frame_depth_at(recording, view_m)
        reference_s = (round(float(np.interp(view_m, x_m, t_us))) - first_us) / 1e6
        for window_s in windows_s:
            config = MapperConfig(
                methods=STEREO + SINGLE, planes=planes, start_s=reference_s - window_s / 2,
                duration_s=window_s, reference_s=reference_s, min_depth_m=DEPTH_RANGE_M[0],
                max_depth_m=DEPTH_RANGE_M[1], max_pose_gap_s=1,
            )  # fmt: skip
            maps = map_window(pair, config).depth_maps
            points = maps[BASE].points
            scores = {name: scored(one, truth, points, view_m) for name, one in maps.items()}
            yield Sample(view_m, window_s, scores), truth, maps


def scored(depth_map: DepthMap, truth: FrameDepth, points: int, view_m: float) -> Scores:
    """A method's most reliable points beside the frames' depth."""
    mask = most_reliable(depth_map, BASELINE_M * depth_map.camera.fx_px, points)
    relative = np.abs(depth_map.depth_m - truth.depth_m) / truth.depth_m
    error, own = relative[mask & truth.known], depth_map.mask & truth.known
    within, within_both = _held(depth_map, relative[own], own, truth.own_error)
    there = len(error) > 0
    return Scores(
        points=int(mask.sum()),
        with_truth=len(error),
        median=float(np.median(error)) if there else float("nan"),
        mean=float(error.mean()) if there else float("nan"),
        over=float((error > OUTLIER).mean()) if there else float("nan"),
        plane=board_residual(depth_map, mask, view_m),
        within=within,
        within_both=within_both,
    )


def _held(
    depth_map: DepthMap, relative: NDArray[np.float32], own: NDArray[np.bool_], truth_error: float
) -> tuple[float, float]:
    """Shares of errors within the stated band: as it is, and joined by the truth's own error."""
    if depth_map.error_m is None or not own.any():
        return float("nan"), float("nan")
    band = depth_map.error_m[own] / depth_map.depth_m[own]
    return float((relative <= band).mean()), float((relative <= np.hypot(band, truth_error)).mean())


def board_residual(depth_map: DepthMap, mask: NDArray[np.bool_], view_m: float) -> float:
    """Median distance of points on the board from the plane through them, as a share of depth.

    A plane in space is linear in inverse depth over the image. It is fitted to the points within
    four of their own deviations, until those are the same.
    """
    camera = depth_map.camera
    left, right, top, bottom = _BOARD_M
    v, u = np.nonzero(mask)
    ray_x, ray_y = (u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px
    x_m, y_m = ray_x * _BOARD_DEPTH_M + view_m, ray_y * _BOARD_DEPTH_M
    on = (x_m > left) & (x_m < right) & (y_m > top) & (y_m < bottom)
    rho = 1 / depth_map.depth_m[v, u].astype(np.float64)
    terms = np.stack([ray_x, ray_y, np.ones(len(u))], axis=1)[on]
    return _plane_residual(terms, rho[on])


def _plane_residual(terms: NDArray[np.float64], rho: NDArray[np.float64]) -> float:
    used, off = np.abs(1 / rho - _BOARD_DEPTH_M) < _BOARD_REACH_M, np.full_like(rho, np.nan)
    for _ in range(_REFITS):
        if used.sum() < _FEWEST_ON_BOARD:
            return float("nan")
        plane = np.linalg.lstsq(terms[used], rho[used], rcond=None)[0]
        off = np.abs(rho - terms @ plane)
        before, used = used, off < max(4 * 1.4826 * float(np.median(off[used])), 4e-4)
        if (before == used).all():
            break
    return float(np.median(off / rho))


def report(found: Sequence[Sample]) -> str:
    """Markdown: all views and windows together."""
    lines = [
        f"| Method | median / {BASE} | mean / {BASE} | over 5 % | residual of a plane % "
        "| stated band holds % | joined by the truth's % |",
        "|---|--:|--:|--:|--:|--:|--:|",
    ]
    for name in STEREO + SINGLE:
        median, mean = (_mean_of([one.ratio(name, m) for one in found]) for m in ("median", "mean"))
        scores = [one.scores[name] for one in found]
        over = 100 * np.mean([one.over for one in scores])
        plane = _range([100 * one.plane for one in scores], ".2f")
        held = [_range([100 * getattr(one, m) for one in scores], ".0f") for m in HELD]
        cells = f"{median:.2f} | {mean:.2f} | {over:.2f} | {plane} | {' | '.join(held)}"
        lines.append(f"| `{name}` | {cells} |")
    return "\n".join(lines) + "\n"


def _mean_of(ratios: Sequence[float]) -> float:
    return float(np.exp(np.mean(np.log(ratios))))


def _range(values: Sequence[float], digits: str) -> str:
    known = [value for value in values if np.isfinite(value)]
    return f"{min(known):{digits}}–{max(known):{digits}}" if known else "none stated"


TABLE = "plugins/learned/learned.md#real"


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {TABLE: Code(("real_check:samples", "real_check:report")) + of_methods(STEREO + SINGLE)}


def main(arguments: list[str] | None = None) -> int:
    """Maps, scores and prints; exit code 2 on bad input."""
    parser = argparse.ArgumentParser(prog="python tests/benchmarks real_check", description=__doc__)
    parser.add_argument("--slider", type=Path, required=True, help="folder of slider_depth")
    parser.add_argument(
        "--views", type=float, nargs="+", default=[*DEVELOPMENT_M, *HELD_OUT_M],
        help="places of the reference view on the slider's way, m",
    )  # fmt: skip
    parser.add_argument("--windows", type=float, nargs="+", default=list(WINDOWS_S), help="s")
    parser.add_argument("--planes", type=int, default=PLANES)
    parser.add_argument("--page", type=Path, help="page whose marked part gets the tables")
    parser.add_argument("--mark", default="real", help="name of that part")
    parser.add_argument("--picture", type=Path, help="draws the last view and window")
    chosen = parser.parse_args(arguments)
    with exit_code() as ended:
        recording = open_recording(chosen.slider)
        if not isinstance(recording, EventCameraDataset):
            raise InputError(f"{chosen.slider}: needs slider_depth of the Event Camera Dataset")
        found = list(samples(recording, chosen.views, chosen.windows, chosen.planes))
        text = report([one for one, _, _ in found])
        show(text, chosen.page, chosen.mark, code)
        if chosen.picture is not None:
            _, truth, maps = found[-1]
            draw(truth, [maps[name] for name in STEREO[:3]], BASELINE_M, chosen.picture)
    return ended.value


if __name__ == "__main__":
    sys.exit(main())
