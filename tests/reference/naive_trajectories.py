"""Slow twins of trajectory scores, each derived another way than in the product."""

import numpy as np


def one_to_one(truth_us, estimate_us, most_us):
    """All pairs sorted by difference, then taken one by one, as `associate.py` does it."""
    every = sorted(
        (abs(int(e) - int(g)), j, i)
        for j, e in enumerate(estimate_us)
        for i, g in enumerate(truth_us)
        if abs(int(e) - int(g)) <= most_us
    )
    truths, estimates, pairs = set(), set(), []
    for _, j, i in every:
        if j not in estimates and i not in truths:
            estimates.add(j)
            truths.add(i)
            pairs.append((i, j))
    return sorted(pairs, key=lambda pair: pair[1])


def nearest(truth_us, estimate_us, most_us):
    """The nearest of the longer one for each pose of the shorter, by looking at all of them."""
    if len(estimate_us) > len(truth_us):
        return [(i, j) for j, i in nearest(estimate_us, truth_us, most_us)]
    pairs = []
    for j, e in enumerate(estimate_us):
        gaps = [abs(int(g) - int(e)) for g in truth_us]
        if min(gaps) <= most_us:
            pairs.append((gaps.index(min(gaps)), j))
    return pairs


def horn(points_a, points_b, *, with_scale):
    """Horn (JOSA A 4, 1987): the rotation is the eigenvector of a matrix of quaternions."""
    a, b = points_a - points_a.mean(axis=0), points_b - points_b.mean(axis=0)
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = b.T @ a
    N = np.array([
        [xx + yy + zz, yz - zy, zx - xz, xy - yx],
        [yz - zy, xx - yy - zz, xy + yx, zx + xz],
        [zx - xz, xy + yx, -xx + yy - zz, yz + zy],
        [xy - yx, zx + xz, yz + zy, -xx - yy + zz],
    ])  # fmt: skip
    w, x, y, z = np.linalg.eigh(N)[1][:, -1]
    R = np.array([
        [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
    ])  # fmt: skip
    scale = np.sum(a * (b @ R.T)) / np.sum(b * b) if with_scale else 1.0
    return scale, R, points_a.mean(axis=0) - scale * R @ points_b.mean(axis=0)


def angle_deg(R):
    """By the trace and the antisymmetric part."""
    axis = np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
    return np.degrees(np.arctan2(np.linalg.norm(axis), np.trace(R) - 1))


def steps(progress, length):
    """The end of each step, by looking at all later poses."""
    found = []
    for i, begin in enumerate(progress):
        best, off = -1, 0.2 * length
        for j in range(i, len(progress)):
            if abs(progress[j] - (begin + length)) < off:
                best, off = j, abs(progress[j] - (begin + length))
        if best >= 0:
            found.append((i, best))
    return found


def relative(T_world, T_odom, pairs, scale=1.0):
    """Errors of translation and rotation of each step, pose by pose."""
    translation, rotation = [], []
    for i, j in pairs:
        true = np.linalg.inv(T_world[i]) @ T_world[j]
        estimated = np.linalg.inv(T_odom[i]) @ T_odom[j]
        estimated[:3, 3] *= scale
        error = np.linalg.inv(true) @ estimated
        translation.append(np.linalg.norm(error[:3, 3]))
        rotation.append(angle_deg(error[:3, :3]))
    return np.array(translation), np.array(rotation)
