"""Slow, plain twins of the methods: one voxel, one event at a time."""

import naive_sweep


def fuse(name, votes):
    """Fuses one voxel's votes by a method's name; votes[camera][interval], in float64."""
    algorithm, rest = name.split("/", 1)
    if algorithm == "Alg1":
        return naive_sweep.fuse(rest, [sum(camera) for camera in votes])
    if algorithm == "EMVS":
        return votes[int(rest.removeprefix("cam"))][0]
    composition = rest.split("@")[0]
    shuffled = rest.endswith("~")
    outer, inner = _functions(composition)
    intervals = len(votes[0])
    if inner[1] == "t":
        return naive_sweep.fuse(outer[0], [naive_sweep.fuse(inner[0], camera) for camera in votes])
    fused = []
    for k in range(intervals):
        other = (k + intervals // 2) % intervals if shuffled else k
        together = [votes[0][k], *(camera[other] for camera in votes[1:])]
        fused.append(naive_sweep.fuse(inner[0], together))
    return naive_sweep.fuse(outer[0], fused)


def _functions(composition):
    """`AtHc` to (("A", "t"), ("H", "c")): the outer function, then the inner one."""
    found = []
    while composition:
        for name in ("min", "max", "RMS", "H", "G", "A"):
            if composition.startswith(name):
                found.append((name, composition[len(name)]))
                composition = composition[len(name) + 1 :]
                break
        else:
            raise ValueError(composition)
    return found


def intervals(t_us, count, by, t0_us, t1_us):
    """The sub-interval of every event of a camera."""
    if by == "time":
        edges_us = [t0_us + k * (t1_us - t0_us) // count for k in range(count)]
        return [max(k for k in range(count) if edges_us[k] <= t or k == 0) for t in t_us]
    n = len(t_us)
    return [max(k for k in range(count) if k * n // count <= i) for i in range(n)]


def union(confidences, masks):
    """The camera that one pixel takes in late fusion, and whether the pixel is reported."""
    reporting = [k for k, mask in enumerate(masks) if mask] or range(len(masks))
    return max(reporting, key=lambda k: (confidences[k], -k)), any(masks)
