"""Parameters of the global cloud and mesh; unknown keys are refused."""

from pydantic import BaseModel, ConfigDict, Field, FiniteFloat


class FuseConfig(BaseModel):
    """What joining the windows of a map can be told."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    voxel_m: FiniteFloat = Field(
        0.01, gt=0, description="edge of a voxel, m: one point of the global cloud each"
    )
    min_windows: int = Field(
        1, ge=1, description="windows that must have a point in a voxel for it to be kept"
    )
    mesh: bool = Field(
        False, description="also make a surface, of depth whose gaps are filled: partly a guess"
    )
    mesh_truncation: FiniteFloat = Field(
        4.0, ge=1, description="how far from a surface the mesh counts distances, voxels"
    )
    mesh_part: int = Field(
        100, ge=1, description="triangles that a connected part of the mesh needs"
    )
