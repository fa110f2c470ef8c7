"""Versions of everything that can change a result."""

import platform
from importlib import metadata

_LIBRARIES = (
    "eventsweep",
    "numpy",
    "numba",
    "scipy",
    "opencv-python-headless",
    "h5py",
    "mujoco",
    "open3d",
    "numba-cuda",
)


def versions() -> dict[str, str]:
    """Python's and each library's version; "absent" where one is not installed."""
    return {"python": platform.python_version()} | {name: _version(name) for name in _LIBRARIES}


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "absent"
