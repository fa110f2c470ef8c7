"""The compiled loop that unpacks LZF, the compression of PCD files."""

# Numba annotations would be `Any` throughout; shapes and types stand in the docstrings instead.
# mypy: disable-error-code="no-untyped-def, no-untyped-call, no-any-return, call-arg"

from numba import njit

import eventsweep.emvs.utils.runtime  # noqa: F401  (names threads and cache before kernels compile)


@njit(cache=True, nogil=True)
def unpacked(packed, out):
    """Whether LZF data fill `out` exactly; both (bytes,) uint8.

    A control byte below 32 is followed by one byte more than it says, as they are; another says how
    many earlier ones are repeated, and from how far back.
    """
    at, to = 0, 0
    while at < len(packed):
        control = int(packed[at])
        at += 1
        if control < 32:
            count = control + 1
            if at + count > len(packed) or to + count > len(out):
                return False
            for k in range(count):
                out[to + k] = packed[at + k]
            at += count
        else:
            count = control >> 5
            if count == 7:
                if at >= len(packed):
                    return False
                count += int(packed[at])
                at += 1
            count += 2
            if at >= len(packed):
                return False
            back = to - ((control & 31) << 8) - int(packed[at]) - 1
            at += 1
            if back < 0 or to + count > len(out):
                return False
            for k in range(count):
                out[to + k] = out[back + k]
        to += count
    return to == len(out)
