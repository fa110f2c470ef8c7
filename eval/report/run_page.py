"""The report of a run: one page that holds everything and opens without a network."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep.emvs.dsi.method import OWN_UNIT, VOTES
from eventsweep.emvs.methods import named
from eventsweep.emvs.utils.outputs import check_files, files_together
from eventsweep.eval.figures.colormaps import (
    Scale,
    confidence_scale,
    depth_scale,
    error_scale,
    events_scale,
    line_style,
)
from eventsweep.eval.figures.images import (
    IndexedImage,
    behind_image,
    categories_image,
    confidence_image,
    depth_image,
    enlargement,
    error_cap_cm,
    error_image,
    error_of,
    events_image,
    every_nth,
    expected_error_image,
    frame_image,
    photo_image,
    point_size_px,
)
from eventsweep.eval.figures.plots import (
    CAUSE_COLOURS,
    SharesByName,
    SliceFigures,
    causes_figure,
    curves_figure,
    outlier_causes,
    svg,
)
from eventsweep.eval.numbers import displayed, thousands
from eventsweep.eval.report.html import REPORT_NAME, files_in, inline, plural, render
from eventsweep.eval.report.overview import overview_png
from eventsweep.eval.report.ranking import (
    best_words,
    column,
    findings,
    mean_over_cases,
    ranked_methods,
    table,
    with_unit,
)
from eventsweep.eval.report.run_data import (
    CaseData,
    MethodData,
    RunData,
    WindowData,
    best_method,
    load_run,
)
from eventsweep.eval.report.viewer import window_json
from eventsweep.eval.results.table import POOLED, RIG, each
from eventsweep.eval.scoring.curves import THRESHOLDS_CM
from eventsweep.eval.scoring.metrics import NAN
from eventsweep.eval.scoring.outlier_causes import CAUSES
from eventsweep.eval.scoring.pairing import Truth
from eventsweep.eval.scoring.run_folder import TRACK_FOLDER

_CAPTION = ("points", "completeness", "mean_error", "median_error", "bad_published")
OVERVIEW_NAME = "overview.png"
_SMALL_PX = 480
_BUSY_PERCENT = 99.7
"""Of the pixels this share lies within a scale of confidence."""


def case_context(
    data: RunData, case: CaseData, position: int, *, with_table: bool
) -> dict[str, Any]:
    """What the template shows of one case."""
    rows, metric = data.rows_of(case.name, POOLED), data.ranking_metric
    drawn = dict.fromkeys(m.name for window in case.windows for m in window.methods)
    first = [name for name in ranked_methods(rows, metric) if name in drawn]
    methods = list(dict.fromkeys([*first, *drawn]))
    identity, chosen = f"case{position}", chosen_method(rows, metric, methods)
    measured = rows.loc[rows["method"] != RIG, "metric"].unique()
    every = [name for name in measured if not name.startswith(("precision", "recall", "f1"))]
    scored = with_predictions(methods, rows)
    return {
        "id": identity,
        "name": case.name,
        "summary": case.summary[:1].upper() + case.summary[1:].removesuffix("."),
        "facts": case.facts,
        "table": table(rows, metric) if len(rows) and with_table else None,
        "findings": findings(rows, metric),
        "methods": methods,
        "chosen": chosen,
        "film": film_context(case, methods[chosen]),
        "windows": [
            window_context(w, methods, data.rows_of(case.name, w.name), case.clock_us)
            for w in case.windows
        ],
        "window_count": case.window_count,
        "curves_svg": _drawn(curves_figure, curves_of(rows, scored), identity),
        "causes_svg": _drawn(causes_figure, outlier_causes(rows, scored)),
        "every": table(rows, metric, every) if len(rows) else None,
    }


def film_context(case: CaseData, method: str) -> list[dict[str, Any]]:
    """What the template shows first: the best method's depth, in small pictures.

    Of a case without a film, that is one of its windows.
    """
    film = (
        case.film
        or [
            replace(window, methods=(found,))
            for window in case.windows
            for found in window.methods
            if found.name == method
        ][:1]
    )
    if not film:
        return []
    scale = depth_scale(film[0].depth_range_m)
    return [
        {
            "name": f"{window.name}, {seconds(window.t_us - case.clock_us)}",
            "method": window.methods[0].name,
            "depth": small_uri(
                depth_image(
                    window.methods[0].depth_m, window.methods[0].mask, scale,
                    point_size_px(window.methods[0].depth_m.shape[1]),
                )
            ),
            "frame": None if window.frame is None else small_uri(frame_image(window.frame)),
            "events": (
                None
                if window.brighter is None or window.darker is None
                else small_uri(
                    events_image(window.brighter, window.darker, events_scale(_events_cap(window)))
                )
            ),
            "scale": scale,
        }
        for window in film
    ]  # fmt: skip


def seconds(t_us: int) -> str:
    """A time since the recording's begin, as a page shows it."""
    return f"{t_us / 1e6:.3f} s"


def small_uri(image: IndexedImage) -> str:
    """A picture of at most some 500 columns: every n-th row and column of a larger one."""
    return every_nth(image, -(-image.index.shape[1] // _SMALL_PX)).data_uri()


def window_context(
    window: WindowData, methods: Sequence[str], rows: pd.DataFrame, clock_us: int = 0
) -> dict[str, Any]:
    """What the template shows of one window."""
    scales, sure, draw_slice = _scales(window), _confidence_scales(window), SliceFigures()
    names = dict.fromkeys(name for counts in window.counts.values() for name in counts)
    return {
        "name": window.name,
        "time": seconds(window.t_us - clock_us),
        "frame": frame_uri(window),
        "behind": behind_uri(window),
        **_photo_context(window),
        "events": events_uri(window, scales["events_scale"]),
        "events_caption": window.events_caption,
        "truth": truth_uri(window, scales["depth_scale"]),
        "methods": [
            _method_context(m, methods.index(m.name), window, scales, sure[m.name], rows)
            | {"slice_svg": _drawn(draw_slice, m.dsi_slice)}
            for m in window.methods
        ],
        "confidence_title": _confidence_title(window),
        "has_causes": any(m.causes is not None for m in window.methods),
        "is_calibrated": any(m.error_m is not None for m in window.methods),
        "has_slices": any(m.dsi_slice is not None for m in window.methods),
        "counts": window.counts,
        "count_names": list(names),
        "data": window_json(window, methods, scales["error_scale"], scales["depth_scale"]),
        "has_cloud": window.camera is not None,
        **scales,
    }


def _method_context(
    method: MethodData, position: int, window: WindowData, scales: dict[str, Scale], sure: Scale,
    rows: pd.DataFrame,
) -> dict[str, Any]:  # fmt: skip
    point_px = point_size_px(method.depth_m.shape[1])
    depth = depth_image(method.depth_m, method.mask, scales["depth_scale"], point_px)
    own = {row.metric: row for row in each(rows[rows["method"] == method.name])}
    numbers = [f"{column(name).title} {with_unit(own[name])}" for name in _CAPTION if name in own]
    return {
        "name": method.name,
        "position": position,
        "caption": " · ".join(numbers) or f"points {displayed(float(method.mask.sum()), 'px')} px",
        "depth": image_uri(depth),
        "confidence": (
            image_uri(confidence_image(method.confidence, sure)) if method.is_sure else None
        ),
        "confidence_scale": sure,
        "confidence_unit": confidence_unit(method.name),
        "error": error_uri(method, window.truth, scales["error_scale"]),
        "expected": _expected_uri(method, scales["error_scale"], point_px),
        "cause": _cause_uri(method, point_px),
        "causes": _cause_shares(method),
        "within": _within_band(method, window),
    }


def _confidence_title(window: WindowData) -> str:
    """With its unit where all methods share it."""
    units = {confidence_unit(method.name) for method in window.methods if method.is_sure}
    return f"Confidence [{units.pop()}]" if len(units) == 1 else "Confidence"


def confidence_unit(method: str) -> str:
    """What a method says that its confidence is, or `own unit`."""
    known = named(method)
    return known.confidence if known is not None else OWN_UNIT


def _confidence_scales(window: WindowData) -> dict[str, Scale]:
    """Scale of confidence by method: one for all that count votes, one each for the others."""
    finite = {m.name: m.confidence[np.isfinite(m.confidence)] for m in window.methods}
    by_votes = [name for name in finite if confidence_unit(name) == VOTES]
    shared = _confidence_scale(max((_busy(finite[name]) for name in by_votes), default=1.0))
    # Others report few pixels; all the rest of their picture is 0.
    return {
        name: shared if name in by_votes else _confidence_scale(_busy(values[values > 0]))
        for name, values in finite.items()
    }


def _busy(values: NDArray[np.floating]) -> float:
    return float(np.percentile(values, _BUSY_PERCENT)) if values.size else 0.0


def _confidence_scale(busy: float) -> Scale:
    return confidence_scale(float(f"{busy:.2g}"))


def _scales(window: WindowData) -> dict[str, Scale]:
    return {
        "depth_scale": depth_scale(window.depth_range_m),
        "error_scale": error_scale(_error_cap(window)),
        "events_scale": events_scale(_events_cap(window)),
    }


def _error_cap(window: WindowData) -> float:
    if window.truth is not None:
        return middle_cap_cm(errors_cm(method, window.truth) for method in window.methods)
    expected = ((method.error_m, method.mask) for method in window.methods)
    return middle_cap_cm(100 * error_m[mask] for error_m, mask in expected if error_m is not None)


def errors_cm(method: MethodData, truth: Truth) -> NDArray[np.floating]:
    """(N,) |e - g| where both are valid, cm."""
    error_cm, both = error_of(method.depth_m, method.mask, truth.depth_m, truth.scored)
    return error_cm[both]


def middle_cap_cm(errors: Iterable[NDArray[np.floating]]) -> float:
    """Where colours of errors end: one bad map must not flatten the colours of all others."""
    caps = [error_cap_cm(of_map) for of_map in errors]
    return float(np.median(caps)) if caps else 1.0


def _events_cap(window: WindowData) -> int:
    if window.brighter is None or window.darker is None:
        return 1
    either = np.maximum(window.brighter, window.darker)
    return max(1, round(float(np.percentile(either[either > 0], 90)))) if either.any() else 1


def _photo_context(window: WindowData) -> dict[str, Any]:
    """An ordinary camera's picture as its display shows it, and what of it says nothing."""
    photo = window.photo
    if photo is None:
        return {"photo": None}
    exposure = f"{(photo.end_us - photo.start_us) / 1000:g} ms exposure"
    off_us = photo.t_us - window.t_us
    return {
        "photo": image_uri(photo_image(photo.image)),
        "photo_unit": exposure + (f", {off_us / 1000:+.0f} ms" if off_us else ""),
        "photo_note": f"{_share(photo.white)} of the pixels white, {_share(photo.black)} black",
    }


def _share(value: float) -> str:
    return "none" if value == 0 else f"{100 * value:.1f} %" if value >= 5e-4 else "< 0.1 %"


def frame_uri(window: WindowData) -> str | None:
    """The frame as an address that holds it, as all `_uri` here; None where there is none."""
    return None if window.frame is None else image_uri(frame_image(window.frame))


def behind_uri(window: WindowData) -> str | None:
    """The frame to look at faintly through errors."""
    return None if window.frame is None else image_uri(behind_image(window.frame))


def events_uri(window: WindowData, scale: Scale) -> str | None:
    """Events of both polarities."""
    if window.brighter is None or window.darker is None:
        return None
    return image_uri(events_image(window.brighter, window.darker, scale))


def truth_uri(window: WindowData, scale: Scale) -> str | None:
    """True depth."""
    if window.truth is None:
        return None
    return image_uri(depth_image(window.truth.depth_m, window.truth.scored, scale))


def error_uri(method: MethodData, truth: Truth | None, scale: Scale) -> str | None:
    """Errors of a depth map."""
    if truth is None:
        return None
    point_px = point_size_px(method.depth_m.shape[1])
    image = error_image(method.depth_m, method.mask, truth.depth_m, truth.scored, scale, point_px)
    return image_uri(image)


def _cause_uri(method: MethodData, point_px: int) -> str | None:
    if method.causes is None:
        return None
    return image_uri(categories_image(method.causes, list(CAUSE_COLOURS.values()), point_px))


def _cause_shares(method: MethodData) -> list[tuple[str, str, str]]:
    """Colour, name and share of the causes that occur, as a picture's legend."""
    if method.causes is None:
        return []
    counts = np.bincount(method.causes.ravel(), minlength=1 + len(CAUSES))[1:]
    named = zip(CAUSE_COLOURS.items(), counts.tolist(), strict=True)
    total = max(1, int(counts.sum()))
    return [
        (colour, cause.replace("_", " "), f"{100 * count / total:.0f} %")
        for (cause, colour), count in named
        if count
    ]


def _expected_uri(method: MethodData, scale: Scale, point_px: int) -> str | None:
    if method.error_m is None:
        return None
    return image_uri(expected_error_image(method.error_m, method.mask, scale, point_px))


def _within_band(method: MethodData, window: WindowData) -> str:
    """How many errors lie within the stated band, where truth can tell."""
    if method.error_m is None or window.truth is None:
        return ""
    truth = window.truth
    error_cm, both = error_of(method.depth_m, method.mask, truth.depth_m, truth.scored)
    if not both.any():
        return ""
    inside = np.mean(error_cm[both] <= 100 * method.error_m[both])
    return f"{100 * inside:.0f} % of the errors lie within."


def image_uri(image: IndexedImage) -> str:
    """A picture, so large that a browser shows pixels as even squares."""
    return image.enlarged(enlargement(image.index.shape[1])).data_uri()


def chosen_method(rows: pd.DataFrame, metric: str, methods: Sequence[str]) -> int:
    """Place of the method that is shown first."""
    return methods.index(best_method(rows, metric, methods))


def with_predictions(mapped: Sequence[str], rows: pd.DataFrame) -> list[str]:
    """The methods that there are depth maps of, and behind them others that were scored."""
    return list(dict.fromkeys([*mapped, *rows.loc[rows["metric"] == "points", "method"]]))


def _drawn(draw: Callable[..., Figure], content: Any, *more: str) -> Markup | None:
    return Markup(svg(draw, content, *more)) if content else None


def curves_of(rows: pd.DataFrame, methods: Sequence[str]) -> list[tuple[str, SharesByName]]:
    """The curves of all methods, from the rows of one case; none where nothing was scored."""
    values = {(row.method, row.metric): row.value for row in each(rows)}
    if not any((method, "points") in values for method in methods):
        return []
    return [
        (method, {
            name: np.array([values.get((method, f"{name}_{cm}cm"), NAN) for cm in THRESHOLDS_CM])
            for name in ("precision", "recall", "f1")
        })
        for method in methods
    ]  # fmt: skip


def write_report(run_dir: Path) -> Path:
    """Writes `report.html` and `overview.png` for a run or map and returns the page's path."""
    run_dir = Path(run_dir)
    check_files(run_dir, (REPORT_NAME, OVERVIEW_NAME), force=True)
    data = load_run(run_dir, for_page=True)
    page = page_text(data, _files(run_dir, data))
    first = data.cases[0]
    rows = data.rows_of(first.name, POOLED)
    title = first.name if len(data.cases) > 1 else ""
    overview = overview_png(first, title, ranked_methods(rows, data.ranking_metric))
    with files_together(run_dir, (REPORT_NAME, OVERVIEW_NAME)) as staged:
        (staged / REPORT_NAME).write_text(page, encoding="utf-8")
        (staged / OVERVIEW_NAME).write_bytes(overview)
    return run_dir / REPORT_NAME


def _files(run_dir: Path, data: RunData) -> tuple[str, ...]:
    maps = ["map.json", *(f"{case.name}/map/map.json" for case in data.cases)]
    tracks = [f"{case.name}/{TRACK_FOLDER}/{REPORT_NAME}" for case in data.cases]
    found = files_in(run_dir, ("results.json", "results.csv", "config.toml", *maps, *tracks))
    return (*found, OVERVIEW_NAME)


def page_text(data: RunData, files: Sequence[str] = ()) -> str:
    """The page as text; the same data give the same bytes."""
    pooled = data.results.rows[data.results.rows["window"] == POOLED]
    several = len(data.cases) > 1
    overall = mean_over_cases(pooled, "mean") if several else pooled
    cases = [case_context(data, case, k, with_table=several) for k, case in enumerate(data.cases)]
    content: dict[str, Any] = {
        "title": ", ".join(case.name for case in data.cases),
        "subtitle": _subtitle(data),
        "metric": data.ranking_metric,
        "metric_title": column(data.ranking_metric).title,
        "overall": table(overall, data.ranking_metric) if len(overall) else None,
        "findings": findings(overall, data.ranking_metric, len(data.cases)),
        "cases": cases,
        "most_methods": max((len(case["methods"]) for case in cases), default=0),
        "provenance": _provenance(data),
        "configuration": data.configuration,
        "version": data.results.versions.get("eventsweep", ""),
        "colour_of": lambda method: line_style(method).css,
        "count": lambda value: "–" if value is None else thousands(value),
        "best": best_words(overall, data.ranking_metric),
        "viewer_js": inline("viewer.js") + inline("player.js"),
        "files": files,
    }
    return render("report.html.j2", "viewer", "player", **content)


def _subtitle(data: RunData) -> str:
    windows = sum(case.window_count for case in data.cases)
    methods = {method.name for case in data.cases for w in case.windows for method in w.methods}
    parts = [plural(len(data.cases), "case"), plural(windows, "window")]
    return ", ".join([*parts, plural(len(methods), "method")]) + "."


def _provenance(data: RunData) -> list[tuple[str, str]]:
    results = data.results
    versions = (f"{name} {version}" for name, version in results.versions.items())
    facts = [("versions", ", ".join(versions)), ("platform", results.platform)]
    if results.seed is not None:
        facts.insert(0, ("seed", str(results.seed)))
    facts += [(f"sha256 of {name}", digest) for name, digest in results.sequences.items()]
    rows = each(results.rows[results.rows["metric"] == "baseline_focal"])
    units = {row.case: f"{row.value:.4g} {row.unit}" for row in rows}
    return facts + [(f"baseline × focal length of {case}", text) for case, text in units.items()]
