"""How far a stage is, and how long it took."""

import time
from collections.abc import Callable

# progress(stage, done, total)
Progress = Callable[[str, int, int], None]


def silent(_stage: str, _done: int, _total: int) -> None:
    """Shows no progress."""


class Stopwatch:
    """Wall time per stage.

    Attributes:
        seconds: stage -> s.
    """

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self._since = time.perf_counter()

    def lap(self, stage: str) -> None:
        """Books the time since the last lap on `stage`."""
        now = time.perf_counter()
        self.seconds[stage], self._since = now - self._since, now
