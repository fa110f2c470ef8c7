"""What a method is: which votes it takes, over which sub-intervals, and how it fuses them."""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.dsi import fusion_kernels
from eventsweep.emvs.errors import check_type

Volume = NDArray[np.float32]
# A fusion of one's own: votes (C, intervals, N, H, W) to (N, H, W)
Fusion = Callable[[Volume], Volume]
_STRIPS = 64  # enough for any number of threads to share them evenly
CODES = {
    "min": fusion_kernels.MIN,
    "H": fusion_kernels.HARMONIC,
    "G": fusion_kernels.GEOMETRIC,
    "A": fusion_kernels.ARITHMETIC,
    "RMS": fusion_kernels.RMS,
    "max": fusion_kernels.MAX,
}
MEANS = {
    "min": "minimum",
    "H": "harmonic mean",
    "G": "geometric mean",
    "A": "arithmetic mean",
    "RMS": "root mean square",
    "max": "maximum",
}
VOTES, OWN_UNIT = "votes", "own unit"  # what the values of a confidence are


class MethodName(NamedTuple):
    """A method's name, taken apart.

    Attributes:
        family: what comes before the first slash, such as `Alg1`.
        variant: what comes after it, such as `H` or `cam0`; empty where there is no slash.
    """

    family: str
    variant: str

    @classmethod
    def of(cls, name: str) -> MethodName:
        """Takes any name apart, whether a method has it or not."""
        family, _, variant = name.partition("/")
        return cls(family, variant)

    @property
    def camera(self) -> int | None:
        """The camera that the variant names, as `cam0` does."""
        found = re.fullmatch(r"cam(\d+)", self.variant)
        return int(found[1]) if found else None


class NamedMethod:
    """What follows from the name of any method.

    Attributes:
        name: of the form Family/variant.
    """

    name: str

    @property
    def family(self) -> str:
        """The first part of its name."""
        return MethodName.of(self.name).family

    @property
    def file_name(self) -> str:
        """The name as files carry it."""
        return file_name(self.name)


@dataclass(frozen=True)
class Split:
    """How a window's events are divided into sub-intervals, each camera's on its own.

    Attributes:
        intervals: how many; 1 is the whole window.
        by: `count`: as many events in each, as the authors' program does; `time`: as long each.
    """

    intervals: int = 1
    by: Literal["count", "time"] = "count"

    def edges(self, t_us: NDArray[np.int64], t0_us: int, t1_us: int) -> NDArray[np.int64]:
        """Returns the (intervals + 1,) events where a camera's sub-intervals begin and end.

        Args:
            t_us: (N,) int64, the camera's events in the window, sorted.
            t0_us: begin of the window, included.
            t1_us: end of the window, excluded.
        """
        edge = np.arange(self.intervals + 1, dtype=np.int64)
        if self.by == "count":
            edge *= len(t_us)
            edge //= self.intervals
            return edge
        inner_us = t0_us + edge[1:-1] * (t1_us - t0_us) // self.intervals
        edge[1:-1] = np.searchsorted(t_us, inner_us, side="left")
        edge[-1] = len(t_us)
        return edge


WHOLE = Split()


@dataclass(frozen=True)
class Method(NamedMethod):
    """One way from votes to one volume; methods of one split share one sweep.

    Attributes:
        name: as the paper names it, such as `Alg1/H`, `EMVS/cam0` or `Alg2/AtHc@4`.
        code: the compiled fusion that comes first.
        summary: what it does, in a few words.
        split: the sub-intervals that it needs votes of.
        outer: the compiled fusion of what `code` gave, where there are sub-intervals.
        time_first: whether `code` fuses over time and `outer` across cameras, or the other way.
        shuffled: whether interval k of camera 0 meets interval k + n/2 (cyclic) of the others.
        late: whether it joins the single cameras' depth maps; `code` then only fills its slice.
        focus: whether depth lies where the fused rays are most in focus (`emvs.depth.focus`).
        learned: whether a network then looks at the votes around that place (`emvs.learned`).
        derd: whether a published network reads the votes of all planes (`emvs.learned.derd`).
        function: a fusion of one's own, instead of the codes.
        confidence: what the values of its confidence are, in a word or two, with their unit.
    """

    name: str
    code: int
    summary: str
    split: Split = WHOLE
    outer: int = fusion_kernels.MAX
    time_first: bool = False
    shuffled: bool = False
    late: bool = False
    focus: bool = False
    learned: bool = False
    derd: bool = False
    function: Fusion | None = field(default=None, compare=False)
    confidence: str = VOTES

    @classmethod
    def from_function(
        cls, name: str, function: Fusion, summary: str, split: Split = WHOLE
    ) -> Method:
        """A method that fuses by a function of one's own; its values must be 0 or more.

        Args:
            name: of the form Family/variant.
            function: read-only votes (C, intervals, N, H, W) float32 to (N, H, W). It sees a few
                planes at a time, so it must not look across planes.
            summary: what it does, in a few words.
            split: the sub-intervals that it wants votes of.

        Raises:
            InputError: a name that is no text, or a function that cannot be called.
        """
        check_type("name", name, str, "a name of the form Family/variant")
        check_type("function", function, Callable, "a function of votes")  # type: ignore[arg-type]
        return cls(name, fusion_kernels.MAX, summary, split, function=function, confidence=OWN_UNIT)

    def __repr__(self) -> str:
        return f"Method({self.name!r}: {self.summary})"

    def camera(self) -> int | None:
        """The one camera whose votes it takes; None where it fuses all of them."""
        alone = self.function is None and self.code >= fusion_kernels.CAMERA
        return self.code - fusion_kernels.CAMERA if alone else None

    @property
    def volume(self) -> Method:
        """The method that makes the same volume and nothing else of it: equal for equal volumes."""
        if self.function is not None:
            return self  # functions are not compared: only its name tells it from others
        plain = replace(self, name="", summary="", confidence=VOTES)
        return replace(plain, focus=False, learned=False, derd=False)

    @property
    def keeps_votes(self) -> bool:
        """Whether it looks at the votes again after the sweep."""
        return self.learned or self.derd

    @property
    def compares_cameras(self) -> bool:
        """Whether it asks where each camera's own rays are in focus, and so whether they agree."""
        return self.focus and self.camera() is None

    def groups(self, n_cameras: int) -> NDArray[np.int64]:
        """Which volumes are fused first: (groups, members) of `camera * intervals + interval`."""
        n = self.split.intervals
        volumes = np.arange(n_cameras * n).reshape(n_cameras, n)
        if self.shuffled:
            volumes[1:] = np.roll(volumes[1:], -(n // 2), axis=1)
        return volumes if self.time_first else volumes.T


def file_name(method: str) -> str:
    """Returns a method's name as files carry it."""
    return method.replace("/", "-")


def single_cameras(n_cameras: int) -> tuple[Method, ...]:
    """Lists EMVS with each camera."""
    return tuple(single_camera(c) for c in range(n_cameras))


def single_camera(camera: int) -> Method:
    """EMVS with one camera."""
    return Method(f"EMVS/cam{camera}", fusion_kernels.CAMERA + camera, f"camera {camera} alone")


@dataclass(frozen=True, eq=False)
class FusionTables:
    """Methods of one split as the compiled loops read them (`emvs.dsi.fusion_kernels.fold`)."""

    codes: NDArray[np.int64]
    sizes: NDArray[np.int64]
    which: NDArray[np.int64]
    every: NDArray[np.int64]

    @classmethod
    def of(cls, methods: Sequence[Method], volumes: int, polarities: int = 1) -> FusionTables:
        """Lists the groups of methods, whose split must be the same.

        Args:
            methods: the methods, without functions of their own.
            volumes: how many there are: polarities x cameras x intervals.
            polarities: 2 where each polarity has volumes of its own.
        """
        per_part = volumes // polarities
        groups = [method.groups(per_part // method.split.intervals) for method in methods]
        sizes = np.array([group.shape for group in groups], np.int64)
        which = np.zeros((len(methods), polarities, *sizes.max(axis=0)), np.int64)
        for m, group in enumerate(groups):
            for part in range(polarities):
                which[m, part, : group.shape[0], : group.shape[1]] = group + part * per_part
        codes = np.array([(method.code, method.outer) for method in methods], np.int64)
        return cls(codes, sizes, which, np.arange(which.shape[2]))

    @property
    def arrays(self) -> tuple[NDArray[np.int64], ...]:
        """What the loops take first."""
        return self.codes, self.sizes, self.which, self.every

    def scratch(self, height_px: int, width_px: int) -> tuple[Volume, Volume, Volume]:
        """Room for the loops' rows: (S, G, 1, W) and twice (S, W) float32, for S strips of rows."""
        strips = min(height_px, _STRIPS)
        level = np.empty((strips, len(self.every), 1, width_px), np.float32)
        spare, fused = np.empty((2, strips, width_px), np.float32)
        return level, spare, fused
