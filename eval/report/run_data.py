"""What the report shows, as plain arrays, and how it is read from a folder on disk."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.data.image_stores import Photo
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.dsi.slices import Slices
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES, inside, read_text
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.figures.colormaps import Scale
from eventsweep.eval.figures.images import (
    IndexedImage,
    depth_image,
    error_image,
    error_of,
    events_image,
    frame_image,
    point_size_px,
)
from eventsweep.eval.figures.plots import DsiSlice
from eventsweep.eval.numbers import shown_zero_us, thousands
from eventsweep.eval.report.ranking import ranked_methods
from eventsweep.eval.results.results import JSON_NAME, Results, read_results
from eventsweep.eval.results.table import POOLED, tidy
from eventsweep.eval.scoring.pairing import REFERENCE, Truth, bad_pixels
from eventsweep.eval.scoring.regions import region_masks
from eventsweep.eval.scoring.run_folder import (
    CONFIG_FILE,
    Scored,
    existing_recording,
    find_maps,
    has_truth,
    other_maps,
    truth_of,
)
from eventsweep.eval.scoring.score import outlier_classifier

_MOST_FILMED = 24
_MOST_PIXELS_SHOWN = 1_000_000
_EVENTS_PER_PIXEL = 0.25
FloatImage = NDArray[np.floating]
CountImage = NDArray[np.integer]


@dataclass(frozen=True, slots=True)
class RunData:
    """Everything in a report; the results have no rows where nothing was scored."""

    cases: tuple[CaseData, ...]
    results: Results
    ranking_metric: str = "mean_error"
    configuration: str = ""

    def rows_of(self, case: str, window: str) -> pd.DataFrame:
        """The rows of one case and window."""
        return _rows_of(self.results, case, window)


@dataclass(frozen=True, slots=True)
class CaseData:
    """One case: a sequence or recording, mapped.

    Attributes:
        summary: what it shows, in a sentence.
        windows: those that the report shows, of `window_count`.
        facts: (name, value) pairs: rig, duration, renderer, and the like.
        film: what one method found in many windows, in order of time.
        clock_us: the recording's time that pages show as 0, µs.
    """

    name: str
    summary: str
    windows: tuple[WindowData, ...]
    window_count: int
    facts: tuple[tuple[str, str], ...] = ()
    film: tuple[WindowData, ...] = ()
    clock_us: int = 0


def _two_digits(value: float, towards: int) -> float:
    """The next number of two significant digits, below (-1) or above (1)."""
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    rounded = math.floor if towards < 0 else math.ceil
    return float(f"{rounded(value / step - towards * 1e-9) * step:.2g}")


@dataclass(frozen=True, slots=True)
class WindowData:
    """One window: what the cameras saw, and every method's map; None for what there is not.

    Attributes:
        name: as in the result rows, for example `w000`.
        t_us: time of the reference view, µs.
        depth_range_m: nearest and farthest plane, m.
        frame: (H, W) linear intensity, 0..255.
        photo: what an ordinary camera in the same place took.
        camera: the reference view's.
        brighter: (H, W) events of positive polarity per pixel.
        darker: (H, W) events of negative polarity per pixel.
        events_caption: which stretch of time the counts cover.
        counts: per stage or camera, event statistics: numbers of events by outcome.
    """

    name: str
    t_us: int
    methods: tuple[MethodData, ...]
    depth_range_m: tuple[float, float]
    frame: NDArray[np.uint8] | None = None
    brighter: CountImage | None = None
    darker: CountImage | None = None
    truth: Truth | None = None
    events_caption: str = "per pixel, whole window"
    counts: Mapping[str, Mapping[str, int]] = field(default_factory=dict)
    photo: Photo | None = None
    camera: Camera | None = None

    @property
    def shown_range_m(self) -> tuple[float, float]:
        """Nearest and farthest depth that colours tell apart, m.

        Planes may reach far beyond the scene, and a scene with all of them is one colour. So these
        are the depths that occur, of the truth or else of all points, but for half a per cent at
        each end, rounded outwards to two digits; never beyond the planes.
        """
        if self.truth is not None and self.truth.scored.any():
            depths_m = self.truth.depth_m[self.truth.scored]
        else:
            depths_m = np.concatenate([np.ravel(one.depth_m[one.mask]) for one in self.methods])
        near_m, far_m = self.depth_range_m
        if not depths_m.size:
            return near_m, far_m
        low_m, high_m = np.quantile(depths_m, [0.005, 0.995])
        low_m, high_m = max(near_m, _two_digits(low_m, -1)), min(far_m, _two_digits(high_m, 1))
        return (low_m, high_m) if low_m < high_m else (near_m, far_m)

    def images(self, depth: Scale, events: Scale) -> dict[str, IndexedImage]:
        """Frame, events and true depth, as far as they are known."""
        images = {}
        if self.frame is not None:
            images["Frame"] = frame_image(self.frame)
        if self.brighter is not None and self.darker is not None:
            images["Events"] = events_image(self.brighter, self.darker, events)
        if self.truth is not None:
            images["True depth"] = depth_image(self.truth.depth_m, self.truth.scored, depth)
        return images


@dataclass(frozen=True, slots=True)
class MethodData:
    """One method's map of one window.

    Attributes:
        depth_m: (H, W) z-depth, m.
        mask: (H, W) where there is one.
        confidence: (H, W) fused ray density at the maximum, or what the method says of itself; NaN
            where it says nothing.
        dsi_slice: one row of the DSI; None where it was not kept.
        error_m: (H, W) half-width of the band that should hold 68 % of the errors, m; None where
            the method is not calibrated.
        causes: (H, W) 1 + position in `CAUSES` of why a pixel is bad, 0 where it is not; None where
            that is not known.
    """

    name: str
    depth_m: FloatImage
    mask: NDArray[np.bool_]
    confidence: FloatImage
    dsi_slice: DsiSlice | None = None
    error_m: FloatImage | None = None
    causes: NDArray[np.uint8] | None = None

    @property
    def is_sure(self) -> bool:
        """Whether the method says anywhere how sure it is."""
        return bool(np.isfinite(self.confidence).any())

    @property
    def point_px(self) -> int:
        """How wide pictures draw its points."""
        return point_size_px(self.depth_m.shape[1])

    def depth_image(self, scale: Scale) -> IndexedImage:
        """Its depth."""
        return depth_image(self.depth_m, self.mask, scale, self.point_px)

    def error_image(self, truth: Truth, scale: Scale) -> IndexedImage:
        """Its errors."""
        pair = (self.depth_m, self.mask, truth.depth_m, truth.scored)
        return error_image(*pair, scale, self.point_px)

    def errors_cm(self, truth: Truth) -> NDArray[np.floating]:
        """(N,) |e - g| where both are valid, cm."""
        error_cm, both = error_of(self.depth_m, self.mask, truth.depth_m, truth.scored)
        return error_cm[both]


def load_run(run_dir: Path, *, for_page: bool = False) -> RunData:
    """Reads what a report shows of a run (`RUN/<case>/map`) or of a single map folder.

    Args:
        run_dir: the folder.
        for_page: whether to read what only the page shows, too: causes and films.
    """
    maps = find_maps(run_dir)
    results = _results(run_dir, maps)
    config = EvalConfig.model_validate(results.configuration.get("score", {}))
    return RunData(
        cases=tuple(
            _case(run_dir, name, stored, config, results, for_page=for_page)
            for name, stored in maps.items()
        ),
        results=results,
        ranking_metric=config.ranking_metric,
        configuration=_configuration_text(run_dir, results),
    )


def _results(run_dir: Path, maps: dict[str, StoredMap]) -> Results:
    if (run_dir / JSON_NAME).is_file():
        return read_results(run_dir)
    info = next(iter(maps.values())).info
    return Results(tidy(()), {"map": info.config.model_dump(mode="json")}, versions=info.versions)


def _configuration_text(run_dir: Path, results: Results) -> str:
    file = inside(run_dir, CONFIG_FILE)
    if file.is_file():
        return read_text(file, SETTINGS_BYTES)
    return json.dumps(results.configuration, indent=2, ensure_ascii=False)


def _case(
    run_dir: Path, name: str, stored: StoredMap, config: EvalConfig, results: Results, *,
    for_page: bool,
) -> CaseData:  # fmt: skip
    recording = existing_recording(stored)
    # Ground truth is camera 0's: it says nothing about a map from a view of its own.
    scorable = stored.info.config.is_camera_0_view
    scored = set(results.rows["method"])

    def read(window: StoredWindow, methods: Sequence[str], *, causes: bool) -> WindowData:
        every = [window.depth_map(method) for method in window.info.methods]
        every += [m for m in other_maps(run_dir, name, window) if m.method in scored]
        maps = [one for one in every if one.method in methods] if methods else every
        return window_data(window, maps, recording, config, scorable=scorable, causes=causes)

    windows = [read(one, (), causes=for_page) for one in _shown(stored.windows)]
    film = []
    if for_page and stored.windows:
        names = [method.name for window in windows for method in window.methods]
        best = best_first(_rows_of(results, name, POOLED), config.ranking_metric, names)[0]
        film = [read(one, (best,), causes=False) for one in _evenly(stored.windows, _MOST_FILMED)]
    known = recording is not None and recording.name in scenes.names()
    return CaseData(
        name=name,
        summary=scenes.load(recording.name).summary if recording and known else "",
        windows=tuple(windows),
        window_count=len(stored.windows),
        facts=tuple(_facts(stored, recording)),
        film=tuple(film),
        clock_us=shown_zero_us(min((one.info.t0_us for one in stored.windows), default=0)),
    )


def _rows_of(results: Results, case: str, window: str) -> pd.DataFrame:
    rows = results.rows
    return rows[(rows["case"] == case) & (rows["window"] == window)]


def best_first(rows: pd.DataFrame, metric: str, names: Iterable[str]) -> list[str]:
    """Ranked ones in order of their rank, then the harmonic mean, as in Algorithm 1, then others.

    The rows are of one case and window; the first is what a page shows first.
    """
    names = list(names)
    wished = dict.fromkeys([*ranked_methods(rows, metric), REFERENCE, *names])
    return [name for name in wished if name in names]


def _shown(windows: tuple[StoredWindow, ...]) -> tuple[StoredWindow, ...]:
    """Windows evenly over time, as many as a page can hold."""
    pixels = windows[0].event_image[0].size if windows else 1
    return _evenly(windows, max(1, min(3, _MOST_PIXELS_SHOWN // pixels)))


def _evenly(windows: tuple[StoredWindow, ...], most: int) -> tuple[StoredWindow, ...]:
    chosen = np.unique(np.linspace(0, len(windows) - 1, min(most, len(windows))).astype(int))
    return tuple(windows[k] for k in chosen)


def window_data(
    window: StoredWindow, maps: Sequence[DepthMap], recording: Recording | None, config: EvalConfig,
    *, scorable: bool, causes: bool = False,
) -> WindowData:  # fmt: skip
    """Reads what pages and pictures show of a window; only a view of camera 0's is `scorable`.

    The maps are of the same view; the recording is None where it is gone. With `causes`, bad pixels
    get theirs.
    """
    t_us, truth = window.info.t_ref_us, None
    if scorable and isinstance(recording, Scored) and has_truth(recording, t_us, config):
        truth = truth_of(recording, t_us, config)
    (darker, brighter), events_caption = _events(window, recording)
    photo = None
    if isinstance(recording, EventSequence) and len(recording.photo_times_us(0)):
        photo = recording.photo(0, t_us)
    rho = maps[0].rho
    causes_of = _causes(window, maps, recording, truth, config) if causes and truth else {}
    return WindowData(
        name=window.info.name,
        t_us=t_us,
        methods=tuple(
            _method(depth_map, window.slices, truth, causes_of.get(depth_map.method))
            for depth_map in maps
        ),
        depth_range_m=(float(1 / rho.max()), float(1 / rho.min())),
        frame=None if recording is None else recording.frame(0, t_us),
        brighter=brighter,
        darker=darker,
        truth=truth,
        events_caption=events_caption,
        counts={
            camera: {outcome.replace("_", " "): count for outcome, count in counts.items()}
            for camera, counts in window.info.counts.items()
        },
        photo=photo,
        camera=maps[0].camera,
    )


def _events(window: StoredWindow, recording: Recording | None) -> tuple[NDArray[np.uint32], str]:
    """(2, H, W) events of camera 0, darker and brighter, so few that edges are still thin."""
    counts, info = window.event_image, window.info
    span_us = info.t1_us - info.t0_us
    share = _EVENTS_PER_PIXEL * counts[0].size / max(1, int(counts.sum()))
    if recording is None or share >= 1:
        return counts, "camera 0, whole window"
    half_us = max(1, round(span_us * share / 2))
    events = recording.events(0, info.t_ref_us - half_us, info.t_ref_us + half_us)
    few = np.zeros_like(counts)
    np.add.at(few, (events.p, events.y, events.x), 1)
    return few, f"camera 0, {2 * half_us / 1000:.1f} ms"


def _causes(
    window: StoredWindow, maps: Sequence[DepthMap], recording: Recording | None, truth: Truth,
    config: EvalConfig,
) -> dict[str, NDArray[np.uint8]]:  # fmt: skip
    """Per method, why pixels are bad; a data set's truth does not tell."""
    if not isinstance(recording, EventSequence):
        return {}
    info = window.info
    regions = region_masks(recording, info.t_ref_us, truth.depth_m, config)
    known = replace(truth, regions=regions)
    classifier = outlier_classifier(recording, info, maps[0], known, config)
    found = {}
    for one in maps:
        bad = bad_pixels((one.depth_m, one.mask), known)
        image = np.zeros(bad.shape, np.uint8)
        image[bad] = 1 + classifier.causes(one.depth_m, bad)
        found[one.method] = image
    return found


def _method(
    depth_map: DepthMap, slices: Slices, truth: Truth | None, causes: NDArray[np.uint8] | None
) -> MethodData:
    return MethodData(
        depth_map.method, depth_map.depth_m, depth_map.mask, depth_map.confidence,
        slice_of(depth_map, slices, truth), depth_map.error_m, causes,
    )  # fmt: skip


def slice_of(depth_map: DepthMap, slices: Slices, truth: Truth | None = None) -> DsiSlice | None:
    """The kept row of a method's DSI, and what was read from it; None where none was kept."""
    row_px = slices.row_px
    votes = slices.values.get(depth_map.method)
    if votes is None or not len(votes):  # a method without a volume
        return None
    dsi_slice = DsiSlice(
        row_px, slices.rho, votes, depth_map.depth_m[row_px], depth_map.mask[row_px]
    )
    if truth is not None:
        truth_m = np.where(truth.scored[row_px], truth.depth_m[row_px], np.nan)
        dsi_slice = replace(dsi_slice, truth_m=truth_m)
    return dsi_slice


def _facts(stored: StoredMap, recording: Recording | None) -> list[tuple[str, str]]:
    window, config = stored.windows[0], stored.info.config
    camera = window.depth_map(window.info.methods[0]).camera
    rig = f"{camera.width_px} × {camera.height_px} px, focal length {camera.fx_px:.1f} px"
    facts = [("rig", rig)]
    if recording is None:
        facts.append(("recording", f"{stored.info.recording.path}, no longer there"))
    if recording is not None:
        cameras = len(recording.rig)
        apart = f", {100 * recording.rig.baseline_m(0, 1):.2f} cm apart" if cameras > 1 else ""
        named = f"{recording.rig.name}: {cameras} camera{'s' * (cameras > 1)}{apart}, {rig}"
        facts = [("rig", named)]
    if isinstance(recording, EventSequence):
        facts.append(("renderer", recording.manifest.renderer))
        counts = zip(recording.rig.camera_names, recording.manifest.event_counts, strict=True)
        facts.append(("events", ", ".join(f"{thousands(n)} {camera}" for camera, n in counts)))
    infos = [window.info for window in stored.windows]
    spans = _range_s([info.t1_us - info.t0_us for info in infos])
    references = _range_s([info.t_ref_us - info.t0_us for info in infos])
    when = f"{spans}, reference view {references} after its start"
    return [*facts, ("window", when), ("planes", str(config.planes))]


def _range_s(times_us: list[int]) -> str:
    least, most = (f"{time / 1e6:.3f}" for time in (min(times_us), max(times_us)))
    return f"{least} s" if least == most else f"{least} to {most} s"
