"""Real calibration files as rigs: Basalt JSON, Kalibr's chains, DSEC's `cam_to_cam`, and others.

The body is the first camera that is taken, so `T_body_cam` of that one is the identity.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.errors import InputError, said
from eventsweep.emvs.formats.calibration_single import (
    named_as_ros,
    places,
    single_entries,
    unused_places,
)
from eventsweep.emvs.formats.calibration_values import (
    FORMATS,
    Entry,
    camera_of,
    entry_of,
    matrix,
    number_of,
    numbers_of,
    parsed,
    pose_of,
)
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model
from eventsweep.emvs.geometry.rig import Rig

_TERMS = {"kb4": ("k1", "k2", "k3", "k4"), "pinhole": (), "radtan4": ("k1", "k2", "p1", "p2")}
_BASALT: dict[str, tuple[Model, str]] = {"kb4": ("kb4", "kb4"), "pinhole": ("pinhole", "pinhole")}
_KALIBR: dict[str, Model] = {"equidistant": "kb4", "radtan": "radtan", "none": "pinhole"}


_CHAINED, _RECTIFIED = re.compile(r"cam(\d+)"), re.compile(r"camRect\d+")
_INTRINSICS = ("intrinsics", "camera_matrix")


def read_rig(path: Path | Sequence[Path], cameras: Sequence[str | int] = ()) -> Rig:
    """Reads a rig from a calibration file, or from one of each camera.

    Args:
        path: Basalt JSON (TUM-VIE; key `value0`), a Kalibr camera chain (MVSEC), DSEC's
            `cam_to_cam.yaml`, YAML of OpenCV, ROS or aslam, JSON of dv-processing, or a sequence's
            own `rig.json`; or several files of one camera each, such as ESVO's, in the order of
            the cameras.
        cameras: which of the file's cameras, by name (`cam0`) or number, first the one that
            becomes the body; without it the event cameras: entries 2 and 3 of a Basalt file with
            four, those of `camera_type: event` where the file says so, else all.

    Returns:
        The rig, named after the file.

    Raises:
        InputError: a file that cannot be read, or a missing or impossible value; names the key.
    """
    paths = [path] if isinstance(path, Path) else list(path)
    files = [parsed(each) for each in paths]
    try:
        if len(files) > 1:
            return _rig(paths[0].stem, _chosen(_one_each(paths, files), {}, cameras))
        entries = _entries(files[0])
        if entries is None:
            return Rig.from_json(files[0])
        return _rig(paths[0].stem, _chosen(entries, files[0], cameras))
    except InputError as error:
        names = " and ".join(map(str, paths))
        raise InputError(f"{names}: {said(error, 600)}") from error


def cameras_of_topics(paths: Sequence[Path], topics: Sequence[str]) -> tuple[str, ...]:
    """The cameras of a Kalibr chain that belong to topics, in their order.

    A camera belongs to its `rostopic`, or to a topic beside it where no other camera does: some
    are calibrated by pictures made of their events. Empty unless each topic has its own camera.
    """
    chain = parsed(paths[0]) if len(paths) == 1 else {}
    named = [
        (name, str(entry.get("rostopic", "")))
        for name, entry in chain.items()
        if isinstance(name, str) and isinstance(entry, dict) and _CHAINED.fullmatch(name)
    ]
    found = []
    for topic in topics:
        exact = [name for name, own in named if own == topic]
        above = topic.rpartition("/")[0]
        near = [name for name, own in named if above and own.rpartition("/")[0] == above]
        found += (exact or near) if len(exact or near) == 1 else []
    return tuple(found) if len(set(found)) == len(topics) else ()


def left_out(path: Path) -> str:
    """What a file of one camera says of another, for a note where it is read alone."""
    said_of = unused_places(named_as_ros(parsed(path)))
    return (
        f"not used: {' and '.join(said_of)}, which need the other camera's file: name both as "
        "calibration.file of a recording.toml"
        if said_of
        else ""
    )


def _one_each(paths: list[Path], files: list[dict[str, Any]]) -> list[Entry]:
    """The cameras of several files, which hold one each."""
    found = []
    for path, values in zip(paths, files, strict=True):
        entries = single_entries(values)
        if entries is None or len(entries) != 1:
            raise InputError(f"{path.name} is not a file of one camera: name it alone")
        found.append(entries[0])
    T_common_cam = places(paths, [named_as_ros(values) for values in files])
    pairs = zip(found, T_common_cam, strict=True)
    return [Entry(f"cam{k}", entry.camera, T) for k, (entry, T) in enumerate(pairs)]


def read_imu_cam(path: Path) -> NDArray[np.float64]:
    """Where the first event camera sits on the IMU, `T_imu_cam` (4, 4), from a Basalt JSON."""
    values = parsed(path)
    try:
        entries = _basalt(entry_of(values, "value0", "the file", dict))
        return _placed(_chosen(entries, values, ())[0])
    except InputError as error:
        raise InputError(f"{path}: {said(error, 600)}") from error


def _entries(values: dict[str, Any]) -> list[Entry] | None:
    """The cameras of a file; None for our own `rig.json`."""
    if "value0" in values:
        return _basalt(values["value0"])
    entries = single_entries(values)
    return entries or (None if "cameras" in values else _kalibr(values))


def _rig(name: str, entries: list[Entry]) -> Rig:
    # A single camera is its own body, wherever it stands.
    T_common_cam = [np.eye(4)] if len(entries) == 1 else list(map(_placed, entries))
    T_body_common = se3.inverse(T_common_cam[0])
    return Rig(
        name,
        tuple(entry.camera for entry in entries),
        tuple(T_body_common @ T for T in T_common_cam),
        tuple(entry.name for entry in entries),
    )


def _placed(entry: Entry) -> NDArray[np.float64]:
    """Where a camera stands in the frame common to its file."""
    if isinstance(entry.T_common_cam, str):
        raise InputError(f"where {entry.name} stands is not known: {entry.T_common_cam}")
    return entry.T_common_cam


def _chosen(
    entries: list[Entry], values: dict[str, Any], cameras: Sequence[str | int]
) -> list[Entry]:
    names = [entry.name for entry in entries]
    wanted = [f"cam{c}" if isinstance(c, int) else c for c in cameras]
    wanted = wanted or _event_cameras(names, values)
    missing = [name for name in wanted if name not in names]
    if missing:
        raise InputError(f"no camera {missing[0]}: choose from {', '.join(names)}")
    return [entries[names.index(name)] for name in wanted]


def _event_cameras(names: list[str], values: dict[str, Any]) -> list[str]:
    if "value0" in values:
        return names[2:4] if len(names) == 4 else names
    chain = values.get("intrinsics", values)
    events = [n for n in names if n in chain and chain[n].get("camera_type") == "event"]
    return events or names


def _basalt(value0: Any) -> list[Entry]:
    intrinsics = entry_of(value0, "intrinsics", "value0", list)
    places = entry_of(value0, "T_imu_cam", "value0", list)
    sizes = entry_of(value0, "resolution", "value0", list)
    if not len(intrinsics) == len(places) == len(sizes) >= 1:
        raise InputError(
            f"value0 has {len(intrinsics)} intrinsics, {len(places)} T_imu_cam and {len(sizes)} "
            "resolutions: needs as many of each, at least one"
        )
    found = []
    for k, (entry, place, size) in enumerate(zip(intrinsics, places, sizes, strict=True)):
        key = f"value0.intrinsics[{k}]"
        kind = entry_of(entry, "camera_type", key, str)
        if kind not in _BASALT:
            raise InputError(f"{key}.camera_type is {kind!r}: needs {' or '.join(_BASALT)}")
        model, terms = _BASALT[kind]
        numbers = entry_of(entry, "intrinsics", key, dict)
        names = ("fx", "fy", "cx", "cy", *_TERMS[terms])
        given = [number_of(numbers, name, f"{key}.intrinsics") for name in names]
        camera = camera_of(size, given[:4], model, given[4:], f"value0.resolution[{k}]", key)
        found.append(Entry(f"cam{k}", camera, pose_of(place, f"value0.T_imu_cam[{k}]")))
    return found


def _kalibr(values: dict[str, Any]) -> list[Entry]:
    """A chain in which `T_cn_cnm1` carries points of each camera's frame into the next one's.

    Where a link is missing, two cameras that sit on one IMU say the same.
    """
    chain = values.get("intrinsics", values)
    extrinsics = values.get("extrinsics", {})
    names = _chain_names(chain)
    places: dict[str, NDArray[np.float64] | str] = {names[0]: np.eye(4)}
    for name in names[1:]:
        places[name] = _link_place(chain, extrinsics, name, places)
    return [Entry(name, kalibr_camera_of(chain[name], name), places[name]) for name in names]


def _chain_names(chain: Any) -> list[str]:
    """The cameras of a chain, in order."""
    cameras = [
        name for name, entry in chain.items() if isinstance(name, str)
        and isinstance(entry, dict) and not _RECTIFIED.fullmatch(name)
        and (_CHAINED.fullmatch(name) or any(key in entry for key in _INTRINSICS))
    ] if isinstance(chain, dict) else []  # fmt: skip
    if not cameras:
        raise InputError(f"contains no camera: {FORMATS}")
    odd = [name for name in cameras if not _CHAINED.fullmatch(name)]
    if odd:
        raise InputError(
            f"{odd[0]!r:.60} is a camera outside the chain: call it cam{len(cameras) - 1}"
        )
    return sorted(cameras, key=lambda name: int(name.removeprefix("cam")))


def _link_place(
    chain: Any, extrinsics: Any, name: str, places: dict[str, NDArray[np.float64] | str]
) -> NDArray[np.float64] | str:
    """Where a camera stands in the first one's frame, or why nobody knows."""
    k = int(name.removeprefix("cam"))
    before, between = f"cam{k - 1}", f"T_{k}{k - 1}"
    T_before, why = places.get(before, f"{before} is missing before it"), ""
    if isinstance(extrinsics, dict) and between in extrinsics:
        link, key = extrinsics[between], f"extrinsics.{between}"
    else:
        link, key = chain[name].get("T_cn_cnm1"), f"{name}.T_cn_cnm1"
    if isinstance(T_before, str):
        why = T_before
    elif link is not None:
        return T_before @ se3.inverse(matrix(link, key))
    T_imu_cam = _on_imu(chain[name], name)
    for other, T_first_other in places.items():
        T_imu_other = _on_imu(chain[other], other)
        if T_imu_cam is not None and T_imu_other is not None and not isinstance(T_first_other, str):
            return T_first_other @ se3.inverse(T_imu_other) @ T_imu_cam
    return why or f"{key} is missing: add it"


def _on_imu(entry: dict[str, Any], name: str) -> NDArray[np.float64] | None:
    """Where a camera sits on the IMU, if its entry says so."""
    if "T_imu_cam" in entry:
        return matrix(entry["T_imu_cam"], f"{name}.T_imu_cam")
    if "T_cam_imu" in entry:
        return se3.inverse(matrix(entry["T_cam_imu"], f"{name}.T_cam_imu"))
    return None


def kalibr_camera_of(entry: Any, name: str) -> Camera:
    """The camera that an entry of a Kalibr chain describes; a fault names `name`."""
    kind = entry_of(entry, "camera_model", name, str)
    if kind != "pinhole":
        raise InputError(f"{name}.camera_model is {kind!r}: needs pinhole")
    lens = entry_of(entry, "distortion_model", name, str)
    if lens not in _KALIBR:
        raise InputError(f"{name}.distortion_model is {lens!r}: needs {' or '.join(_KALIBR)}")
    key = "camera_matrix" if "camera_matrix" in entry else "intrinsics"
    four = numbers_of(entry_of(entry, key, name, list), 4, f"{name}.{key}")
    coefficients = entry_of(entry, "distortion_coeffs", name, list) if lens != "none" else []
    terms = numbers_of(coefficients, len(coefficients), f"{name}.distortion_coeffs")
    size = entry_of(entry, "resolution", name, list)
    return camera_of(size, four, _KALIBR[lens], terms, f"{name}.resolution", name)
