"""The page of a refined calibration: what changed, how sure it is, a window before and after."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from markupsafe import Markup
from matplotlib.figure import Figure

from eventsweep.emvs.baselines.rectification import Rectified
from eventsweep.emvs.calibrate.epipolar import epipolar_residuals_px
from eventsweep.emvs.calibrate.folder import estimate_facts, write_refined
from eventsweep.emvs.calibrate.refine import Estimate, RefineConfig, Refinement, refine
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.mapper import map_window
from eventsweep.emvs.reference_view import depth_range_m
from eventsweep.emvs.utils.outputs import atomic_dir
from eventsweep.emvs.utils.runtime import versions
from eventsweep.emvs.window_result import WindowResult
from eventsweep.emvs.windows import Window
from eventsweep.eval.figures.colormaps import depth_scale
from eventsweep.eval.figures.images import depth_image, point_size_px
from eventsweep.eval.figures.plots import (
    ESTIMATE_COLOUR,
    STYLE,
    TRUTH_COLOUR,
    DsiSlice,
    slice_svg,
    svg_of,
)
from eventsweep.eval.progress import Progress
from eventsweep.eval.report.html import (
    REPORT_NAME,
    Grid,
    GridCell,
    Head,
    environment,
    files_in,
    inline,
    plural,
    versions_grid,
)

_ROWS_PX = 5.0


@dataclass(frozen=True, eq=False)
class Side:
    """A window under one calibration.

    Attributes:
        name: `as given` or `refined`.
        mapped: the window's depth map and one row of its DSI.
        residuals_px: (N,) rows between matched patches of both cameras; none for one camera.
    """

    name: str
    mapped: WindowResult
    residuals_px: np.ndarray[Any, np.dtype[np.float64]]

    @property
    def method(self) -> str:
        """The one method that was mapped."""
        return next(iter(self.mapped.depth_maps))


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A finished refinement and what was written.

    Attributes:
        refinement: what was found.
        notes: what there is to know of the files.
    """

    refinement: Refinement
    notes: tuple[str, ...]


def calibrate_recording(
    recording: Recording, path: Path, out: Path, config: RefineConfig, progress: Progress, *,
    force: bool = False, command: str = "",
) -> Calibrated:  # fmt: skip
    """Refines a recording and writes the folder: calibration, `recording.toml` and page.

    Args:
        recording: the one to refine.
        path: where it lies; never replaced.
        out: folder that appears whole or not at all.
        config: what to refine.
        progress: shows how far it is.
        force: whether to replace an output of ours.
        command: for the provenance.

    Raises:
        InputError: what `emvs.calibrate.refine.refine` refuses, or an output that exists.
    """
    with progress.stage("calibrate", 1.0) as update:
        refinement = refine(recording, config, _moving(update))
        update(1.0, _summary(refinement))
    with progress.stage("before and after", 3.0) as update:
        sides = _sides(recording, refinement, update)
        with atomic_dir(out, force=force, inputs=(path,)) as folder:
            notes = write_refined(folder, out, recording, refinement, command)
            text = page_text(recording, refinement, sides, notes, command, folder)
            (folder / REPORT_NAME).write_text(text, encoding="utf-8")
        update(3.0, "")
    return Calibrated(refinement, notes)


def facts_of(calibrated: Calibrated) -> dict[str, Any]:
    """What `--json` prints."""
    refinement = calibrated.refinement
    return {
        "estimates": [estimate_facts(one) for one in refinement.estimates],
        "sharpness": refinement.sharpness.mean(axis=0).tolist(),
        "windows": len(refinement.windows),
        "notes": list(calibrated.notes),
    }


def _moving(update: Callable[[float, str], None]) -> Callable[[str, int, int], None]:
    """One bar for all stages, which are not known beforehand: each takes half of what is left."""
    seen: dict[str, float] = {}

    def show(stage: str, done: int, total: int) -> None:
        begin = seen.setdefault(stage, 1 - 0.6 ** len(seen))
        share = min(1.0, done / max(total, 1))
        update(begin + 0.4 * (1 - begin) * share, f"{stage} {done}/{total}")

    return show


def _summary(refinement: Refinement) -> str:
    refused = sum(bool(one.refused) for one in refinement.estimates)
    return f"{len(refinement.estimates) - refused} refined, {refused} refused"


def _sides(
    recording: Recording, refinement: Refinement, update: Callable[[float, str], None]
) -> list[Side]:
    """The window with the largest gain, mapped with both calibrations."""
    gain = refinement.sharpness[:, 1] / refinement.sharpness[:, 0]
    t0_us, t1_us = refinement.windows[int(gain.argmax())]
    window = Window(t0_us, t1_us, (t0_us + t1_us) // 2, (0,) * len(recording.rig))
    method = "Alg1/H" if len(recording.rig) > 1 else "EMVS/cam0"
    config = MapperConfig(
        methods=(method,),
        min_depth_m=refinement.config.min_depth_m,
        max_depth_m=refinement.config.max_depth_m,
        threads=refinement.config.threads,
    )
    sides = []
    pair = (("as given", recording), ("refined", refinement.applied(recording)))
    for done, (name, told) in enumerate(pair):
        update(float(done), name)
        mapped = map_window(told, config, window=window)
        sides.append(Side(name, mapped, _residuals(told, config, refinement)))
    return sides


def _residuals(
    recording: Recording, config: MapperConfig, refinement: Refinement
) -> np.ndarray[Any, np.dtype[np.float64]]:
    if len(recording.rig) < 2:
        return np.empty(0)
    near_m, _ = depth_range_m(recording, config)
    times_us = [(t0_us + t1_us) // 2 for t0_us, t1_us in refinement.windows]
    try:
        Rectified.of(recording.rig)
    except InputError:  # cameras that no common view shows: the page goes without
        return np.empty(0)
    return np.concatenate([epipolar_residuals_px(recording, t_us, near_m) for t_us in times_us])


def page_text(
    recording: Recording, refinement: Refinement, sides: Sequence[Side], notes: Sequence[str],
    command: str, folder: Path,
) -> str:  # fmt: skip
    """The page as HTML; nothing is loaded from elsewhere."""
    scale = depth_scale(_depth_range_m(sides[0]))
    libraries = versions()
    files = [file.name for file in sorted(folder.iterdir()) if file.suffix != ".html"]
    return environment().get_template("calibrate.html.j2").render(
        title=f"calibration of {recording.name}", sentences=sentences(refinement, sides),
        estimates=estimates_grid(refinement.estimates), notes=notes, scale=scale,
        sides=[_shown(side, scale) for side in sides],
        curves=Markup(_curves_svg(refinement)) if refinement.curves else "",
        residuals=Markup(_residuals_svg(sides)) if len(sides[0].residuals_px) else "",
        windows=windows_grid(refinement),
        provenance=Grid((Head("command", text=True),), ((GridCell(command or "Python"),),)),
        versions=versions_grid(["this page"], [libraries]), version=libraries["eventsweep"],
        files=files_in(folder, files),
        css=inline("report.css"), tables_css=inline("tables.css"),
        calibrate_css=inline("calibrate.css"), js=inline("report.js"),
    )  # fmt: skip


def _depth_range_m(side: Side) -> tuple[float, float]:
    rho = side.mapped.view.rho
    return 1 / float(rho.max()), 1 / float(rho.min())


def sentences(refinement: Refinement, sides: Sequence[Side]) -> list[str]:
    """What the page says first."""
    before, after = refinement.sharpness.mean(axis=0)
    gain = 100 * (after / before - 1)
    windows = plural(len(refinement.windows), "window")
    sharper = f"{gain:.1f} % sharper" if gain >= 0.05 else "as sharp as before"
    lines = [f"{_summary(refinement)}; the DSI of {windows} is {sharper}."]
    refined = [one for one in refinement.estimates if not one.refused]
    if refined and all(abs(one.value) <= one.uncertainty for one in refined):
        lines.append("No correction is larger than its uncertainty: nothing was found wrong.")
    if all(len(side.residuals_px) for side in sides):
        values = [float(np.median(np.abs(side.residuals_px))) for side in sides]
        lines.append(
            f"Matched patches lie {values[0]:.2f} rows off their epipolar lines in the median "
            f"with the calibration as given, {values[1]:.2f} with the refined one."
        )
    return lines


def estimates_grid(estimates: Sequence[Estimate]) -> Grid:
    """A line per parameter: correction, uncertainty, verdict."""
    heads = (
        Head("parameter", text=True), Head("correction"), Head("95 % ±"), Head("unit", text=True),
        Head("result", text=True),
    )  # fmt: skip
    return Grid(heads, tuple(_line(one) for one in estimates))


def _line(one: Estimate) -> tuple[GridCell, ...]:
    known = math.isfinite(one.uncertainty)
    return (
        GridCell(one.parameter.name),
        GridCell("as given" if one.refused else f"{one.value:+.3f}", one.value),
        GridCell(f"{one.uncertainty:.3f}" if known else "unknown", one.uncertainty),
        GridCell(one.parameter.unit),
        GridCell(f"refused: {one.refused}" if one.refused else "refined",
                 kind="worse" if one.refused else "better"),
    )  # fmt: skip


def windows_grid(refinement: Refinement) -> Grid:
    """A line per window: its time and its sharpness before and after."""
    heads = (
        Head("window", "s"),
        Head("as given", "votes"),
        Head("refined", "votes"),
        Head("gain", "%"),
    )
    lines = []
    for (t0_us, t1_us), (before, after) in zip(
        refinement.windows, refinement.sharpness, strict=True
    ):
        gain = 100 * (after / before - 1)
        times = f"{t0_us / 1e6:.3f} to {t1_us / 1e6:.3f}"
        cells = (GridCell(times, t0_us), GridCell(f"{before:.2f}", before),
                 GridCell(f"{after:.2f}", after), GridCell(f"{gain:+.1f}", gain))  # fmt: skip
        lines.append(cells)
    return Grid(heads, tuple(lines))


def _shown(side: Side, scale: Any) -> dict[str, Any]:
    depth = side.mapped.depth_maps[side.method]
    row = side.mapped.slices.row_px
    cut = DsiSlice(
        row, side.mapped.slices.rho, side.mapped.slices.values[side.method],
        depth.depth_m[row], depth.mask[row],
    )  # fmt: skip
    point_px = point_size_px(depth.depth_m.shape[1])
    return {
        "name": side.name,
        "points": f"{int(depth.mask.sum()):,} points, {side.method}",
        "depth": depth_image(depth.depth_m, depth.mask, scale, point_px).data_uri(),
        "slice": Markup(slice_svg(cut)),
    }


def _curves_svg(refinement: Refinement) -> str:
    """Sharpness over each refined parameter: the top is the result, 0 is what was given."""
    with mpl.rc_context(STYLE):
        names = list(refinement.curves)
        columns = min(4, len(names))
        rows = -(-len(names) // columns)
        figure = Figure(figsize=(10.5, 0.4 + 2.1 * rows), layout="constrained")
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        by_name = {one.parameter.name: one for one in refinement.estimates}
        for axes, name in zip(panels, names, strict=False):
            _draw_curve(axes, by_name[name], *refinement.curves[name])
        for axes in panels[len(names) :]:
            axes.set_axis_off()
        return svg_of(figure)


def _draw_curve(axes: Any, one: Estimate, at: Any, relative: Any) -> None:
    axes.plot(at, 100 * relative, lw=1.4, color=TRUTH_COLOUR, marker="o", ms=2.5)
    axes.axvline(0, color="#888888", lw=0.8, ls=":")
    low, high = one.value - one.uncertainty, one.value + one.uncertainty
    axes.axvspan(low, high, color=ESTIMATE_COLOUR, alpha=0.2, lw=0)
    axes.axvline(one.value, color=ESTIMATE_COLOUR, lw=1)
    axes.set_title(one.parameter.name, fontsize=9, loc="left")
    axes.set_xlabel(f"correction [{one.parameter.unit}]")
    axes.set_ylabel("sharpness [%]")
    axes.grid(linewidth=0.4, alpha=0.35)


def _residuals_svg(sides: Sequence[Side]) -> str:
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(10.5, 2.4), layout="constrained")
        axes = figure.subplots()
        bins = np.linspace(-_ROWS_PX, _ROWS_PX, 51).tolist()
        for side, colour in zip(sides, ("#888888", ESTIMATE_COLOUR), strict=True):
            share = 100 * np.ones(len(side.residuals_px)) / max(1, len(side.residuals_px))
            axes.hist(side.residuals_px, bins, weights=share, histtype="stepfilled", alpha=0.55,
                      color=colour, label=side.name)  # fmt: skip
        axes.set_xlabel("rows between a patch of camera 0 and its match in camera 1 [px]")
        axes.set_ylabel("share of patches [%]")
        axes.grid(linewidth=0.4, alpha=0.35)
        figure.legend(loc="outside upper right", ncols=2)
        return svg_of(figure)
