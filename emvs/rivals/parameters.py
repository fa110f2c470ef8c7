"""Parameters of every rival, as groups of the mapper's configuration; no numpy is imported.

Defaults are the published values where there are any; docs/baselines.md says which those are.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import AfterValidator, Field, FiniteFloat

from emvs.parameters import ParameterGroup

Positive = Annotated[FiniteFloat, Field(gt=0)]
NotNegative = Annotated[FiniteFloat, Field(ge=0)]
Count = Annotated[int, Field(ge=1)]


def _odd(size_px: int) -> int:
    if size_px % 2 == 0:
        raise ValueError(f"must be odd, {size_px} is not")
    return size_px


OddPixels = Annotated[int, Field(ge=1, le=99), AfterValidator(_odd)]
MedianPixels = Annotated[int, Field(ge=1, le=5), AfterValidator(_odd)]


class SemiGlobal(ParameterGroup):
    """Semi-global matching of two images, OpenCV's."""

    block_px: OddPixels = Field(default=11, description="side of the matched blocks, odd, px")
    p1_per_px: Count = Field(
        default=8, description="penalty per block pixel of a disparity step of 1"
    )
    p2_per_px: Count = Field(default=32, description="penalty per block pixel of a larger step")
    uniqueness_percent: int = Field(
        default=11, ge=0, le=100, description="by how much the best cost must undercut the second"
    )
    left_right_px: Count = Field(
        default=1, description="largest difference between the disparities seen from both sides, px"
    )


class SgmParameters(ParameterGroup):
    """Semi-global matching of time surfaces: `SGM/ts` and `SGM/window`."""

    decay_s: Positive = Field(default=0.03, description="time constant of the time surfaces, s")
    median_px: MedianPixels = Field(default=3, description="median over them, 1 (none), 3 or 5 px")
    active_s: Positive = Field(
        default=0.01, description="how lately a pixel must have fired to report depth, s"
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
        default=3, description="half a side of the neighbourhood whose times tell the motion, px"
    )
    memory_s: Positive = Field(default=0.03, description="how old a neighbour may be, s")
    coincidence: Coincidence = Coincidence()
