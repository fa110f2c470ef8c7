"""Parameters of the mapper, defaulted to the benchmark; unknown keys are refused."""

from typing import Annotated, Any, Literal

from pydantic import Field, FiniteFloat, model_validator

from emvs.parameters import ParameterGroup
from emvs.rivals.esvo_parameters import EsvoParameters
from emvs.rivals.parameters import FrameParameters, GtsParameters, SgmParameters

DEFAULT_DEPTH_RANGE_M = (0.2, 5.0)

Positive = Annotated[FiniteFloat, Field(gt=0)]
NotNegative = Annotated[FiniteFloat, Field(ge=0)]
DeviceName = Literal["cpu", "cuda", "auto"]
OddPixels = Annotated[int, Field(ge=1, le=99)]
FocusMeasure = Literal["variance", "mean-square", "gradient", "laplacian", "dog"]


class MapperConfig(ParameterGroup):
    """What Algorithm 1 can be told; every field has a default that works."""

    planes: int = Field(default=100, ge=2, le=100_000, description="number of depth planes")
    spacing: Literal["inverse", "linear"] = Field(
        default="inverse", description="planes uniform in inverse depth, or in depth"
    )
    min_depth_m: Positive | None = Field(
        default=None, description="nearest plane, m; by default what the recording knows, else 0.2"
    )
    max_depth_m: Positive | None = Field(
        default=None, description="farthest plane, m; by default what the recording knows, else 5"
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
        default=None, description="from the begin of one window to the next, s; by default window_s"
    )
    window_events: int | None = Field(
        default=None, ge=1, description="map sliding windows of so many events of camera 0"
    )
    stride_events: int | None = Field(
        default=None,
        ge=1,
        description="from one window to the next, events; by default window_events",
    )
    min_events: int = Field(
        default=1, ge=1, description="events that can vote which every camera needs in a window"
    )
    max_pose_gap_s: Positive | None = Field(
        default=None,
        description="longest time between two poses, s; by default 10 usual ones, >= 0.05",
    )
    hot_pixels: NotNegative = Field(
        default=0.0,
        description="drop pixels this many times as active as their surroundings; 0: none",
    )
    reference_s: NotNegative | None = Field(
        default=None,
        description="time of the reference view, s after the first event; default: middle",
    )
    reference: Literal["middle", "end"] = Field(
        default="middle",
        description="place of the reference view in the window, without reference_s",
    )
    reference_shift: float = Field(
        default=0.0,
        ge=0,
        le=1,
        description="its place on the baseline: 0 at camera 0, 1 at camera 1",
    )
    view_width_px: int | None = Field(
        default=None,
        ge=2,
        le=32768,
        description="columns of the reference view; by default camera 0's",
    )
    view_height_px: int | None = Field(
        default=None,
        ge=2,
        le=32768,
        description="rows of the reference view; by default camera 0's",
    )
    view_focal_px: Positive | None = Field(
        default=None, description="focal length of the reference view, px; by default camera 0's"
    )
    polarity: Literal["both", "separate"] = Field(
        default="both", description="separate: fuse darker and brighter events apart, then sum"
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
        description="what depth maximises along a ray: the votes, or a focus measure",
    )
    focus_measure: FocusMeasure = Field(
        default="variance", description="what the depth of the Focus methods maximises along a ray"
    )
    focus_sigma_px: Positive = Field(
        default=2.5, le=50, description="scale of the focus measures, px of the reference view"
    )
    focus_threshold_kernel_px: int = Field(
        default=5,
        ge=3,
        le=99,
        description="window of the Focus methods' adaptive threshold, px, odd",
    )
    focus_threshold_c: FiniteFloat = Field(
        default=2.0, description="threshold_c of the Focus methods, which reliability follows"
    )
    focus_reliability: float = Field(
        default=0.03, ge=0, le=1, description="reliability that a point of the Focus methods needs"
    )
    inpaint: bool = Field(
        default=False, description="also fill the gaps between points, marked as filled in"
    )
    interpolate: bool = Field(
        default=True, description="refine the maximum between planes by a parabola"
    )
    threshold_kernel_px: int = Field(
        default=5, ge=3, le=99, description="window of the adaptive threshold, px, odd"
    )
    threshold_c: FiniteFloat = Field(
        default=7.0, description="by how much of 255 a confidence must exceed its neighbours' mean"
    )
    median_px: OddPixels = Field(
        default=5, description="window of the masked median, px, odd; 1: none"
    )
    border_px: int = Field(
        default=2, ge=0, description="rim of the image that reports no depth, px"
    )
    max_confidence: NotNegative = Field(
        default=0.0,
        description="votes that make full confidence, unless a pixel has more; 0: its maximum",
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
    device: DeviceName = Field(
        default="cpu", description="where the sweep runs; auto: on an NVIDIA GPU where there is one"
    )
    voting_precision: Literal["fixed", "float"] = Field(
        default="fixed", description="how a GPU sums votes; fixed: the same bits in every run"
    )
    slice_row: int | None = Field(
        default=None, ge=0, description="image row of the DSI slice, px; by default the middle row"
    )
    sgm: SgmParameters = Field(default=SgmParameters(), description="of SGM on time surfaces")
    esvo: EsvoParameters = Field(default=EsvoParameters(), description="of ESVO mapping")
    gts: GtsParameters = Field(default=GtsParameters(), description="of event coincidence")
    frames: FrameParameters = Field(default=FrameParameters(), description="of SGBM on frames")

    @model_validator(mode="before")
    @classmethod
    def _one_method_is_a_list(cls, values: Any) -> Any:
        if isinstance(values, dict) and isinstance(values.get("methods"), str):
            return {**values, "methods": (values["methods"],)}
        return values

    @model_validator(mode="after")
    def _check(self) -> "MapperConfig":
        for name in ("threshold_kernel_px", "focus_threshold_kernel_px", "median_px"):
            if getattr(self, name) % 2 == 0:
                raise ValueError(f"{name} is {getattr(self, name)}: must be odd")
        if self.reference_s is not None and self.reference == "end":
            raise ValueError("reference_s and reference end: leave one of them out")
        self._check_sliding()
        if self.is_mcemvs and (self.spacing, self.polarity) != ("inverse", "both"):
            raise ValueError(
                f"compatibility mcemvs with spacing {self.spacing} and polarity {self.polarity}: "
                "it knows inverse and both only"
            )
        if self.is_mcemvs and self.voting != "bilinear":
            raise ValueError(f"compatibility mcemvs with voting {self.voting}: needs bilinear")
        near, far = self.min_depth_m, self.max_depth_m
        if near is not None and far is not None and near >= far:
            raise ValueError(
                f"depth range {near:g}..{far:g} m: min_depth_m must be below max_depth_m"
            )
        return self

    def _check_sliding(self) -> None:
        if self.window_s is not None and self.window_events is not None:
            raise ValueError("window_s and window_events: leave one of them out")
        for unit in ("s", "events"):
            if getattr(self, f"stride_{unit}") and not getattr(self, f"window_{unit}"):
                raise ValueError(f"stride_{unit} without window_{unit}: set both")
        if self.slides and self.reference_s is not None:
            raise ValueError("reference_s with sliding windows: needs reference middle or end")

    @property
    def slides(self) -> bool:
        """Whether to map sliding windows over a whole recording."""
        return self.window_s is not None or self.window_events is not None

    @property
    def is_mcemvs(self) -> bool:
        """Whether to do as the authors' implementation does."""
        return self.compatibility == "mcemvs"

    @property
    def refines(self) -> bool:
        """Whether maxima are refined between planes (the authors' implementation never does)."""
        return self.interpolate and not self.is_mcemvs

    @property
    def polarities(self) -> int:
        """Volumes per camera and sub-interval: 2 where polarities are fused apart."""
        return 2 if self.polarity == "separate" else 1

    @property
    def is_camera_0_view(self) -> bool:
        """Whether the reference view is camera 0's own, in which ground truth is stored."""
        own_size = (self.view_width_px, self.view_height_px, self.view_focal_px)
        return self.reference_shift == 0 and own_size == (None, None, None)
