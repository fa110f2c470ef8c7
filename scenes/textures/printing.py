"""Print: pages of text, screens, posters, labels and charts."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from eventsweep.scenes.textures.noise import Colour, Field, Image, blend, finish, fractal

# fmt: off
_SYLLABLES = (
    "ra", "den", "si", "ty", "fu", "sion", "e", "vent", "ste", "re", "o", "ca", "me", "ra", "pla",
    "ne", "dis", "pa", "ri", "sweep", "vo", "xel", "pix", "el", "mo", "tion", "ba", "se", "li",
    "light", "con", "fi", "den", "ce", "map", "tra", "jec", "to", "po", "se", "edge", "time", "len",
)
# fmt: on

_PAPER: Colour = (0.86, 0.84, 0.79)
_INK: Colour = (0.13, 0.13, 0.16)


def words(rng: Generator, count: int) -> list[str]:
    """Makes up words that look like a language."""
    # The draws of `rng.choice`, which would make an array of all syllables for every word.
    drawn = (rng.integers(0, len(_SYLLABLES), size=rng.integers(1, 4)) for _ in range(count))
    return ["".join(_SYLLABLES[k] for k in word) for word in drawn]


def write(
    ink: NDArray[np.uint8], text: str, x: int, y: int, height: int, bold: bool = False
) -> int:
    """Writes one line into an ink mask.

    Args:
        ink: (H, W) uint8, 0 for paper and 255 for ink; written in place.
        text: what to write.
        x: left end, texels.
        y: base line, texels.
        height: height of a capital letter, texels.
        bold: doubles the stroke.

    Returns:
        The column after the last letter.
    """
    scale = height / 22.0
    stroke = max(1, round(height / 11)) * (2 if bold else 1)
    cv2.putText(ink, text, (x, y), cv2.FONT_HERSHEY_SIMPLEX, scale, 255, stroke, cv2.LINE_AA)
    (width, _), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)
    return x + int(width)


def paragraph(
    ink: NDArray[np.uint8], box: tuple[int, int, int, int], height: int, rng: Generator
) -> None:
    """Fills a box (left, top, right, bottom) with ragged lines of words."""
    left, top, right, bottom = box
    for y in range(top + height, bottom, round(1.9 * height)):
        line = " ".join(words(rng, 24))
        fits = int((right - left) / (0.92 * height) * rng.uniform(0.72, 1.0))
        write(ink, line[:fits], left, y, height)


def _frame(ink: NDArray[np.uint8], box: tuple[int, int, int, int], thick: int) -> None:
    cv2.rectangle(ink, box[:2], box[2:], 255, thick)


def chart(ink: NDArray[np.uint8], box: tuple[int, int, int, int], rng: Generator) -> None:
    """Draws a framed plot with a grid, bars and two curves."""
    left, top, right, bottom = box
    _frame(ink, box, 2)
    bars = rng.uniform(0.1, 0.85, 9)
    step = (right - left) / (len(bars) + 0.5)
    for k, bar in enumerate(bars):
        x = int(left + (k + 0.5) * step)
        y = int(bottom - bar * (bottom - top))
        cv2.rectangle(ink, (x, y), (int(x + 0.55 * step), bottom), int(rng.integers(70, 200)), -1)
    columns = np.linspace(left, right, 60)
    for _ in range(2):
        curve = np.cumsum(rng.standard_normal(60))
        curve = (curve - curve.min()) / np.ptp(curve)
        rows = bottom - (0.05 + 0.9 * curve) * (bottom - top)
        points = np.stack((columns, rows), axis=1).astype(np.int32)
        cv2.polylines(ink, [points], False, 255, 2, cv2.LINE_AA)


def _printed(ink: NDArray[np.uint8], paper: Field, colour: Colour) -> Field:
    amount = (ink.astype(np.float32) / 255.0)[..., None]
    return (paper * (1.0 - amount) + np.asarray(colour, np.float32) * amount).astype(np.float32)


def _paper(shape: tuple[int, int], rng: Generator, colour: Colour = _PAPER) -> Field:
    shade = 0.9 + 0.2 * fractal(shape, rng, 0.9)
    return np.asarray(colour, np.float32) * shade[..., None]


def page(shape: tuple[int, int], rng: Generator, lines: int = 46) -> Image:
    """Prints a page of an article: title, two columns, a figure.

    Args:
        shape: (H, W) in texels.
        rng: source of the text.
        lines: lines of body text on a full page; more lines are finer print.
    """
    height, width = shape
    ink = np.zeros(shape, np.uint8)
    letter = max(5, round(height / lines / 1.9))
    margin, gap = width // 12, width // 28
    middle = width // 2
    for k in range(2):
        title = " ".join(words(rng, 5)).title()
        write(ink, title, margin, margin + (2 + 3 * k) * letter, 2 * letter, bold=k == 0)
    top = margin + 8 * letter
    figure = int(rng.uniform(0.35, 0.6) * height)
    end = height - margin
    paragraph(ink, (margin, top, middle - gap, end), letter, rng)
    paragraph(ink, (middle + gap, top, width - margin, figure - 2 * letter), letter, rng)
    box = (middle + gap, figure, width - margin, min(figure + height // 5, end))
    chart(ink, box, rng)
    paragraph(ink, (middle + gap, box[3] + 2 * letter, width - margin, end), letter, rng)
    return finish(_printed(ink, _paper(shape, rng), _INK))


def screen(shape: tuple[int, int], rng: Generator) -> Image:
    """Shows windows on a monitor: an editor with indented lines, a plot and a document."""
    height, width = shape
    canvas = blend(fractal(shape, rng, 1.3), (0.12, 0.22, 0.36), (0.42, 0.52, 0.62))
    split, bar = int(0.56 * width), height // 22
    _window(canvas, (bar // 2, bar, split - bar // 2, height - bar), (0.2, 0.21, 0.24), rng, True)
    right = (split, bar, width - bar // 2, int(0.52 * height))
    _window(canvas, right, (0.8, 0.8, 0.78), rng, False, plot=True)
    right = (split, int(0.56 * height), width - bar // 2, height - bar)
    _window(canvas, right, (0.86, 0.85, 0.82), rng, False)
    return finish(canvas)


def _window(
    canvas: Field,
    box: tuple[int, int, int, int],
    ground: Colour,
    rng: Generator,
    code: bool,
    plot: bool = False,
) -> None:
    left, top, right, bottom = box
    title = max(10, (bottom - top) // 22)
    view = canvas[top:bottom, left:right]
    view[:] = ground
    view[:title] = (0.5, 0.52, 0.56)
    height, width = bottom - top, right - left
    ink = np.zeros((height, width), np.uint8)
    letter = max(6, canvas.shape[0] // 72)
    write(ink, " ".join(words(rng, 4)), title, int(0.75 * title), title // 2)
    if plot:
        chart(ink, (width // 10, 3 * title, width - width // 12, height - 2 * title), rng)
    elif code:
        _code(view, (2 * title, 2 * title, width - title, height - title), letter, rng)
    else:
        paragraph(ink, (title, 2 * title, width - title, height - title), letter, rng)
    view[:] = _printed(ink, view, (0.1, 0.1, 0.12))


def _code(view: Field, box: tuple[int, int, int, int], letter: int, rng: Generator) -> None:
    left, top, right, bottom = box
    palette: tuple[Colour, ...] = ((0.75, 0.75, 0.72), (0.45, 0.7, 0.8), (0.8, 0.6, 0.35))
    layers = [np.zeros(view.shape[:2], np.uint8) for _ in palette]
    indent = 0
    for y in range(top, bottom, round(1.9 * letter)):
        indent = int(np.clip(indent + rng.integers(-1, 2), 0, 4))
        x = left + indent * 3 * letter
        for word in words(rng, int(rng.integers(2, 10))):
            if x < right - 6 * letter:
                x = write(layers[int(rng.integers(3))], word, x, y, letter) + letter
    for layer, colour in zip(layers, palette, strict=True):
        view[:] = _printed(layer, view, colour)


def poster(shape: tuple[int, int], rng: Generator, colour: Colour, accent: Colour) -> Image:
    """Prints a poster: a landscape of ridges under a sun, a headline and small print."""
    height, width = shape
    sky = np.linspace(0.15, 1.0, height, dtype=np.float32)[:, None] * np.ones(
        (1, width), np.float32
    )
    canvas = blend(sky, colour, (0.88, 0.82, 0.7)) * (0.8 + 0.4 * fractal(shape, rng)[..., None])
    sun = np.zeros(shape, np.uint8)
    where = (int(rng.uniform(0.25, 0.75) * width), int(0.3 * height))
    cv2.circle(sun, where, width // 6, 255, -1, cv2.LINE_AA)
    canvas = _printed(sun, canvas, accent)
    for layer in range(4):
        canvas = _ridge(canvas, 0.42 + 0.11 * layer, 0.85 - 0.2 * layer, colour, rng)
    ink = np.zeros(shape, np.uint8)
    write(ink, words(rng, 1)[0].upper()[:7], width // 12, height // 8, width // 9, bold=True)
    bottom = np.zeros(shape, np.uint8)
    box = (width // 12, int(0.88 * height), width - width // 12, int(0.98 * height))
    paragraph(bottom, box, max(5, height // 70), rng)
    canvas = _printed(bottom, canvas, (0.85, 0.83, 0.78))
    return finish(_printed(ink, canvas, _INK))


def _ridge(canvas: Field, level: float, shade: float, colour: Colour, rng: Generator) -> Field:
    height, width, _ = canvas.shape
    crest = fractal((width, width), rng, 1.7)[0] - 0.5
    rows = np.arange(height, dtype=np.float32)[:, None] / height
    ground = (rows > level + 0.22 * crest[None, :]).astype(np.float32)
    soft = cv2.GaussianBlur(ground, (0, 0), 1.0)[..., None]
    rough = 0.6 + 0.8 * fractal((height, width), rng, 0.9)[..., None]
    return np.asarray(canvas * (1 - soft) + np.asarray(colour, np.float32) * shade * rough * soft)


def label(shape: tuple[int, int], rng: Generator, colour: Colour) -> Image:
    """Prints a product label: a coloured band, a name, small print and a bar code."""
    height, width = shape
    canvas = _paper(shape, rng)
    band = slice(int(0.16 * height), int(0.46 * height))
    canvas[band] = np.asarray(colour, np.float32) * (0.8 + 0.4 * fractal(shape, rng)[band, :, None])
    light, ink = np.zeros(shape, np.uint8), np.zeros(shape, np.uint8)
    write(light, words(rng, 1)[0].upper(), width // 14, int(0.37 * height), height // 9, bold=True)
    box = (width // 14, int(0.52 * height), int(0.6 * width), int(0.95 * height))
    paragraph(ink, box, max(5, height // 42), rng)
    count = min(48, int(0.3 * width))
    bars = np.repeat(rng.integers(0, 2, count), int(0.3 * width) // count)
    left = int(0.64 * width)
    ink[int(0.6 * height) : int(0.88 * height), left : left + len(bars)] = 255 * bars
    _frame(ink, (2, 2, width - 3, height - 3), max(2, height // 90))
    return finish(_printed(ink, _printed(light, canvas, (0.92, 0.9, 0.84)), _INK))
