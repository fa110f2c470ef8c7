"""Parameters of the global cloud and mesh; unknown keys are refused."""

from pydantic import Field, FiniteFloat

from emvs.parameters import ParameterGroup


class FuseConfig(ParameterGroup):
    """What joining the windows of a map can be told."""

    voxel_m: FiniteFloat = Field(
        default=0.01, gt=0, description="edge of a voxel, m: one point of the global cloud each"
    )
    min_windows: int = Field(
        default=1, ge=1, description="windows that must have a point in a voxel for it to be kept"
    )
    mesh: bool = Field(
        default=False,
        description="also make a surface, of depth whose gaps are filled: partly a guess",
    )
    mesh_truncation: FiniteFloat = Field(
        default=4.0, ge=1, description="how far from a surface the mesh counts distances, voxels"
    )
    mesh_part: int = Field(
        default=100, ge=1, description="triangles that a connected part of the mesh needs"
    )
