"""Rows of tables of scores, as tests write and read them."""

from eventsweep.eval.results.table import COLUMNS, each, tidy

NAMES = [name for name in COLUMNS if name != "seed"]


def score_row(*cells, **more):
    """One row: case, window, method, metric, value, unit, direction, and the rest by name."""
    return dict(zip(NAMES, cells, strict=False)) | more


def texts(rows):
    """A table or rows as text, row by row, in which NaN equals NaN."""
    return list(map(repr, each(tidy(rows))))
