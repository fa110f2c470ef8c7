"""A method is a fusion and an extraction: from votes to a volume, and from its maxima to depth."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap, Float32s, Mask, extract, union
from eventsweep.emvs.depth.focus import at_least, estimate_in_focus
from eventsweep.emvs.depth.kept_votes import KeptVotes
from eventsweep.emvs.depth.precision import stated
from eventsweep.emvs.dsi.backend import SweepResult
from eventsweep.emvs.dsi.fusion import WHOLE, Fusion, FusionFunction, Split, Target
from eventsweep.emvs.dsi.fusion_kernels import CAMERA
from eventsweep.emvs.dsi.maxima import Maximum
from eventsweep.emvs.dsi.method import OWN_UNIT, VOTES, NamedMethod
from eventsweep.emvs.errors import InputError, check_type
from eventsweep.emvs.methods.fusion_names import named_fusion
from eventsweep.emvs.reference_view import ReferenceView, inverse_depth_at


class Extraction(ABC):
    """Turns what a sweep leaves into depth maps; every method has one.

    A subclass says what it needs of the sweep and overrides `extract`. With a `family` and a
    `grammar`, names of the form Family/variant are methods of it.

    Attributes:
        family: first part of its methods' names; empty where methods are registered one by one.
        grammar: how their names are built.
        summary: what it does, in a few words.
        examples: some names.
        how: what it adds to a fusion's own summary, such as `, by focus`.
        per_camera: whether it needs where each camera's own rays are most in focus.
        keeps_votes: whether it needs the votes of all planes.
        needs_baseline: whether it needs parallax, and so a baseline.
        trained: whether it learned from other data.
        planes: the only number of planes that it reads; None where any will do.
        calibrated: tables of precision that it brings itself (`emvs.depth.precision.table_name`).
    """

    family = grammar = summary = how = ""
    examples: tuple[str, ...] = ()
    calibrated: tuple[str, ...] = ()
    planes: int | None = None
    per_camera = keeps_votes = needs_baseline = trained = False

    @abstractmethod
    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """The depth map of one of its methods."""

    def measure(self, config: MapperConfig) -> str | None:
        """What is maximised along a ray: votes, a focus measure by name, or None for nothing."""
        del config
        return "votes"

    def parts(self, n_cameras: int) -> tuple[Method, ...]:
        """Other methods whose depth maps it needs."""
        del n_cameras
        return ()

    def check(self, config: MapperConfig) -> None:
        """Refuses unsuitable settings before any work.

        Raises:
            InputError: says what, and how to cure it.
        """
        del config

    def files(self, config: MapperConfig) -> tuple[Path, ...]:
        """Files that its results depend on, such as weights."""
        del config
        return ()

    def build(self, name: str, mcemvs: bool = False) -> Method:
        """The method of a name of its family; with `mcemvs` the mean H is 2ab / (a + b + 0.1).

        Raises:
            InputError: a name that does not follow the grammar.
        """
        fusion, words = named_fusion(name, mcemvs=mcemvs)
        if fusion is None:
            raise InputError(f"unknown method {name!r}: the names are {self.grammar}")
        return Method(name, words + self.how, fusion, self)


class Votes(Extraction):
    """Depth where most rays meet (paper, Alg. 1, line 5), or where a focus measure is largest."""

    def measure(self, config: MapperConfig) -> str:
        """As the configuration says."""
        return config.extraction

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """The maximum, where it stands out from its surroundings; smoothed by a median."""
        votes, focus = swept.result.maxima[method.name], swept.result.focus.get(method.name)
        sharpest = None if focus is None else focus.maximum
        extracted = extract(method.name, votes, swept.view, swept.config, sharpest)
        return stated(extracted, swept.per_rho_px, swept.config)


BY_VOTES = Votes()


@dataclass(frozen=True)
class Method(NamedMethod):
    """A fusion and an extraction.

    Attributes:
        name: as the paper names it, such as `Alg1/H`, `EMVS/cam0` or `Alg2/AtHc@4`.
        summary: what it does, in a few words.
        fusion: from the cameras' votes to a volume.
        extraction: from the volume's maxima to a depth map.
        confidence: what the values of its confidence are, in a word or two, with their unit.
    """

    name: str
    summary: str
    fusion: Fusion
    extraction: Extraction = BY_VOTES
    confidence: str = VOTES

    @classmethod
    def from_function(
        cls,
        name: str,
        function: FusionFunction,
        summary: str,
        split: Split = WHOLE,
        extraction: Extraction = BY_VOTES,
    ) -> Method:
        """A method that fuses by a function of your own; its values must be 0 or more.

        Args:
            name: of the form Family/variant.
            function: read-only votes (C, intervals, N, H, W) float32 to (N, H, W). It sees a few
                planes at a time, so it must not look across planes.
            summary: what it does, in a few words.
            split: the sub-intervals that it wants votes of.
            extraction: what turns the volume's maxima into a depth map; by default as in Alg. 1.

        Raises:
            InputError: a name that is no text, or a function that cannot be called.
        """
        check_type("name", name, str, "a name of the form Family/variant")
        check_type("function", function, Callable, "a function of votes")  # type: ignore[arg-type]
        fusion = Fusion(split=split, function=function, owner=name)
        return cls(name, summary, fusion, extraction, OWN_UNIT)

    def __repr__(self) -> str:
        return f"Method({self.name!r}: {self.summary})"

    def target(self, config: MapperConfig, *, requested: bool = True) -> Target:
        """What the sweep does for it; `requested` keeps a row of its volume."""
        how = self.extraction
        per_camera = how.per_camera and self.fusion.camera is None
        return Target(self.name, self.fusion, how.measure(config), per_camera, requested)


@dataclass(frozen=True, eq=False)
class Swept:
    """What extractions see of a window.

    Attributes:
        result: the maxima, by the method's name.
        view: the reference view.
        config: thresholds, weights, border.
        kept: every camera's votes in all planes, where an extraction needs them.
        baseline_m: what disparities refer to, m; None where there is no parallax.
    """

    result: SweepResult
    view: ReferenceView
    config: MapperConfig
    kept: KeptVotes | None = None
    baseline_m: float | None = None
    _maps: dict[str, DepthMap] = field(default_factory=dict)

    @property
    def per_rho_px(self) -> float | None:
        """Disparity per inverse depth, px m; None where there is no parallax."""
        return None if self.baseline_m is None else self.baseline_m * self.view.camera.fx_px

    @property
    def known_per_rho_px(self) -> float:
        """`per_rho_px`, for an extraction that asked for it."""
        if self.per_rho_px is None:
            raise RuntimeError("no baseline is known: the extraction must set needs_baseline")
        return self.per_rho_px

    @property
    def votes_of_planes(self) -> KeptVotes:
        """`kept`, for an extraction that asked for it."""
        if self.kept is None:
            raise RuntimeError("votes were not kept: the extraction must set keeps_votes")
        return self.kept

    def new_map(
        self, method: Method, where: Maximum, depth_m: Float32s, mask: Mask, reliability: Float32s
    ) -> DepthMap:
        """A depth map of this window; its confidence is the maximum of the votes.

        Args:
            method: whose it is.
            where: the maximum whose plane the map states.
            depth_m: (H, W) float32 z-depth, finite everywhere.
            mask: (H, W) bool, where there is depth.
            reliability: (H, W) float32, the larger the better; 0 or less where there is none.
        """
        view = self.view
        return DepthMap(
            method=method.name,
            depth_m=depth_m,
            confidence=self.result.maxima[method.name].value,
            mask=mask,
            argmax=where.plane,
            rho=view.rho,
            t_us=view.t_us,
            T_world_rv=view.T_world_rv,
            camera=view.camera,
            reliability=reliability,
        )

    def depth_map(self, method: Method) -> DepthMap:
        """The depth map of a method, extracted once."""
        if method.name not in self._maps:
            self._maps[method.name] = method.extraction.extract(method, self)
        return self._maps[method.name]


def single_camera(camera: int) -> Method:
    """EMVS with one camera."""
    return Method(f"EMVS/cam{camera}", f"camera {camera} alone", Fusion(CAMERA + camera))


class Late(Extraction):
    """Per pixel the most confident camera; the volume, the cameras' maximum, only shows a slice."""

    family = "Late"
    grammar = "Late/union"
    summary = "per pixel the most confident camera among those that pass their own threshold"
    examples: tuple[str, ...] = ("Late/union",)
    calibrated = ("Late/union",)

    def measure(self, config: MapperConfig) -> None:
        """Nothing: it searches no rays of its own."""

    def parts(self, n_cameras: int) -> tuple[Method, ...]:
        """EMVS with each camera."""
        return tuple(map(single_camera, range(n_cameras)))

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """Joins the single cameras' depth maps."""
        parts = self.parts(len(swept.result.votes))
        return union(method.name, [swept.depth_map(part) for part in parts])

    def build(self, name: str, mcemvs: bool = False) -> Method:
        """The late fusion, the same in the compatibility setting."""
        del mcemvs
        if name != "Late/union":
            raise InputError(f"unknown method {name!r}: the late fusion is Late/union")
        return Method(name, "the single cameras' maps, joined", Fusion(), self)


LATE = Late()


class Focus(Extraction):
    """Depth where the fused rays are most in focus (`emvs.depth.focus`); no median."""

    family = "Focus"
    grammar = "Focus/<F>, Focus/camK or Focus/<an Algorithm 2, such as AtHc@4>"
    summary = (
        "our own: depth where the fused rays are most in focus, kept where cameras and neighbours "
        "agree; camK: one camera, without agreement"
    )
    examples: tuple[str, ...] = ("Focus/H", "Focus/cam0", "Focus/AtHc@4")
    how = ", by focus"
    per_camera = needs_baseline = True

    def measure(self, config: MapperConfig) -> str:
        """The focus measure of the configuration."""
        return config.focus.measure

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """Depth where the rays are most in focus, at candidates of enough reliability."""
        votes, focus = swept.result.maxima[method.name], swept.result.focus[method.name]
        view, config, per_rho_px = swept.view, swept.config, swept.known_per_rho_px
        estimate = estimate_in_focus(votes, focus, per_rho_px * view.rho, config)
        depth_m = np.reciprocal(inverse_depth_at(view.rho, estimate.position))
        mask = at_least(estimate, config.focus.reliability, config.border_px)
        extracted = swept.new_map(method, focus.maximum, depth_m, mask, estimate.reliability)
        return stated(replace(extracted, scatter_px=estimate.scatter_px), per_rho_px, config)


FOCUS = Focus()
