"""Display on the error stream: a bar per stage with rate and remaining time, or silence."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, ExitStack, contextmanager
from types import TracebackType
from typing import TYPE_CHECKING, Protocol

from eventsweep.emvs.errors import one_line

if TYPE_CHECKING:
    from rich.console import Console as RichConsole

    from eventsweep.emvs.utils.runtime import Progress

Update = Callable[[float, str], None]
"""Takes how much of the stage's total is done, and a few words."""


class Display(Protocol):
    """Shows how far a run has come."""

    def stage(self, title: str, total: float) -> AbstractContextManager[Update]:
        """A context for one stage; yields the function that moves its bar."""

    def say(self, line: str) -> None:
        """Prints a line worth knowing."""


def _ignore(_done: float, _words: str) -> None:
    pass


class Silent:
    """Shows nothing."""

    @contextmanager
    def stage(self, _title: str, _total: float) -> Iterator[Update]:
        """Ignores every update."""
        yield _ignore

    def say(self, line: str) -> None:
        """Says nothing."""


SILENT = Silent()


class Bars:
    """A bar per stage while it runs, on a terminal, and one line when it is done.

    `wording` puts lines of the libraries into words for people; `console` draws, a `rich` one.
    """

    def __init__(
        self, wording: Callable[[str], str] = str, console: RichConsole | None = None
    ) -> None:
        self._wording, self._console = wording, console

    @contextmanager
    def stage(self, title: str, total: float) -> Iterator[Update]:
        """Draws one bar; a stage that fails leaves no line behind."""
        from rich import progress
        from rich.console import Console

        columns = (
            progress.TextColumn("{task.description:<16}", markup=False),
            progress.BarColumn(),
            progress.TaskProgressColumn(),
            progress.TimeElapsedColumn(),
            progress.TextColumn("left"),
            progress.TimeRemainingColumn(),
            progress.TextColumn("{task.fields[words]}", markup=False),
        )
        console = self._console or Console(stderr=True, highlight=False, markup=False)
        bars = progress.Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        with bars:
            title = one_line(title)
            task = bars.add_task(title, total=total, words="")
            yield lambda done, words: bars.update(task, completed=done, words=one_line(words))
        finished = bars.tasks[task]
        console.print(f"{title:<16} {finished.elapsed or 0:5.1f} s  {finished.fields['words']}")

    def say(self, line: str) -> None:
        """Prints the line on the error stream."""
        sys.stderr.write(f"{one_line(self._wording(line))}\n")


# How wall time divides among the stages, for one bar that moves evenly: where each begins, and its
# share. Methods without a volume come after the mapper's own.
_MAPPING_SHARES = {"rays": (0.0, 0.1), "sweep": (0.1, 0.9)}
_CHECKING_SHARES = {"events": (0.0, 0.2), "alternatives": (0.2, 0.8)}


def checking(update: Update) -> Progress:
    """Turns a check's progress, stage by stage, into the movement of one bar."""
    return _in_one_bar(update, _CHECKING_SHARES)


def _in_one_bar(update: Update, shares: Mapping[str, tuple[float, float]]) -> Progress:
    def show(stage: str, done: int, total: int) -> None:
        start, share = shares.get(stage, (1.0, 0.0))
        update(start + share * done / max(total, 1), f"{stage} {done}/{total}")

    return show


class MapBars:
    """Turns the progress of `emvs.maps.sliding.map_windows` into bars that run from 0 to 1.

    One bar for all sliding windows; or one for mapping a single window, then one for its files. To
    be used as a context.
    """

    def __init__(self, progress: Display, title: str) -> None:
        self._progress, self._stage = progress, ExitStack()
        self._next(title)
        self._windows: tuple[int, int] | None = None

    def __enter__(self) -> MapBars:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        self._stage.__exit__(kind, error, trace)

    def close(self) -> None:
        """Ends the present bar: what follows has its own."""
        self._stage.close()

    def __call__(self, stage: str, done: int, total: int) -> None:
        """Shows one step."""
        if stage in ("count", "hot pixels"):
            self._update(0.0, f"{stage} {done}/{total}")
        elif stage == "windows":
            self._windows = done, max(total, 1)
            self._show(0.0, "")
        elif stage == "write" and self._windows is None:
            self._next("write maps")
        else:
            _in_one_bar(self._show, _MAPPING_SHARES)(stage, done, total)

    def _next(self, title: str) -> None:
        self.close()
        self._update = self._stage.enter_context(self._progress.stage(title, 1))

    def _show(self, share: float, words: str) -> None:
        if self._windows is None:
            self._update(share, words)
            return
        done, total = self._windows
        self._update((done + share) / total, f"{done} of {total} windows")
