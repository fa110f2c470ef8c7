"""Parameters of the mapper, its extractions and the baselines; imports no numpy.

Defaults are the published values where there are any; the page `baselines` says which those are.
Those of ESVO come from Zhou, Gallego, Shen, TRO 2021, and from the configuration published with
their program; the page `baselines` lists both beside ours.
"""

from __future__ import annotations

import logging
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, FiniteFloat, model_validator

from eventsweep.emvs.parameters import ParameterGroup

DEFAULT_DEPTH_RANGE_M = (0.2, 5.0)
PLANES = 100
"""The paper's number of depth planes."""
Positive = Annotated[FiniteFloat, Field(gt=0)]
NotNegative = Annotated[FiniteFloat, Field(ge=0)]
FocusMeasure = Literal["variance", "mean-square", "gradient", "laplacian", "dog"]
Count = Annotated[int, Field(ge=1)]
Pixel = Annotated[FiniteFloat, Field(ge=-32768, le=65536)]
ViewPixels = Annotated[int, Field(ge=2, le=32768)]
Share = Annotated[float, Field(ge=0, le=1)]
_log = logging.getLogger(__name__)


class FuseConfig(ParameterGroup):
    """How the windows of a map are joined."""

    voxel_m: FiniteFloat = Field(
        default=0.01, gt=0, description="edge of a voxel, m; the cloud has one point per voxel"
    )
    min_windows: int = Field(
        default=1, ge=1, description="least number of windows with a point in a voxel"
    )
    mesh: bool = Field(
        default=False,
        description="also make a mesh, from depth whose gaps are filled: partly a guess",
    )
    mesh_truncation: FiniteFloat = Field(
        default=4.0, ge=1, description="truncation distance of the mesh, voxels"
    )
    mesh_part: int = Field(
        default=100, ge=1, description="least number of triangles of a connected part of the mesh"
    )


def _odd(size_px: int) -> int:
    if size_px % 2 == 0:
        raise ValueError("must be odd")
    return size_px


OddPixels = Annotated[int, Field(ge=1, le=99), AfterValidator(_odd)]
ThresholdPixels = Annotated[int, Field(ge=3, le=99), AfterValidator(_odd)]
MedianPixels = Annotated[int, Field(ge=1, le=5), AfterValidator(_odd)]


class SemiGlobal(ParameterGroup):
    """Semi-global matching of two images, OpenCV's."""

    block_px: OddPixels = Field(default=11, description="side of the matched blocks, odd, px")
    p1_per_px: Count = Field(
        default=8, description="penalty per block pixel of a disparity step of 1"
    )
    p2_per_px: Count = Field(default=32, description="penalty per block pixel of a larger step")
    uniqueness_percent: int = Field(
        default=11,
        ge=0,
        le=100,
        description="how much lower the best cost must be than the second best, %",
    )
    left_right_px: Count = Field(
        default=1, description="largest difference between the disparities seen from both sides, px"
    )


class SgmParameters(ParameterGroup):
    """Semi-global matching of time surfaces: `SGM/ts` and `SGM/window`."""

    decay_s: Positive = Field(default=0.03, description="time constant of the time surfaces, s")
    median_px: MedianPixels = Field(default=3, description="median over them, 1 (none), 3 or 5 px")
    active_s: Positive = Field(
        default=0.01, description="how recently a pixel must have fired to get a depth, s"
    )
    rate_hz: Positive = Field(default=20.0, description="how often SGM/window matches, Hz")
    matcher: SemiGlobal = SemiGlobal()


class PictureMatching(SemiGlobal):
    """The same of pictures, which have texture where time surfaces have edges: a smaller block."""

    block_px: OddPixels = Field(default=7, description="side of the matched blocks, odd, px")


class FrameParameters(ParameterGroup):
    """Semi-global matching of pictures: `Frames/sgm`."""

    matcher: PictureMatching = PictureMatching()


class Coincidence(ParameterGroup):
    """What makes two events a pair; a unit of energy is one of these widths, squared."""

    row_px: Positive = Field(
        default=0.5, description="width of the epipolar distance, px; at most twice it is allowed"
    )
    time_us: Positive = Field(
        default=300.0, description="width of the time difference, µs; at most twice it is allowed"
    )
    motion: Positive = Field(
        default=0.15, description="width of the difference of time slopes, relative to their length"
    )
    most_energy: Positive = Field(default=1.0, description="largest energy of a pair")


class GtsParameters(ParameterGroup):
    """Event coincidence: `GTS/events`. All ours: the published ones belong to another sensor."""

    radius_px: Count = Field(
        default=3, description="radius of the neighbourhood from which motion is estimated, px"
    )
    memory_s: Positive = Field(default=0.03, description="largest age of a neighbour, s")
    coincidence: Coincidence = Coincidence()


class Matching(ParameterGroup):
    """Block matching that starts each estimate."""

    width_px: OddPixels = Field(default=15, description="columns of a block, odd, px")
    height_px: OddPixels = Field(default=7, description="rows of a block, odd, px")
    coarse_px: Count = Field(
        default=1,
        description="step of the first search along the row, px; the second takes every pixel",
    )
    least_zncc: float = Field(
        default=0.8,
        ge=-1,
        le=1,
        description="zero-mean normalised cross-correlation that a match needs",
    )


class Refinement(ParameterGroup):
    """The non-linear least squares of one inverse depth; time surfaces count 0..255."""

    width_px: OddPixels = Field(default=15, description="columns of the compared patch, odd, px")
    height_px: OddPixels = Field(default=7, description="rows of the compared patch, odd, px")
    steps: int = Field(
        default=10, ge=0, description="most iterations; 0: keep the result of block matching"
    )
    dof: float = Field(
        default=2.182,
        gt=2,
        description="degrees of freedom of the residuals' Student t distribution",
    )
    scale: Positive = Field(default=17.277, description="its scale")


class CleanUp(ParameterGroup):
    """Which estimates count: the first two before they are fused, all of them afterwards."""

    most_deviation_px: Positive = Field(
        default=3.4,
        description="largest standard deviation of an estimate, as disparity, px; the published "
        "0.15 / m on the rig of MVSEC",
    )
    most_spread: Positive = Field(
        default=20.0, description="largest scale of a patch's residuals, refitted after refinement"
    )
    least_fusions: int = Field(
        default=1, ge=0, description="how many similar estimates a pixel's first one must have met"
    )


class Regularisation(ParameterGroup):
    """A mean over like neighbours; off, as in the published configuration."""

    radius_px: int = Field(
        default=0,
        ge=0,
        le=50,
        description="half a side of the neighbourhood, px; 0: none (5 in other ESVO settings)",
    )
    least_neighbours: int = Field(
        default=8,
        ge=0,
        description="similar neighbours that a pixel needs to be kept",
    )


class EsvoParameters(ParameterGroup):
    """ESVO's mapping: `ESVO/own-rate` and `ESVO/window`."""

    decay_s: Positive = Field(default=0.03, description="time constant of the time surfaces, s")
    median_px: MedianPixels = Field(default=3, description="median over them, 1 (none), 3 or 5 px")
    blur_sigma_px: NotNegative = Field(
        default=0.0, description="standard deviation of a Gaussian after it, px; 0: none"
    )
    recent_s: Positive = Field(
        default=0.01, description="oldest event that a map uses, s before its time"
    )
    most_events: Count = Field(default=1000, description="newest events that a map uses")
    rate_hz: Positive = Field(default=20.0, description="maps per second, Hz")
    most_points: Count = Field(
        default=4500,
        description="newest estimates, in whole maps, that ESVO/own-rate fuses",
    )
    matching: Matching = Matching()
    refinement: Refinement = Refinement()
    clean_up: CleanUp = CleanUp()
    regularisation: Regularisation = Regularisation()


class FocusParameters(ParameterGroup):
    """Depth by focus: the Focus methods, and what the Learned methods start from."""

    measure: FocusMeasure = Field(
        default="variance", description="what the Focus methods maximise along a viewing ray"
    )
    sigma_px: Positive = Field(
        default=2.5, le=50, description="scale of the focus measures, px of the reference view"
    )
    threshold_kernel_px: ThresholdPixels = Field(
        default=5, description="window of the Focus methods' adaptive threshold, px, odd"
    )
    threshold_c: FiniteFloat = Field(
        default=2.0, description="threshold_c of the Focus methods, applied before reliability"
    )
    reliability: float = Field(
        default=0.03, ge=0, le=1, description="least reliability of a point of the Focus methods"
    )


class LearnedParameters(ParameterGroup):
    """The network of the Learned methods."""

    error_px: Positive = Field(
        default=0.5,
        description="largest expected error of a point of the Learned methods, px of disparity at "
        "10 px of it",
    )
    weights: Path | None = Field(
        default=None, description="weights of the Learned methods; by default those that ship"
    )


class DerdParameters(ParameterGroup):
    """The published network DERD-Net."""

    threshold_kernel_px: ThresholdPixels = Field(
        default=5, description="window of DERD/H's adaptive threshold, px, odd"
    )
    threshold_c: FiniteFloat = Field(default=14.0, description="threshold_c of DERD/H")
    weights: Path | None = Field(
        default=None, description="weights of DERD/H; by default those that ship"
    )


# Names of these fields before they had groups, as suites and maps of earlier versions have them.
_FORMER_NAMES = {
    f"{group}_{name}": (group, name)
    for group, fields in (
        ("focus", FocusParameters), ("learned", LearnedParameters), ("derd", DerdParameters)
    )
    for name in fields.model_fields
}  # fmt: skip


class MapperConfig(ParameterGroup):
    """Parameters of Algorithms 1 and 2; every field has a default that works."""

    planes: int | None = Field(
        default=None, ge=2, le=100_000,
        description="number of depth planes; by default 100, or up to 400 where those lie over "
        "1 px of disparity apart",
    )  # fmt: skip
    spacing: Literal["inverse", "linear"] = Field(
        default="inverse", description="planes uniform in inverse depth, or in depth"
    )
    min_depth_m: Positive | None = Field(
        default=None,
        description="nearest depth plane, m; by default the recording's own, else seen",
    )
    max_depth_m: Positive | None = Field(
        default=None,
        description="farthest depth plane, m; by default the recording's own, else seen",
    )
    start_s: NotNegative | None = Field(
        default=None,
        description="window start, s after the first event; by default where poses begin",
    )
    duration_s: Positive | None = Field(
        default=None, description="window length, s; by default all events that the poses cover"
    )
    window_s: Positive | None = Field(
        default=None, description="map sliding windows of this length, s, over the whole recording"
    )
    stride_s: Positive | None = Field(
        default=None, description="time from one window's start to the next, s; by default window_s"
    )
    window_events: int | None = Field(
        default=None, ge=1, description="map sliding windows of this many events of camera 0"
    )
    stride_events: Count | None = Field(
        default=None,
        description="events from one window's start to the next; by default window_events",
    )
    min_events: int = Field(
        default=1, ge=1, description="fewest voting events of each camera in a window"
    )
    max_pose_gap_s: Positive | None = Field(
        default=None,
        description="longest gap between poses, s; by default 10 typical steps, >= 0.05",
    )
    hot_pixels: NotNegative = Field(
        default=0.0,
        description="drop pixels this many times as active as their surroundings; 0: none",
    )
    reference_s: NotNegative | None = Field(
        default=None,
        description="time of the reference view, s after the first event; by default the middle",
    )
    reference: Literal["middle", "end"] = Field(
        default="middle",
        description="time of the reference view in the window, without reference_s",
    )
    reference_shift: Share = Field(
        default=0.0,
        description="position of the reference view on the baseline: 0 at camera 0, 1 at camera 1",
    )
    view_width_px: ViewPixels | None = Field(
        default=None, description="columns of the reference view; by default camera 0's"
    )
    view_height_px: ViewPixels | None = Field(
        default=None, description="rows of the reference view; by default camera 0's"
    )
    view_focal_px: Positive | None = Field(
        default=None, description="focal length of the reference view, px; by default camera 0's"
    )
    view_focal_y_px: Positive | None = Field(
        default=None,
        description="focal length of its rows, px; by default in the ratio of camera 0's",
    )
    view_cx_px: Pixel | None = Field(
        default=None,
        description="column of its principal point, px; by default as far off centre as camera 0's",
    )
    view_cy_px: Pixel | None = Field(default=None, description="row of its principal point, px")
    polarity: Literal["both", "separate"] = Field(
        default="both", description="separate: fuse the polarities separately, then sum"
    )
    voting: Literal["bilinear", "nearest"] = Field(
        default="bilinear", description="bilinear: exact; nearest: the fast variant, coarser depth"
    )
    methods: tuple[str, ...] = Field(
        default=("all",),
        min_length=1,
        description="methods by name, such as Alg1/H or Alg2/AtHc@4; or all, baselines, everything",
    )
    extraction: Literal["votes", FocusMeasure] = Field(
        default="votes",
        description="score that depth maximises along a viewing ray: votes, or a focus measure",
    )
    min_precision: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="share of points that should lie within a pixel of disparity, by calibration; "
        "replaces each method's own threshold",
    )
    inpaint: bool = Field(
        default=False, description="also fill the gaps between points, marked as filled"
    )
    interpolate: bool = Field(
        default=True, description="refine the maximum between planes by a parabola"
    )
    threshold_kernel_px: ThresholdPixels = Field(
        default=5, description="window of the adaptive threshold, px, odd"
    )
    threshold_c: FiniteFloat = Field(
        default=7.0, description="how much a confidence (0 to 255) must exceed its neighbours' mean"
    )
    median_px: OddPixels = Field(
        default=5, description="window of the masked median, px, odd; 1: none"
    )
    border_px: int = Field(default=2, ge=0, description="border of the image without depth, px")
    max_confidence: NotNegative = Field(
        default=0.0,
        description="votes for full confidence, unless a pixel has more; 0: the maximum",
    )
    radius_m: Positive = Field(
        default=0.05, description="radius of the point cloud's outlier filter, m"
    )
    radius_neighbours: int = Field(
        default=3, ge=0, description="neighbours that a point needs within the radius; 0: no filter"
    )
    compatibility: Literal["none", "mcemvs"] = Field(
        default="none", description="mcemvs: the authors' planes, packets, H and no interpolation"
    )
    save_dsi: bool = Field(default=False, description="write every fused volume as .npy")
    threads: int = Field(default=0, ge=0, description="threads of the kernels; 0: all")
    device: str = Field(
        default="cpu",
        description="where the sweep runs: cpu, cuda or auto, an NVIDIA GPU where there is one",
    )
    slice_row: int | None = Field(
        default=None, ge=0, description="image row of the DSI slice, px; by default the middle row"
    )
    focus: FocusParameters = Field(default=FocusParameters(), description="of depth by focus")
    learned: LearnedParameters = Field(
        default=LearnedParameters(), description="of the Learned methods"
    )
    derd: DerdParameters = Field(default=DerdParameters(), description="of DERD-Net")
    sgm: SgmParameters = Field(default=SgmParameters(), description="of SGM on time surfaces")
    esvo: EsvoParameters = Field(default=EsvoParameters(), description="of ESVO mapping")
    gts: GtsParameters = Field(default=GtsParameters(), description="of event coincidence")
    frames: FrameParameters = Field(default=FrameParameters(), description="of SGBM on frames")

    @model_validator(mode="before")
    @classmethod
    def _former(cls, values: Any) -> Any:
        """Reads one method as a list, former names as today's, and the removed setting."""
        if not isinstance(values, dict):
            return values
        values = dict(values)
        if isinstance(values.get("methods"), str):
            values["methods"] = (values["methods"],)
        precision = values.get("voting_precision")
        if precision == "float":
            _log.warning("voting_precision float is ignored: GPUs sum votes as integers now")
        if precision in ("fixed", "float"):
            del values["voting_precision"]
        for old in [name for name in _FORMER_NAMES if name in values]:
            group, name = _FORMER_NAMES[old]
            known = values.get(group) or {}
            known = known.model_dump(exclude_unset=True) if hasattr(known, "model_dump") else known
            if name in known:
                raise ValueError(
                    f"{old} and {group}.{name} are the same setting: leave one of them out"
                )
            values[group] = {**known, name: values.pop(old)}
        return values

    @model_validator(mode="after")
    def _check(self) -> MapperConfig:
        if self.reference_s is not None and self.reference == "end":
            raise ValueError(
                "reference_s and reference end both set the reference time: leave one of them out"
            )
        self._check_sliding()
        needed = {"spacing": "inverse", "polarity": "both", "voting": "bilinear"}
        wrong = [name for name, value in needed.items() if getattr(self, name) != value]
        if self.is_mcemvs and wrong:
            stated = " and ".join(f"{name} {getattr(self, name)}" for name in wrong)
            cure = " and ".join(f"{name} {needed[name]}" for name in wrong)
            raise ValueError(f"compatibility mcemvs with {stated} is not supported: set {cure}")
        near, far = self.min_depth_m, self.max_depth_m
        if near is not None and far is not None and near >= far:
            raise ValueError(
                f"depth range {near:g}..{far:g} m: min_depth_m must be below max_depth_m"
            )
        return self

    def _check_sliding(self) -> None:
        if self.window_s is not None and self.window_events is not None:
            raise ValueError("window_s and window_events are both set: leave one of them out")
        for unit in ("s", "events"):
            if getattr(self, f"stride_{unit}") and not getattr(self, f"window_{unit}"):
                raise ValueError(f"stride_{unit} without window_{unit}: set both")
        if self.slides and self.reference_s is not None:
            raise ValueError(
                "reference_s is for a single window: with sliding windows, set reference to "
                "middle or end"
            )

    @property
    def slides(self) -> bool:
        """Whether to map sliding windows over a whole recording."""
        return self.window_s is not None or self.window_events is not None

    @property
    def is_mcemvs(self) -> bool:
        """Whether to reproduce the authors' implementation."""
        return self.compatibility == "mcemvs"

    @property
    def refines(self) -> bool:
        """Whether maxima are refined between planes (the authors' implementation never does)."""
        return self.interpolate and not self.is_mcemvs

    @property
    def polarities(self) -> int:
        """Volumes per camera and sub-interval: 2 where each polarity is fused by itself."""
        return 2 if self.polarity == "separate" else 1

    @property
    def is_camera_0_view(self) -> bool:
        """Whether the reference view is camera 0's own, in which ground truth is stored."""
        size = (self.view_width_px, self.view_height_px)
        lens = (self.view_focal_px, self.view_focal_y_px, self.view_cx_px, self.view_cy_px)
        return self.reference_shift == 0 and {*size, *lens} == {None}
