"""Every kernel translated for a GPU, without one: run by `test_cuda_ptx.py`, which says how.

The simulator runs kernels as Python and sees neither types nor what the GPU's compiler refuses.
Prints one line of JSON: kernel -> the machine code (PTX) that it becomes.
"""

import json
import sys
from types import SimpleNamespace

from numba import cuda, types
from numba.cuda import dispatcher

from eventsweep.plugins.cuda import (
    arrays_kernels,
    focus_kernels,
    fusion_kernels,
    rays_kernels,
    voting_kernels,
)

CC = (9, 0)  # of an H200

F4, F8, I2, I4, I8 = types.float32, types.float64, types.int16, types.int32, types.int64
U1, U2 = types.uint8, types.uint16

IMAGES, MATRIX, VOLUMES = F4[:, ::1], F8[:, ::1], F4[:, :, ::1]
SLOTS, CODES, WHICH = I8[:, ::1], I8[:, ::1], I8[:, :, :, ::1]
SIZE, TALLIES = (I8, I8), (SLOTS, SLOTS)
STATE = (IMAGES, IMAGES, IMAGES)


def signatures():
    """Kernel -> the types of its arguments, one for each use that differs."""
    for name, sums, more in (
        ("vote_fixed", I8, (I8,)), ("vote_nearest", I4, ()),
    ):  # fmt: skip
        yield name, voting_kernels, (IMAGES, F4[::1], *SIZE, *more, sums[:, ::1], *TALLIES)
    yield "settle_fixed", voting_kernels, (I8[:, ::1], IMAGES, I8, SLOTS)
    yield "settle_nearest", voting_kernels, (I4[:, ::1], IMAGES)
    yield "rays", rays_kernels, (
        U2[::1], U2[::1], I8[::1], F8[:, :, ::1], I8[::1], MATRIX, MATRIX, MATRIX, F8[::1], MATRIX,
        MATRIX, IMAGES, SLOTS,
    )  # fmt: skip
    yield "count_events", rays_kernels, (U2[::1], U2[::1], U1[::1], I4[:, :, ::1])
    for index in (I2, I4):
        state = (IMAGES, index[:, ::1], *STATE)
        yield "fold", fusion_kernels, (CODES, CODES, WHICH, VOLUMES, I8, I8, *state)
    yield "fuse", fusion_kernels, (CODES, CODES, WHICH, I8, VOLUMES, I8, IMAGES)
    yield "keep_row", fusion_kernels, (VOLUMES, I8, I8, I8, I8, VOLUMES)
    yield "sharpness", focus_kernels, (I8, IMAGES, I8, IMAGES)
    yield "blur", focus_kernels, (IMAGES, F4[::1], I8, I8, I8, IMAGES)
    yield "spread", focus_kernels, (IMAGES, IMAGES)
    yield "subtract", focus_kernels, (IMAGES, IMAGES)
    for item in (F4, I2, I4, I8):
        yield "fill", arrays_kernels, (item[:, ::1], item)


def translated():
    """Kernel and types -> PTX."""
    # What kernels call is translated for the GPU at hand, which is not there.
    dispatcher.get_current_device = lambda: SimpleNamespace(compute_capability=CC)
    return {
        f"{name} {k}": cuda.compile_ptx(getattr(module, name).py_func, given, cc=CC)[0]
        for k, (name, module, given) in enumerate(signatures())
    }


if __name__ == "__main__":
    sys.stdout.write(json.dumps(translated()))
