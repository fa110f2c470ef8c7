"""What has no volume: an estimator that makes its depth map by itself."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Protocol

from emvs.dsi.method import OWN_UNIT, MethodName, file_name

if TYPE_CHECKING:
    from emvs.config import MapperConfig
    from emvs.data.recording import Recording
    from emvs.depth.depth_map import DepthMap
    from emvs.view import ReferenceView
    from emvs.window import Window

    Estimate = Callable[[Recording, Window, ReferenceView, MapperConfig], DepthMap]


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
class BaselineEstimator:
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

    @property
    def family(self) -> str:
        """The first part of its name."""
        return MethodName.of(self.name).family

    @property
    def file_name(self) -> str:
        """The name as files carry it."""
        return file_name(self.name)


def found_in(module: str, function: str = "estimate") -> Estimate:
    """A function that is imported only when it is called: listing methods stays cheap.

    Args:
        module: such as `emvs.rivals.sgm`.
        function: its name there.
    """

    def estimate(
        recording: Recording, window: Window, view: ReferenceView, config: MapperConfig
    ) -> DepthMap:
        found: Estimate = getattr(import_module(module), function)
        return found(recording, window, view, config)

    return estimate
