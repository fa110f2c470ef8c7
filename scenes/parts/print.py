"""Print that only laboratories need: a calibration target and a whiteboard."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.cubes import cube
from eventsweep.scenes.textures.noise import Image, finish, fractal
from eventsweep.scenes.textures.printing import chart, paragraph, words, write
from eventsweep.scenes.textures.surfaces import cardboard

_PENS = ((0.4, 0.4, 0.43), (0.36, 0.44, 0.64), (0.68, 0.4, 0.38))


def apriltags(size_px: int, rng: Generator, count: int = 5) -> Image:
    """Prints a grid of count × count square tags with black corners between them.

    The codes are random: it looks like a calibration target, but no detector knows it.
    """
    cells = 10 * count + 2 * (count + 1)
    grid = np.ones((cells, cells), np.float32)
    for row in range(count + 1):
        for column in range(count + 1):
            top, left = 12 * row, 12 * column
            grid[top : top + 2, left : left + 2] = 0
            if row < count and column < count:
                tag = grid[top + 3 : top + 11, left + 3 : left + 11]
                tag[:] = 0
                tag[1:7, 1:7] = rng.integers(0, 2, (6, 6))
    printed = cv2.resize(grid, (size_px, size_px), interpolation=cv2.INTER_NEAREST)
    shade = 0.97 + 0.06 * fractal((size_px, size_px), rng, 1.4)
    return finish((0.2 + 0.5 * printed) * shade)


def whiteboard(shape: tuple[int, int], rng: Generator) -> Image:
    """Writes on a whiteboard: a diagram, a plot and some lines, with much empty space."""
    height, width = shape
    inks = [np.zeros(shape, np.uint8) for _ in range(3)]
    write(inks[0], words(rng, 1)[0].title(), width // 16, height // 8, height // 16, bold=True)
    box = (width // 16, height // 6, int(0.42 * width), int(0.5 * height))
    paragraph(inks[0], box, height // 34, rng)
    chart(inks[1], (int(0.6 * width), int(0.14 * height), int(0.92 * width), height // 2), rng)
    _boxes_and_arrows(inks[2], rng)
    board = np.full((*shape, 3), 0.92, np.float32) - 0.05 * fractal(shape, rng, 1.6)[..., None]
    for ink, colour in zip(inks, _PENS, strict=True):
        amount = ink[..., None].astype(np.float32) / 255.0
        board = board * (1 - amount) + np.asarray(colour, np.float32) * amount
    rim = np.minimum(
        *np.meshgrid(*(np.minimum(np.arange(n), np.arange(n)[::-1]) for n in shape), indexing="ij")
    )
    board[rim < height // 45] = 0.66
    return finish(board)


def plain_carton(size_px: int, rng: Generator) -> Image:
    """Folds a cardboard box as a cube map: tape across the top, one word on two sides."""
    shape = (size_px, size_px)
    faces = [cardboard(shape, rng) for _ in range(3)]
    faces = [0.5 * face + 0.5 * face.mean(axis=(0, 1)) for face in faces]
    tape = slice(int(0.43 * size_px), int(0.57 * size_px))
    faces[2][tape] = 0.6 * faces[2][tape] + 0.22
    ink = np.zeros(shape, np.uint8)
    word = words(rng, 1)[0].upper()[:6]
    write(ink, word, size_px // 7, int(0.6 * size_px), size_px // 7, bold=True)
    amount = 0.6 * ink[..., None].astype(np.float32) / 255.0
    front = finish(faces[0] * (1 - amount) + 0.2 * amount)
    side, top = finish(faces[1]), finish(faces[2])
    return cube(front, side, front, side, top, top)


def _boxes_and_arrows(ink: np.ndarray, rng: Generator) -> None:
    height, width = ink.shape
    row = int(0.72 * height)
    half = (width // 16, height // 14)
    for k in range(4):
        x = int((0.14 + 0.22 * k) * width)
        y = row + int(rng.uniform(-0.06, 0.06) * height)
        cv2.rectangle(ink, (x - half[0], y - half[1]), (x + half[0], y + half[1]), 255, 2)
        write(ink, words(rng, 1)[0][:5], x - half[0] + 8, y + 6, height // 40)
        if k:
            start = (x - int(0.22 * width) + half[0] + 4, row)
            cv2.arrowedLine(ink, start, (x - half[0] - 4, y), 255, 2, cv2.LINE_AA)
