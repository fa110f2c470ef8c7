"""Exact surfaces that the cameras of a sequence saw, sampled evenly: one point for each cell."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.depth.point_cloud import cell_keys, farthest
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.cache import Cache, default_cache, key_of
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.eval.jobs.code_version import source_digest
from eventsweep.plugins.geometry.ply import write_points
from eventsweep.plugins.geometry.surfels import KINDS, Surfels, ordered, surfels_of

SEEN = (("once", 1, 1), ("few", 2, 9), ("many", 10, None))
"""Classes by how many pictures show a surface: name, least and most."""
_MERGE_AT_LEAST = 1_000_000
_FILE = "truth.npz"
_MODULES = tuple(
    f"eventsweep.plugins.geometry.{name}"
    for name in ("truth", "surfels", "nearest", "nearest_kernels")
)


def open_sequence(path: Path) -> Sequence:
    """Opens what has exact depth and poses.

    Raises:
        InputError: something else than a sequence with both.
    """
    if path.is_file():
        raise InputError(
            f"{path}: is a file; a geometry is scored against the folder of a sequence"
        )
    recording = open_recording(path)
    if not isinstance(recording, Sequence):
        raise InputError(
            f"{path}: has no exact depth of every camera; a geometry is scored against a sequence "
            "as `simulate` writes it"
        )
    if not any(len(recording.truth_times_us(camera)) for camera in range(len(recording.rig))):
        raise InputError(f"{path}: has no ground truth; simulate it with its depth")
    recording.trajectory  # noqa: B018 - refuses a sequence without poses
    return recording


def true_surfaces(
    sequence: Sequence, cell_m: float, far_m: float, progress: Progress = silent
) -> Surfels:
    """One surfel for each cell in which a camera saw a surface, over the whole sequence.

    Each is a pixel's own point, the nearest to the middle of its cell: exactly on the surface. Its
    class is that which most pictures give it. What can move by itself is left out where
    segmentation is stored. Pictures are read one by one.

    Raises:
        InputError: nothing was seen, or surfaces too far away for cells of this size.
    """
    cells = _Cells(cell_m)
    rig = sequence.rig
    pictures = [(k, int(t)) for k in range(len(rig)) for t in sequence.truth_times_us(k)]
    rays = [camera.ray_table() for camera in rig.cameras]
    has_moving = ["segmentation" in sequence.truth_names(k) for k in range(len(rig))]
    for done, (k, t_us) in enumerate(pictures):
        progress("truth", done, len(pictures))
        moving = sequence.truth_dynamic(k, t_us) if has_moving[k] else None
        T_world_cam = sequence.trajectory.at([t_us])[0] @ rig.T_body_cam[k]
        depth_m, focal_px = sequence.truth_depth_m(k, t_us), rig.cameras[k].fx_px
        cells.add(surfels_of(depth_m, rays[k], T_world_cam, focal_px, cell_m, far_m, moving))
    found = cells.surfels()
    if not len(found):
        raise InputError(f"{sequence.path}: its cameras saw no surface: nothing to score against")
    return ordered(found)  # as they are searched: once here, not in every score


def cached_surfaces(
    sequence: Sequence, cell_m: float, far_m: float, progress: Progress = silent
) -> Surfels:
    """The same, made once for the same files, settings and code."""
    facts = {
        "kind": "true surfaces", "sequence": sequence.manifest.digest(), "cell_m": cell_m,
        "far_m": far_m, "code": source_digest(_MODULES),
    }  # fmt: skip

    def fill(folder: Path) -> None:
        store(folder, true_surfaces(sequence, cell_m, far_m, progress))

    return stored(Cache(default_cache()).get(key_of(facts), facts, fill).path)


def store(folder: Path, truth: Surfels) -> None:
    """Writes surfels into a folder of a cache."""
    np.savez(folder / _FILE, **vars(truth))


def stored(folder: Path) -> Surfels:
    """What `store` wrote."""
    with np.load(folder / _FILE, allow_pickle=False) as columns:
        return Surfels(**{field.name: columns[field.name] for field in fields(Surfels)})


def write_truth(path: Path, truth: Surfels) -> None:
    """Writes a PLY with every attribute; `kind` is a number in `KINDS`."""
    columns: dict[str, NDArray[Any]] = {
        axis: truth.points_world[:, k] for k, axis in enumerate("xyz")
    }
    columns |= {f"n{axis}": truth.normals[:, k] for k, axis in enumerate("xyz")}
    columns |= {name: getattr(truth, name) for name in ("radius_m", "depth_m", "kind", "views")}
    write_points(path, columns, (f"kind: {' '.join(f'{k} {n}' for k, n in enumerate(KINDS))}",))


@dataclass(frozen=True, eq=False)
class _Part:
    """Surfels of different cells, their numbers increasing.

    Attributes:
        keys: (V,) int64 numbers of the cells.
        apart_m: (V,) float32 distance of the surfel from the cell's middle.
        surfels: one per cell; `views` counts pictures.
        votes: (V, kinds) int32 how many pictures say that it is of each class.
    """

    keys: NDArray[np.int64]
    apart_m: NDArray[np.float32]
    surfels: Surfels
    votes: NDArray[np.int32]


class _Cells:
    """Keeps of each cell the point nearest to its middle, over any number of pictures."""

    def __init__(self, cell_m: float) -> None:
        self._cell_m = cell_m
        self._parts: list[_Part] = []

    def add(self, surfels: Surfels) -> None:
        """Adds the surfels of one picture."""
        cell = np.floor(surfels.points_world / self._cell_m)
        middle = (cell + 0.5) * self._cell_m
        apart_m = np.linalg.norm(surfels.points_world - middle, axis=1).astype(np.float32)
        votes = np.eye(len(KINDS), dtype=np.int32)[surfels.kind]
        one = _one_each(_Part(self._keys(cell), apart_m, surfels, votes))
        of_picture = replace(one.surfels, views=np.ones(len(one.keys), np.int32))
        chosen = np.eye(len(KINDS), dtype=np.int32)[of_picture.kind]
        self._parts.append(replace(one, surfels=of_picture, votes=chosen))
        # Merging costs as much as there is: so it waits until as much has come.
        waiting = sum(len(part.keys) for part in self._parts[1:])
        if waiting > max(_MERGE_AT_LEAST, len(self._parts[0].keys)):
            self._merge()

    def surfels(self) -> Surfels:
        """What was kept, cell after cell."""
        if not self._parts:
            return _NONE
        self._merge()
        part = self._parts[0]
        return replace(part.surfels, kind=np.argmax(part.votes, axis=1).astype(np.uint8))

    def _merge(self) -> None:
        self._parts = [_one_each(_joined(self._parts))]

    def _keys(self, cell: NDArray[np.float64]) -> NDArray[np.int64]:
        if far := farthest(cell):
            raise InputError(
                f"a surface {far * self._cell_m:.3g} m from the origin does not fit "
                f"cells of {self._cell_m:g} m: raise cell_m"
            )
        return cell_keys(cell)


_NONE = Surfels(
    np.empty((0, 3)), np.empty((0, 3), np.float32), np.empty(0, np.float32),
    np.empty(0, np.float32), np.empty(0, np.uint8), np.empty(0, np.int32),
)  # fmt: skip


def _joined(parts: list[_Part]) -> _Part:
    surfels = Surfels(
        *(
            np.concatenate([getattr(part.surfels, f.name) for part in parts])
            for f in fields(Surfels)
        )
    )
    keys, apart_m, votes = (
        np.concatenate([getattr(part, name) for part in parts])
        for name in ("keys", "apart_m", "votes")
    )
    return _Part(keys, apart_m, surfels, votes)


def _one_each(part: _Part) -> _Part:
    """Of each cell the surfel nearest to its middle; views and votes are added up."""
    if not len(part.keys):
        return part
    order = np.lexsort((part.apart_m, part.keys))
    keys = part.keys[order]
    starts = np.flatnonzero(np.r_[True, keys[1:] != keys[:-1]])
    first = order[starts]
    surfels = Surfels(*(getattr(part.surfels, f.name)[first] for f in fields(Surfels)))
    summed = replace(
        surfels,
        views=np.add.reduceat(part.surfels.views[order], starts, dtype=np.int32),
        depth_m=np.minimum.reduceat(part.surfels.depth_m[order], starts),
    )
    votes = np.add.reduceat(part.votes[order], starts, axis=0, dtype=np.int32)
    return _Part(keys[starts], part.apart_m[first], summed, votes)
