"""Values of calibration files, read without trust: plain, bounded, and named where they fail."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from eventsweep.emvs.data.stamps import text_of
from eventsweep.emvs.errors import InputError, located, refused
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.geometry.camera import Camera, Model
from eventsweep.emvs.utils.inputs import SETTINGS_BYTES

FORMATS = (
    "needs a Kalibr, Basalt, DSEC, OpenCV, ROS, EuRoC, aslam or dv-processing calibration, or a "
    "rig.json"
)
"""What a calibration may be, for messages."""
_LARGEST_PX = 20_000
_MOST_VALUES = 100_000
_MOST_DEPTH = 32
_MOST_LETTERS = 500
_LONG_NUMBER = re.compile(rf"[0-9_:.]{{{_MOST_LETTERS + 1}}}")
_LARGEST = 1e100
_LARGEST_M = 1e6
_OPENCV_DIRECTIVE = re.compile(r"\A%YAML:[0-9.]+[^\n]*")


class Entry(NamedTuple):
    """One camera of a file, with its place in a frame common to the file, or why it has none."""

    name: str
    camera: Camera
    T_common_cam: NDArray[np.float64] | str


class _Loader(yaml.SafeLoader):
    """Plain values as YAML 1.2 has them, and OpenCV's matrices as mappings of rows, cols and data.

    So 5e-05 is a number, 010 is ten, and neither `no` nor a date is anything but a text.
    """


def _matrix(loader: yaml.SafeLoader, node: yaml.MappingNode) -> dict[Any, Any]:
    return loader.construct_mapping(node, deep=True)


def _whole(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> int:
    text = str(loader.construct_scalar(node))
    return int(text, 0) if text[1:2] in ("o", "x") else int(text)


def _float(loader: yaml.SafeLoader, node: yaml.ScalarNode) -> float:
    text = str(loader.construct_scalar(node))
    return float(text.replace(".", "", 1) if text[-1].isalpha() else text)


_CORE = {
    "null": (r"~|null|Null|NULL|", "~nN"),
    "bool": (r"true|True|TRUE|false|False|FALSE", "tTfF"),
    "int": (r"[-+]?[0-9]+|0o[0-7]+|0x[0-9a-fA-F]+", "-+0123456789"),
    "float": (
        r"[-+]?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?:[eE][-+]?[0-9]+)?|"
        r"[-+]?\.(?:inf|Inf|INF)|\.(?:nan|NaN|NAN|Nan)", "-+.0123456789",
    ),
    "merge": (r"<<", "<"),
}  # fmt: skip
_Loader.yaml_implicit_resolvers = {}
for _name, (_pattern, _first) in _CORE.items():
    _starts = [*_first, ""] if _name == "null" else [*_first]
    _form = re.compile(rf"(?:{_pattern})\Z")
    _Loader.add_implicit_resolver(f"tag:yaml.org,2002:{_name}", _form, _starts)
_Loader.add_constructor("tag:yaml.org,2002:opencv-matrix", _matrix)
_Loader.add_constructor("tag:yaml.org,2002:int", _whole)
_Loader.add_constructor("tag:yaml.org,2002:float", _float)


def parsed(path: Path) -> dict[str, Any]:
    """The mapping that a JSON or YAML file holds."""
    text = text_of(path, "a calibration: correct the path", SETTINGS_BYTES)
    damage = ValueError, RecursionError, yaml.YAMLError
    with refused(f"{path}: not valid JSON or YAML", *damage, cure=": correct the file"):
        if _LONG_NUMBER.search(text):  # YAML takes time by the square of a number's digits
            raise ValueError(f"a number of more than {_MOST_LETTERS} digits")
        values = (
            json.loads(text)
            if path.suffix == ".json"
            else yaml.load(_OPENCV_DIRECTIVE.sub("", text), _Loader)
        )
        _check_plain(values)
    if not isinstance(values, dict):
        raise InputError(f"{path}: contains no calibration: {FORMATS}")
    return values


def _check_plain(values: Any) -> None:
    """Raises for values that no calibration has, so that later code need not check.

    A few lines of YAML that name each other stand for more values than memory holds, so values are
    counted as often as they are meant.
    """
    left, waiting = _MOST_VALUES, [(values, 0)]
    while waiting:
        value, depth = waiting.pop()
        left -= len(value) + 1 if isinstance(value, dict | list) else 0
        if left < 0 or depth > _MOST_DEPTH:
            raise ValueError(
                f"more than {_MOST_VALUES} values, or nested deeper than {_MOST_DEPTH}"
            )
        if isinstance(value, dict):
            waiting += [(inner, depth + 1) for pair in value.items() for inner in pair]
        elif isinstance(value, list):
            waiting += [(inner, depth + 1) for inner in value]
        elif isinstance(value, str) and len(value) > _MOST_LETTERS:
            raise ValueError(f"a text of {len(value)} characters")
        elif isinstance(value, int | float) and _LARGEST < abs(value) < float("inf"):
            raise ValueError("a number beyond 1e100")


def pose_of(place: Any, key: str) -> NDArray[np.float64]:
    """A rigid motion (4, 4) from px, py, pz, qx, qy, qz, qw; a fault names `key`."""
    position = [number_of(place, name, key) for name in ("px", "py", "pz")]
    quaternion = [number_of(place, name, key) for name in ("qx", "qy", "qz", "qw")]
    norm = float(np.linalg.norm(quaternion))
    if abs(norm - 1) > 1e-3:
        raise InputError(f"{key}: the quaternion's norm is {norm:.6g}: needs 1")
    return se3.from_quat_xyzw(np.array(position), np.array(quaternion) / norm)


def camera_of(
    size: Any, four: list[float], model: Model, terms: list[float], size_key: str, key: str
) -> Camera:
    """A camera from its size, fx, fy, cx, cy (px) and lens terms; a fault names `key`."""
    width, height = numbers_of(size, 2, size_key)
    if not all(1 <= n <= _LARGEST_PX and n == int(n) for n in (width, height)):
        raise InputError(f"{size_key} is {width:g}x{height:g}: needs whole numbers above 0")
    fx, fy, cx, cy = four
    if not (-width < cx < 2 * width and -height < cy < 2 * height):
        raise InputError(
            f"{key}: principal point ({cx:g}, {cy:g}) is far off the sensor: needs pixels of "
            "this sensor"
        )
    with located(key):
        return Camera(int(width), int(height), fx, fy, cx, cy, model, tuple(terms))


def numbers_in(values: Any, key: str, needs: str) -> NDArray[np.float64]:
    """Lists of numbers as an array; a fault names `key`."""
    try:
        return np.array(values, np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"{key} contains a value that is not a number: needs {needs}") from error


def matrix(values: Any, key: str) -> NDArray[np.float64]:
    """A rigid motion (4, 4): as it stands, or the nearest one where it was rounded."""
    T = _motion(values, key)
    return T if se3.is_rigid(T) else se3.nearest_rigid(T)


def near_rigid(values: Any, key: str) -> NDArray[np.float64]:
    """The rigid motion (4, 4) nearest to one that was rounded to a few digits."""
    return se3.nearest_rigid(_motion(values, key))


def _motion(values: Any, key: str) -> NDArray[np.float64]:
    """A motion (4, 4) of 16 numbers, or 12 without the last row, in rows or not.

    One that is further from rigid than rounding takes it is a fault, which names `key`.
    """
    plain = values.get("data") if isinstance(values, dict) else values
    T = numbers_in(plain, key, "4x4 numbers")
    if T.shape in ((12,), (3, 4)):
        T = np.vstack([T.reshape(3, 4), [0, 0, 0, 1]])
    T = T.reshape(4, 4) if T.shape == (16,) else T
    fault = se3.fault(T, se3.ROUNDED)
    if not fault and not (np.abs(T) < _LARGEST_M).all():
        fault = f"it moves by more than {_LARGEST_M:g} m"
    if fault:
        raise InputError(
            f"{key} is not a rigid motion ({fault}): needs a 4x4 matrix with a rotation"
        )
    return T


def entry_of(mapping: Any, name: str, key: str, kind: type) -> Any:
    """What stands under a name, of the given type."""
    if not isinstance(mapping, dict) or name not in mapping:
        raise InputError(f"{key}.{name} is missing: add it")
    if not isinstance(mapping[name], kind):
        raise InputError(f"{key}.{name} is {mapping[name]!r:.60}: needs a {kind.__name__}")
    return mapping[name]


def number_of(mapping: Any, name: str, key: str) -> float:
    """The finite number under a name."""
    if not isinstance(mapping, dict) or name not in mapping:
        raise InputError(f"{key}.{name} is missing: add it")
    return numbers_of([mapping[name]], 1, f"{key}.{name}")[0]


def numbers_of(values: Any, count: int, key: str) -> list[float]:
    """A list of that many finite numbers."""
    plain = isinstance(values, list) and all(
        isinstance(v, int | float) and not isinstance(v, bool) for v in values
    )
    # As floats: numpy has no whole numbers beyond 64 bits.
    numbers = [float(v) for v in values if abs(v) < _LARGEST] if plain else []
    if not plain or len(values) != count or len(numbers) != count:
        raise InputError(f"{key} is {values!r:.60}: needs {count} finite numbers")
    return numbers
