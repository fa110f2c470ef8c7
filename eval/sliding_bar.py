"""One bar for a run of sliding windows: windows done of all, and how far the present one is."""

from __future__ import annotations

from eval.progress import Update, mapping


class WindowsBar:
    """Takes what `emvs.sliding.map_windows` tells, and moves a bar that runs from 0 to 1."""

    def __init__(self, update: Update) -> None:
        self._update = update
        self._done, self._total = 0, 1

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Shows one step."""
        if stage in ("count", "hot pixels"):
            self._update(0.0, f"{stage} {done}/{total}")
        elif stage == "windows":
            self._done, self._total = done, max(total, 1)
            self._show(0.0)
        else:
            mapping(lambda share, _words: self._show(share))(stage, done, total)

    def _show(self, share: float) -> None:
        words = f"{self._done} of {self._total} windows"
        self._update((self._done + share) / self._total, words)
