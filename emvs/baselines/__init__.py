"""The methods that ray density fusion is compared with, by name: none of them fuses volumes.

Each is a `DepthEstimator`: recording, window and reference view in, one depth map out. All of them
match two cameras, so `rectification` brings a stereo pair to common rows; most of them look at
images of `time_surface`. `BASELINES` lists them; each is imported only when it is called.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol, runtime_checkable

from eventsweep.emvs.dsi.method import OWN_UNIT, NamedMethod

if TYPE_CHECKING:
    from eventsweep.emvs.config import MapperConfig
    from eventsweep.emvs.data.recording import Recording
    from eventsweep.emvs.depth.depth_map import DepthMap
    from eventsweep.emvs.reference_view import ReferenceView
    from eventsweep.emvs.windows import Window

    Estimate = Callable[[Recording, Window, ReferenceView, MapperConfig], DepthMap]


@runtime_checkable
class DepthEstimator(Protocol):
    """What makes a depth map of a window by itself, without rays and planes.

    `emvs.dsi.method.Method` is the other kind of method: one way from votes to a volume.
    """

    @property
    def name(self) -> str:
        """Of the form Family/variant; its depth map carries the same."""

    @property
    def summary(self) -> str:
        """What it does, in a few words."""

    @property
    def confidence(self) -> str:
        """What the values of its confidence are, in a word or two, with their unit."""

    def estimate(
        self, recording: Recording, window: Window, view: ReferenceView, config: MapperConfig, /
    ) -> DepthMap:
        """The depth map of a window in the reference view."""


@dataclass(frozen=True)
class BaselineEstimator(NamedMethod):
    """A `DepthEstimator` made of a function.

    Attributes:
        name: of the form Family/variant; its depth map carries the same.
        summary: what it does, in a few words.
        estimate: recording, window, reference view and configuration to the depth map in that view.
        needs: what a recording must hold besides the events of two cameras, if anything.
        confidence: what the values of its confidence are, in a word or two, with their unit.
    """

    name: str
    summary: str
    estimate: Estimate
    needs: str = ""
    confidence: str = OWN_UNIT


def _imported_when_called(module: str, function: str) -> Estimate:
    """A function of a module of this folder, imported when it is called: listing stays cheap."""
    module = f"{__name__}.{module}"

    def estimate(
        recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
    ) -> DepthMap:
        imported: Estimate = getattr(import_module(module), function)
        return imported(recording, window, view, config)

    estimate.__module__ = module  # see `modules_of`
    return estimate


# What `--method baselines` stands for is all of these that need events only, in this order.
BASELINES = tuple(
    BaselineEstimator(name, summary, _imported_when_called(*where), needs, confidence)
    for name, summary, where, needs, confidence in (
        (
            "SGM/ts", "semi-global matching of the two time surfaces at the reference time",
            ("sgm", "estimate_time_surfaces"), "", "time surface, 0..1",
        ),
        (
            "SGM/window", "SGM/ts at 20 Hz, averaged over the window by the poses",
            ("sgm", "estimate_window"), "", "sum of time surfaces",
        ),
        (
            "ESVO/own-rate",
            "ESVO's mapping: events refined on time surfaces, the newest maps fused",
            ("esvo", "estimate"), "", "1 / σ of inverse depth, m",
        ),
        (
            "ESVO/window", "ESVO's mapping, every map of the window fused",
            ("esvo", "estimate_window"), "", "1 / σ of inverse depth, m",
        ),
        (
            "GTS/events", "pairs of events that coincide in row, time and motion",
            ("gts", "estimate"), "", "1 / (1 + energy), 0..1",
        ),
        (
            "Frames/sgm", "semi-global matching of a stereo pair of ordinary frames",
            ("sgm", "estimate_frames"), "frames of an ordinary camera", "contrast, grey levels",
        ),
    )
)  # fmt: skip

# Words of `--method` for several methods; `all` is `emvs.methods.known_methods`.
GROUPS: dict[str, tuple[str, ...]] = {
    "baselines": tuple(each.name for each in BASELINES if not each.needs),
    "everything": ("all", "Late/union", *(each.name for each in BASELINES if not each.needs)),
}

BY_NAME = {each.name: each for each in BASELINES}
FAMILIES = tuple(dict.fromkeys(each.family for each in BASELINES))


def modules_of(names: Iterable[str]) -> tuple[str, ...]:
    """The modules of those baselines among some methods, or groups: nothing imports them before."""
    named = (method for name in names for method in GROUPS.get(name, (name,)))
    return tuple(dict.fromkeys(BY_NAME[n].estimate.__module__ for n in named if n in BY_NAME))
