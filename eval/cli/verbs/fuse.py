"""`eventsweep fuse`: the windows of a map to one cloud and one mesh."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Group, Parameter

from eventsweep.emvs.config import FuseConfig
from eventsweep.emvs.errors import InputError
from eventsweep.eval.cli.app import COMMON, Common, app

FuseFlags = Annotated[FuseConfig, Parameter(name="*", group=Group("Fusion parameters"))]
_DEFAULT = FuseConfig()


@app.command
def fuse(
    folder: Path,
    /,
    *,
    method: str | None = None,
    common: Common = COMMON,
    config: FuseFlags = _DEFAULT,
) -> None:
    """Join the windows of a map into one point cloud and, on request, a mesh.

    Args:
        folder: Folder that `map` wrote; global/METHOD in it is replaced.
        method: Method whose depth maps are joined; by default Alg1/H.
    """
    from eventsweep.emvs.maps.folder import read_map
    from eventsweep.emvs.maps.merge import fuse_windows

    if not config.mesh and config.model_fields_set & {"mesh_truncation", "mesh_part"}:
        raise InputError("--mesh-truncation and --mesh-part have no effect without --mesh: add it")
    console = common.console()
    stored = read_map(folder)
    with console.progress.stage("fuse", len(stored.windows)) as update:
        where, info = fuse_windows(
            stored, config, method,
            lambda _stage, done, total: update(done, f"{done} of {total} windows"),
        )  # fmt: skip
    mesh = "" if info.triangles is None else f", a mesh of {info.triangles:,} triangles"
    line = (
        f"{info.method}: {info.window_points:,} points of {info.windows} windows, "
        f"{info.points:,} voxels of {info.config.voxel_m:g} m{mesh}, in {where}"
    )
    console.result({"path": str(where), **info.model_dump(mode="json")}, [line])
