"""Late fusion: the single cameras' depth maps joined, a baseline for the fusion of volumes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from emvs.depthmap import DepthMap

Value = TypeVar("Value", bound=np.generic)


def union(method: str, maps: Sequence[DepthMap]) -> DepthMap:
    """Takes each pixel from the most confident camera among those that report it.

    Where none reports it, the mask stays empty, and the values are the most confident camera's.
    Of equally confident cameras the first is taken.

    Args:
        method: name for the result.
        maps: one per camera, in the same reference view.
    """
    masks = np.stack([one.mask for one in maps])
    confidence = np.stack([one.confidence for one in maps])
    reported = np.where(masks | ~masks.any(axis=0), confidence, -1)
    camera = reported.argmax(axis=0)[None]
    return replace(
        maps[0],
        method=method,
        depth_m=_pick([one.depth_m for one in maps], camera),
        confidence=_pick([one.confidence for one in maps], camera),
        argmax=_pick([one.argmax for one in maps], camera),
        mask=np.logical_or.reduce(masks),
    )


def _pick(images: Sequence[NDArray[Value]], camera: NDArray[np.intp]) -> NDArray[Value]:
    picked: NDArray[Value] = np.take_along_axis(np.stack(images), camera, axis=0)[0]
    return picked
