"""Flags of the verbs that show their work in the Rerun viewer."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import check_output
from eventsweep.eval.cli.help import RARE

if TYPE_CHECKING:
    from eventsweep.eval.report.rerun import View


@Parameter(name="*")
@dataclass(frozen=True)
class ViewFlags:
    """Where to show what is made, while it is made."""

    view: Annotated[bool, Parameter(negative=()), RARE] = False
    "Show frames, events, depth and path in the Rerun viewer; needs eventsweep[rerun]."

    view_file: Annotated[Path | None, RARE] = None
    "Write what --view shows into this file, such as live.rrd; `rerun FILE` opens it."

    @contextmanager
    def opened(
        self, name: str, *, force: bool, axes: str = "RIGHT_HAND_Z_UP"
    ) -> Iterator[View | None]:
        """The viewer; None where none is asked for. Refuses what cannot be shown at once."""
        if self.view and self.view_file is not None:
            raise InputError("--view opens a window, --view-file writes a file: choose one")
        if not self.view and self.view_file is None:
            yield None
            return
        from eventsweep.eval.report.rerun import live_view

        if self.view_file is not None:
            check_output(self.view_file, force=force)
        with live_view(name, self.view_file, axes) as view:
            yield view


VIEW_FLAGS = ViewFlags()
