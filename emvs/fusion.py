"""Fusion of the cameras' volumes, voxel by voxel, and the methods that are named after it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from emvs import fuse_kernels
from emvs.errors import InputError

Volume = NDArray[np.float32]

_CODES = {
    "min": fuse_kernels.MIN,
    "H": fuse_kernels.HARMONIC,
    "G": fuse_kernels.GEOMETRIC,
    "A": fuse_kernels.ARITHMETIC,
    "RMS": fuse_kernels.RMS,
    "max": fuse_kernels.MAX,
}

_MEANS = {
    "min": "minimum",
    "H": "harmonic mean",
    "G": "geometric mean",
    "A": "arithmetic mean",
    "RMS": "root mean square",
    "max": "maximum",
}


def fuse(code: int, volumes: Volume) -> Volume:
    """Fuses (C, N, H, W) votes of C cameras to (N, H, W) float32 by the compiled code."""
    cameras, planes, height, width = volumes.shape
    votes = np.ascontiguousarray(volumes, np.float32).reshape(cameras, planes, height * width)
    out = np.empty((planes, height, width), np.float32)
    fuse_kernels.fuse(code, votes, out)
    return out


def _fusion(code: int) -> Callable[[Volume], Volume]:
    return lambda volumes: fuse(code, volumes)


# name -> function of (C, N, H, W) votes. For every voxel (paper, Eq. 1):
# min <= H <= G <= A <= RMS <= max
FUSIONS: dict[str, Callable[[Volume], Volume]] = {
    name: _fusion(code) for name, code in _CODES.items()
}


@dataclass(frozen=True)
class Method:
    """One way from the cameras' votes to one volume.

    Attributes:
        name: as the paper names it, such as `Alg1/H` or `EMVS/cam0`.
        code: the compiled fusion.
        summary: what it does, in a few words.
    """

    name: str
    code: int
    summary: str

    @property
    def file_name(self) -> str:
        """The name as files carry it."""
        return file_name(self.name)


def file_name(method: str) -> str:
    """Returns a method's name as files carry it."""
    return method.replace("/", "-")


def known_methods(n_cameras: int, *, reference: bool = False) -> tuple[Method, ...]:
    """Lists every method that `n_cameras` allow; with one camera there is nothing to fuse.

    Args:
        n_cameras: cameras of the rig.
        reference: the compatibility setting, whose H is 2ab / (a + b + 0.1).
    """
    codes = _CODES | ({"H": fuse_kernels.HARMONIC_EPS} if reference else {})
    fused = tuple(
        Method(f"Alg1/{name}", code, f"fused across cameras by the {_MEANS[name]}")
        for name, code in codes.items()
    )
    single = tuple(
        Method(f"EMVS/cam{c}", fuse_kernels.CAMERA + c, f"camera {c} alone")
        for c in range(n_cameras)
    )
    return fused + single if n_cameras > 1 else single


def methods(names: Sequence[str], n_cameras: int, *, reference: bool = False) -> tuple[Method, ...]:
    """Looks methods up by name.

    Args:
        names: method names; `all` stands for every method that the rig allows.
        n_cameras: cameras of the rig.
        reference: the compatibility setting.

    Returns:
        The methods, in the order of `known_methods`, each once.

    Raises:
        InputError: a name that is not known for this number of cameras, or H in the compatibility
            setting with other than two cameras.
    """
    known = known_methods(n_cameras, reference=reference)
    available = ", ".join(method.name for method in known)
    for name in names:
        if name != "all" and name not in {method.name for method in known}:
            raise InputError(
                f"unknown method {name!r} for {n_cameras} camera(s): choose from {available} or all"
            )
    chosen = tuple(method for method in known if "all" in names or method.name in names)
    if n_cameras != 2 and any(method.code == fuse_kernels.HARMONIC_EPS for method in chosen):
        raise InputError(
            f"Alg1/H in the mcemvs setting fuses 2 cameras, this rig has {n_cameras}: "
            "choose other methods or compatibility none"
        )
    return chosen
