"""Ways in which orientations are misread: left-handed frames, orders of Euler angles, their units.

Each function gives what the poses would be had they been read otherwise. A world's own axes are a
convention without effect, so a left-handed world needs one mirror, and its body 24 axes.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from functools import partial
from itertools import permutations, product

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.plugins.diagnose.check import limits

Floats = NDArray[np.float64]
Reread = Callable[[Trajectory], Trajectory]
_MIRROR = np.diag([-1.0, 1.0, 1.0])
_ORDERS = tuple("".join(order) for order in permutations("xyz"))


def signed_axes(*, right_handed: bool) -> list[Floats]:
    """The 24 right-handed or left-handed choices of axes, as (3, 3) signed permutations."""
    axes = [
        np.eye(3)[:, list(order)] * signs
        for order in permutations(range(3)) for signs in product((1.0, -1.0), repeat=3)
    ]  # fmt: skip
    return [R + 0.0 for R in axes if (np.linalg.det(R) > 0) == right_handed]


def axes_words(R_cam_given: Floats) -> str:
    """Where x, y and z of the poses point, seen from the camera."""
    words = (("left", "right"), ("up", "down"), ("back", "ahead"))
    at = np.abs(R_cam_given).argmax(axis=0)
    return " ".join(words[k][int(R_cam_given[k, column] > 0)] for column, k in enumerate(at))


def rereadings(poses: Trajectory) -> Iterator[tuple[str, Reread, str]]:
    """Names, what the poses would be, and cures, of the misreadings that can give such poses."""
    for R_given_body in signed_axes(right_handed=False):
        columns = R_given_body.astype(int).tolist()
        yield (
            f"left-handed poses, axes {axes_words(R_given_body.T)}",
            partial(_right_handed, R_given_body),
            "the poses are left-handed, as Unity and Unreal have: write R as M R B and t as M t, "
            f"with M = diag(-1, 1, 1) and B = {columns}",
        )  # fmt: skip
    for axes in ("x", "y", "z", "xy", "xz", "yz"):  # all three: a left-handed body
        which = " and ".join(axes)
        yield (
            f"{which} of the positions negated", partial(_negated, axes),
            f"change the sign of {which} in the positions: R and t refer to different worlds",
        )  # fmt: skip
    turns = Rotation.from_quat(poses.quats_xyzw)
    turned_rad = (turns[0].inv() * turns).magnitude().max()
    if turned_rad >= limits.LEAST_OF_ORDERS:
        for order, other in permutations(_ORDERS, 2):
            yield (
                f"Euler angles {order} read as {other}", partial(_reordered, order, other),
                f"the angles turn about {', then '.join(order)} (fixed axes), but were converted "
                f"to rotations as if about {', then '.join(other)}: convert them again in their "
                "own order",
            )  # fmt: skip
    possible = turns.magnitude().max() <= limits.MOST_AS_DEGREES
    for unit, other, change, is_possible in (
        ("radians", "degrees", _magnified, possible),
        ("degrees", "radians", _reduced, turned_rad >= limits.LEAST_AS_RADIANS),
    ):
        for order in _ORDERS if is_possible else ():
            yield (
                f"Euler angles {order} in {unit} read as {other}", partial(change, order),
                f"the angles are in {unit}, but were converted to rotations as {other}: convert "
                "them again",
            )  # fmt: skip


def _right_handed(R_given_body: Floats, poses: Trajectory) -> Trajectory:
    R = _MIRROR @ Rotation.from_quat(poses.quats_xyzw).as_matrix() @ R_given_body
    return _with(poses, Rotation.from_matrix(R), poses.positions_m @ _MIRROR)


def _negated(axes: str, poses: Trajectory) -> Trajectory:
    signs = [-1.0 if axis in axes else 1.0 for axis in "xyz"]
    return Trajectory(poses.t_us, poses.positions_m * signs, poses.quats_xyzw)


def _reordered(order: str, other: str, poses: Trajectory) -> Trajectory:
    angles = _angles(other, poses)[:, [other.index(axis) for axis in order]]
    return _with(poses, Rotation.from_euler(order, angles))


def _magnified(order: str, poses: Trajectory) -> Trajectory:
    return _with(poses, Rotation.from_euler(order, np.degrees(_angles(order, poses))))


def _reduced(order: str, poses: Trajectory) -> Trajectory:
    """Angles are known up to full turns: followed from pose to pose, from the smallest on."""
    angles = _angles(order, poses)
    flipped = angles * (1, -1, 1) + np.pi  # the same rotations
    changes = _step(flipped[1:] - angles[:-1]) < _step(angles[1:] - angles[:-1])
    is_flipped = np.r_[False, np.logical_xor.accumulate(changes)]
    followed = np.unwrap(np.where(is_flipped[:, None], flipped, angles), axis=0)
    return _with(poses, Rotation.from_euler(order, np.radians(followed)))


def _step(difference: Floats) -> Floats:
    """(N,) how far (N, 3) angles are apart, whole turns aside."""
    return np.asarray(np.abs((difference + np.pi) % (2 * np.pi) - np.pi).sum(axis=1))


def _angles(order: str, poses: Trajectory) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # two axes in line: any of the equal angles will do
        return np.asarray(Rotation.from_quat(poses.quats_xyzw).as_euler(order))


def _with(poses: Trajectory, turns: Rotation, positions_m: Floats | None = None) -> Trajectory:
    where = poses.positions_m if positions_m is None else positions_m
    return Trajectory(poses.t_us, where, turns.as_quat())
