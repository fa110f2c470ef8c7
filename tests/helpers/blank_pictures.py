"""Suites and pages with blank pictures: most tests ask for numbers, and drawing takes longer."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure

_PLACE = "eventsweep.eval.report.suite_pictures"
_PIXEL = cv2.imencode(".png", np.zeros((1, 1, 3), np.uint8))[1].tobytes()


@contextmanager
def blank_pictures() -> Iterator[None]:
    """Pictures of cases are written, but empty; there are none of methods."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"{_PLACE}.overview_png", lambda *_, **__: b"")
        patch.setattr(f"{_PLACE}.method_pictures", lambda *_: {})
        yield


@contextmanager
def blank_figures() -> Iterator[None]:
    """Figures are made, and stored as an empty picture."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eventsweep.eval.figures.laid_out.LaidOutFigure.savefig", _save_blank)
        yield


@contextmanager
def drawn_figures() -> Iterator[None]:
    """Figures as they are, within a module of blank ones."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eventsweep.eval.figures.laid_out.LaidOutFigure.savefig", Figure.savefig)
        yield


def _save_blank(_figure: object, target: Any, **_settings: object) -> None:
    if isinstance(target, io.StringIO):
        target.write('<svg width="1" height="1"></svg>')
    elif isinstance(target, io.BytesIO):
        target.write(_PIXEL)
    else:
        Path(target).write_bytes(_PIXEL)
