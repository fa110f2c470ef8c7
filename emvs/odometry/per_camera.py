"""Does the same for every camera, each in a thread of its own: the kernels hold no lock."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Made = TypeVar("Made")


class PerCamera:
    """Calls a function of a camera's number for all cameras; results are in their order.

    Args:
        count: cameras.
        threads: most threads, the caller's own among them; 0 for one per camera.
    """

    def __init__(self, count: int, threads: int = 0) -> None:
        self._cameras = range(count)
        helpers = min(count, threads or count) - 1
        self._helpers = ThreadPoolExecutor(helpers, "camera") if helpers > 0 else None

    def __call__(self, work: Callable[[int], Made]) -> list[Made]:
        """What `work` returns for each camera; the first is done by the caller itself."""
        if self._helpers is None:
            return [work(camera) for camera in self._cameras]
        others = [self._helpers.submit(work, camera) for camera in self._cameras[1:]]
        return [work(0), *(other.result() for other in others)]
