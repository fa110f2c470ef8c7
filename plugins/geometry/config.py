"""Which geometries are scored, and how: settings, which are flags; imports nothing heavy."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from eventsweep.emvs.parameters import ParameterGroup

SUFFIXES = (".ply", ".pcd", ".obj", ".stl", ".off", ".glb", ".gltf")
"""What is read."""
OTHER_SUFFIXES = (
    ".las", ".laz", ".e57", ".xyz", ".pts", ".splat", ".ksplat", ".spz", ".sog", ".fbx", ".usd",
    ".usdz", ".dae", ".3ds",
)  # fmt: skip
"""Geometries in formats that are not read: refused as such, and not as poses."""
DEPTH_SUFFIXES = (".npz", ".npy", ".png", ".tif", ".tiff", ".exr", ".pfm")
"""Depth maps, also rendered ones: refused with the way to their scores, and not as poses."""
Length = Annotated[float, Field(gt=0, le=1e3, allow_inf_nan=False)]


class GeometryConfig(ParameterGroup):
    """How true surfaces are sampled, and geometries read."""

    cell_m: Length = Field(
        default=0.01, description="Edge of the cells that hold one true point each, m."
    )
    far_m: Length = Field(default=5.0, description="Surfaces beyond this depth are `far`, m.")
    samples_per_m2: float = Field(
        default=0, ge=0, le=1e9, allow_inf_nan=False,
        description="Points drawn per m² of a mesh; by default 4 per square of a cell's edge.",
    )  # fmt: skip
    sampling_seed: int = Field(
        default=0, ge=0, lt=1 << 63, description="Seed of the points drawn from a mesh."
    )
    least_opacity: float = Field(
        default=0.5, ge=0, le=1,
        description="Of Gaussian splats, the centres with at least this opacity are scored.",
    )  # fmt: skip
    write_truth: bool = Field(
        default=False, description="Also write the true points, as truth.ply, with --out."
    )
