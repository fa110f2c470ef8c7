"""EVIMO2 (Burner et al., 2022), version 2: a folder per camera and sequence, poses and depth.

Folders are `CAMERA/CATEGORY/PURPOSE/SEQUENCE`. Calibration and poses are arrays of Python's objects
that NumPy pickled, and unpickling runs what a file says. Here Python's own unpickler is left with
the opcodes that build lists, mappings, texts and numbers; NumPy's constructors of arrays are stood
in for by a class that keeps what they are given, and every other name is refused.
"""

from __future__ import annotations

import io
import pickle
import struct
import sys
from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.datasets.posed import EventSource, PosedRecording, find_one
from eventsweep.emvs.errors import InputError, located, quoted, refused
from eventsweep.emvs.formats.calibration_values import camera_of, entry_of, number_of
from eventsweep.emvs.formats.tables.npz import FOLDER_FILES, member, opened_archive
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.inputs import TABLE_BYTES

TIMES = FOLDER_FILES["t"]
INFO, _DEPTH, _PLACE = "dataset_info.npz", "dataset_depth.npz", "dataset_extrinsics.npz"
_OTHER = {"left_camera": "right_camera", "right_camera": "left_camera"}
_LENSES: dict[str, tuple[Model, tuple[str, ...]]] = {
    "radtan": ("radtan", ("k1", "k2", "p1", "p2", "k3")),
    "equidistant": ("kb4", ("k1", "k2", "k3", "k4")),
}
_MM = 1e-3
_ARRAY = {"numpy.core.multiarray _reconstruct", "numpy._core.multiarray _reconstruct"}
_ENCODE = "_codecs encode"  # how protocol 2 writes bytes
_NAMES = _ARRAY | {"numpy ndarray", "numpy dtype", _ENCODE}
# Of protocols 2 to 4. Left out: what reserves or holds more than the file (byte arrays, long
# numbers), makes objects of classes, or asks Python's registry.
_OPCODES = b"".join([
    pickle.PROTO, pickle.FRAME, pickle.STOP, pickle.MARK, pickle.GLOBAL, pickle.STACK_GLOBAL,
    pickle.REDUCE, pickle.BUILD, pickle.NONE, pickle.NEWTRUE, pickle.NEWFALSE, pickle.BININT,
    pickle.BININT1, pickle.BININT2, pickle.LONG1, pickle.BINFLOAT, pickle.BINBYTES,
    pickle.SHORT_BINBYTES, pickle.BINUNICODE, pickle.SHORT_BINUNICODE, pickle.EMPTY_TUPLE,
    pickle.TUPLE, pickle.TUPLE1, pickle.TUPLE2, pickle.TUPLE3, pickle.EMPTY_LIST, pickle.APPEND,
    pickle.APPENDS, pickle.EMPTY_DICT, pickle.SETITEM, pickle.SETITEMS, pickle.BINPUT,
    pickle.LONG_BINPUT, pickle.MEMOIZE, pickle.BINGET, pickle.LONG_BINGET,
])  # fmt: skip
_POSES = "full_trajectory"
_FAULTS = (
    pickle.UnpicklingError, EOFError, ValueError, LookupError, TypeError, AttributeError,
    struct.error, MemoryError,
)  # fmt: skip


def open_evimo2(folder: Path) -> PosedRecording:
    """Opens a sequence: one camera, or left and right where both folders have their places.

    These, `dataset_extrinsics.npz`, are published apart. Without them a folder is its own camera's.
    """
    folders = [folder, *_beside(folder)]
    infos = [find_one(each, [INFO], "the calibration and poses") for each in folders]
    metas = [_read_object(info, "meta") for info in infos]
    cameras = [_camera(each / INFO, meta) for each, meta in zip(folders, metas, strict=True)]
    places = [_place(each) for each in folders] if len(folders) > 1 else [np.eye(4)]
    late_us = [_offset_us(each / INFO, meta) for each, meta in zip(folders, metas, strict=True)]
    sources = [EventSource(at, "", t - late_us[0]) for at, t in zip(folders, late_us, strict=True)]
    T_first = se3.inverse(places[0])
    truth = EvimoDepth(folder / _DEPTH, folder / INFO, metas[0], cameras[0])
    return PosedRecording(
        path=folder,
        layout="EVIMO2",
        name=folder.resolve().name,
        rig=Rig("EVIMO2", tuple(cameras), tuple(T_first @ place for place in places)),
        poses=_trajectory(folder / INFO, metas[0]),
        sources=tuple(sources),
        truth=truth if (folder / _DEPTH).exists() else None,
    )


def _beside(folder: Path) -> list[Path]:
    """The other camera's folder of the same sequence, if both say where their cameras sit."""
    path = folder.resolve()
    for above in path.parents[:4]:
        if above.name in _OTHER:
            other = above.parent / _OTHER[above.name] / path.relative_to(above)
            return [other] if all((each / _PLACE).exists() for each in (path, other)) else []
    return []


def _read_object(path: Path, name: str) -> dict[str, Any]:
    """The mapping that NumPy pickled into an archive."""
    array, data = member(path, name, TABLE_BYTES)
    where = f"{path}, array {name}"
    if not array.kind.hasobject:
        raise InputError(f"{where}: of type {array.kind}; needs one object")
    values = object_values(data, where)
    if not isinstance(values, dict):
        raise InputError(f"{where}: needs a mapping; download it again")
    return values


def _camera(path: Path, meta: dict[str, Any]) -> Camera:
    with located(f"{path}, meta"):
        entry = entry_of(meta, "meta", "meta", dict)
        kind = entry_of(entry, "dist_model", "meta", str)
        if kind not in _LENSES:
            raise InputError(f"meta.dist_model is {kind!r:.60}: needs {' or '.join(_LENSES)}")
        model, names = _LENSES[kind]
        terms = [number_of(entry, name, "meta") for name in names]
        terms = terms[:4] if not any(terms[4:]) else terms
        four = [number_of(entry, name, "meta") for name in ("fx", "fy", "cx", "cy")]
        size = [number_of(entry, name, "meta") for name in ("res_x", "res_y")]
        return camera_of(size, four, model, terms, "meta.res_x, res_y", "meta")


def _place(folder: Path) -> NDArray[np.float64]:
    """`T_rig_cam` (4, 4)."""
    t = _read_object(folder / _PLACE, "t_rigcamera")
    q = _read_object(folder / _PLACE, "q_rigcamera")
    with located(folder / _PLACE):
        return se3.from_quat_xyzw(*_motion(t, q, "t_rigcamera", "q_rigcamera"))


def _offset_us(path: Path, meta: dict[str, Any]) -> int:
    """When the bag of the sequence began on the cameras' common clock, µs."""
    with located(f"{path}, meta"):
        return _time_us(entry_of(meta, "meta", "meta", dict), "ros_time_offset", "meta")


def _trajectory(path: Path, meta: dict[str, Any]) -> Trajectory | str:
    """`T_world_cam` at 200 Hz, but where the motion capture lost the camera."""
    with located(f"{path}, meta"):
        entries = entry_of(meta, _POSES, "meta", list) if _POSES in meta else []
        poses = list(_poses(entries))
        if not poses:
            return f"no camera in {_POSES} of {INFO}"
        t_us, positions_m, quats_xyzw = (np.array(column) for column in zip(*poses, strict=True))
        return Trajectory(t_us.astype(np.int64), positions_m, quats_xyzw)


def _poses(entries: list[Any]) -> Iterator[tuple[int, list[float], list[float]]]:
    for k, entry in enumerate(entries):
        if isinstance(entry, dict) and "cam" not in entry:
            continue
        key = f"full_trajectory[{k}]"
        pose = entry_of(entry_of(entry, "cam", key, dict), "pos", f"{key}.cam", dict)
        yield (
            _time_us(entry, "ts", key),
            *_motion(pose.get("t"), pose.get("q"), f"{key}.t", f"{key}.q"),
        )


def _motion(t: Any, q: Any, t_key: str, q_key: str) -> tuple[list[float], list[float]]:
    """Position, m, and quaternion."""
    position_m = [number_of(t, name, t_key) for name in "xyz"]
    quat_xyzw = [number_of(q, name, q_key) for name in "xyzw"]
    norm = float(np.linalg.norm(quat_xyzw))
    if not abs(norm - 1) < 1e-2:
        raise InputError(f"{q_key}: the quaternion's norm is {norm:.6g}: needs 1")
    return position_m, [value / norm for value in quat_xyzw]


def _time_us(entry: Any, name: str, key: str) -> int:
    t_s = number_of(entry, name, key)
    if not abs(t_s) < 1 << 40:
        raise InputError(f"{key}.{name} is {t_s:g} s: needs less than 2^40")
    return round(t_s * 1e6)


class EvimoDepth:
    """`depth_<id>` of an archive, mm at the sensor's pixels, at the times that `meta` gives."""

    def __init__(self, path: Path, info: Path, meta: dict[str, Any], camera: Camera) -> None:
        self._path, self._info, self._meta, self._camera = path, info, meta, camera

    @cached_property
    def _names(self) -> dict[int, str]:
        """Array of each time, µs, in their order."""
        with located(f"{self._info}, meta"):
            frames = entry_of(self._meta, "frames", "meta", list)
            stamps = {
                int(number_of(frame, "id", f"frames[{k}]")): _time_us(frame, "ts", f"frames[{k}]")
                for k, frame in enumerate(frames)
            }
        found: dict[int, str] = {}
        with opened_archive(self._path) as archive:
            for name in archive.namelist():
                number = name.removeprefix("depth_").removesuffix(".npy")
                if name.endswith(".npy") and number.isdecimal() and int(number) in stamps:
                    found[stamps[int(number)]] = name.removesuffix(".npy")
        return dict(sorted(found.items()))

    @property
    def t_us(self) -> NDArray[np.int64]:
        """(T,) times, µs."""
        return np.array(list(self._names), np.int64)

    def view_depth_m(self, t_us: int) -> NDArray[np.float32]:
        """(H, W) z-depth in the undistorted view at one of the times, m, NaN where unknown."""
        from eventsweep.emvs.geometry.warp import undistort_depth

        name, camera = self._names[t_us], self._camera
        array, data = member(self._path, name, TABLE_BYTES)
        shape = (camera.height_px, camera.width_px)
        if array.shape != shape or array.kind.kind not in "uif" or array.by_columns:
            raise InputError(
                f"{self._path}, array {name}: {array.kind} of shape {array.shape}; needs numbers "
                f"of shape {shape}"
            )
        depth_mm = np.frombuffer(data, array.kind).reshape(shape).astype(np.float64)
        known = np.isfinite(depth_mm) & (depth_mm > 0)
        depth_m = np.where(known, depth_mm * _MM, np.nan).astype(np.float32)
        return undistort_depth(depth_m, camera)


def object_values(data: bytes, where: str) -> Any:
    """The value of a pickled array of one object.

    Args:
        data: what follows the header of the npy file.
        where: file and array, for the error's sake.

    Returns:
        Of mappings, lists, tuples, texts, bytes, numbers, booleans and None.

    Raises:
        InputError: damage, anything else in it, or an array of more than one object.
    """
    what, cure = f"{where}: cannot be read as Python's plain values", "; damaged, download it again"
    with refused(what, *_FAULTS, cure=cure):
        with located(where):
            array = _Unpickler(io.BytesIO(data)).load()
        items = array.state[4]
        if not isinstance(array, _Named) or array.name not in _ARRAY or len(items) != 1:
            raise ValueError("no array of one object")
        return items[0]


class _Named:
    """What a name stands for, or what calling it would give; nothing is imported or called."""

    __slots__ = ("name", "state")

    def __init__(self, name: str) -> None:
        self.name = name

    def __call__(self, *values: Any) -> Any:
        return values[0].encode("latin-1") if self.name == _ENCODE else _Named(self.name)

    def __setstate__(self, state: Any) -> None:
        self.state = state


class _Mapping(dict[Any, Any]):
    """One without keys that take long to hash."""

    __slots__ = ()

    def __setitem__(self, key: Any, value: Any) -> None:
        if not isinstance(key, str | int | float):
            raise TypeError("a mapping whose keys are neither texts nor numbers")
        if isinstance(key, int) and abs(key) >= sys.hash_info.modulus:  # these can all hash alike
            raise ValueError(f"a mapping with a key beyond {sys.hash_info.modulus}")
        super().__setitem__(key, value)


# The one in Python: the compiled one cannot be left without opcodes, and one of them makes it
# reserve 64 GB.
class _Unpickler(pickle._Unpickler):
    dispatch: ClassVar = {code: pickle._Unpickler.dispatch[code] for code in _OPCODES} | {
        pickle.EMPTY_DICT[0]: lambda unpickler: unpickler.append(_Mapping())
    }

    def find_class(self, module: str, name: str) -> Any:
        """A stand-in for what may be named."""
        full = f"{module} {name}"
        if full not in _NAMES:
            raise InputError(
                f"loads plain values only, but the file refers to {quoted(full)}: do not trust it"
            )
        return _Named(full)
