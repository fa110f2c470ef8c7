"""Fronts of buildings: windows, doors, shops, garages, and the doors and boards of corridors."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.noise import Colour, Field, Image, finish, fractal
from eventsweep.scenes.textures.printing import words, write
from eventsweep.scenes.textures.surfaces import bricks, plaster

Rect = tuple[int, int, int, int]  # left, top, right, bottom, px


@dataclass(frozen=True)
class Front:
    """How the front of a house looks.

    Attributes:
        floors: storeys.
        bays: windows in a row.
        wall: mean colour of the plaster.
        trim: colour of frames, sills and bands.
        brick: whether the wall is of bricks instead.
        shop: whether the ground floor is a row of shop windows.
    """

    floors: int
    bays: int
    wall: Colour
    trim: Colour = (0.86, 0.84, 0.8)
    brick: bool = False
    shop: bool = False


def facade(shape: tuple[int, int], rng: Generator, front: Front) -> Image:
    """Builds the front of a house: one picture for the whole wall, ground at the last row."""
    height, width = shape
    wall = _wall(shape, rng, front)
    storey, bay = height / front.floors, width / front.bays
    for floor in range(front.floors):
        top = round(floor * storey)
        ground = floor == front.floors - 1
        if floor:
            wall[top - max(2, height // 220) : top] = np.asarray(front.trim) * 0.85
        if ground and front.shop:
            _shops(wall, rng, (0, top, width, height), front)
            continue
        door = int(rng.integers(front.bays)) if ground else -1
        for k in range(front.bays):
            left, low = round(k * bay), round((floor + 1) * storey)
            rect = (left + round(0.26 * bay), top + round(0.2 * storey))
            if k == door:
                _door(wall, rng, (*rect, left + round(0.74 * bay), low), front)
            else:
                _window(
                    wall, rng, (*rect, left + round(0.74 * bay), low - round(0.2 * storey)), front
                )
    streaks = 0.86 + 0.28 * fractal(shape, rng, 1.2, stretch=(4.0, 1.0))
    return finish(wall * streaks[..., None])


def _wall(shape: tuple[int, int], rng: Generator, front: Front) -> Field:
    if front.brick:
        courses = 2 * round(front.floors * 16)
        return bricks(shape, rng, courses, max(4, front.bays * 6)).astype(np.float32) / 255.0
    red, green, blue = front.wall
    low, high = ((k * red, k * green, k * blue) for k in (0.8, 1.15))
    return plaster(shape, rng, (low, high), relief=0.5).astype(np.float32) / 255.0


def _window(wall: Field, rng: Generator, rect: Rect, front: Front) -> None:
    left, top, right, bottom = rect
    frame = max(2, (right - left) // 14)
    wall[top - frame : bottom + frame, left - frame : right + frame] = front.trim
    _glass(wall, rng, (left, top, right, bottom))
    middle = (left + right) // 2
    bar = max(1, frame // 2)
    wall[top:bottom, middle - bar : middle + bar] = front.trim
    if rng.random() < 0.6:
        row = top + (bottom - top) // 3
        wall[row - bar : row + bar, left:right] = front.trim
    # The sill is bright and throws a shadow.
    wall[bottom + frame : bottom + 2 * frame, left - 2 * frame : right + 2 * frame] = front.trim
    wall[bottom + 2 * frame : bottom + 3 * frame, left - frame : right + frame] *= 0.55


def _glass(wall: Field, rng: Generator, rect: Rect) -> None:
    """Dark panes with a gleam, some with curtains or a blind half down."""
    left, top, right, bottom = rect
    rows, columns = bottom - top, right - left
    down = np.linspace(0, 1, rows, dtype=np.float32)[:, None]
    across = np.linspace(0, 1, columns, dtype=np.float32)[None]
    pane = 0.12 + 0.2 * np.clip(1.2 - down - 0.6 * across, 0, 1)
    pane = pane[..., None] * np.asarray((0.85, 0.95, 1.1), np.float32)
    style = rng.random()
    if style < 0.4:
        folds = 0.62 + 0.12 * np.sin(40 * across) * np.ones_like(down)
        side = (np.abs(across - 0.5) > rng.uniform(0.25, 0.4)) * np.ones_like(down)
        pane = np.where(side[..., None] > 0, folds[..., None], pane)
    elif style < 0.65:
        slats = 0.6 + 0.16 * np.sign(np.sin(60 * down)) * np.ones_like(across)
        pane = np.where((down < rng.uniform(0.3, 0.8))[..., None], slats[..., None], pane)
    wall[top:bottom, left:right] = pane


def _door(wall: Field, rng: Generator, rect: Rect, front: Front) -> None:
    left, top, right, bottom = rect
    frame = max(2, (right - left) // 12)
    wall[top - frame : bottom, left - frame : right + frame] = front.trim
    colour = np.asarray(((0.2, 0.28, 0.22), (0.36, 0.16, 0.14), (0.2, 0.24, 0.36))[rng.integers(3)])
    wall[top:bottom, left:right] = colour
    pane = top + (bottom - top) // 6
    _glass(wall, rng, (left + frame, top + frame, right - frame, pane))
    for k in range(2):
        low = pane + frame + k * (bottom - pane) // 2
        high = pane + (k + 1) * (bottom - pane) // 2 - frame
        wall[low:high, left + 2 * frame : right - 2 * frame] = colour * 1.35


def _shops(wall: Field, rng: Generator, rect: Rect, front: Front) -> None:
    """Shop windows with goods behind them under sign boards."""
    left, top, right, bottom = rect
    count = max(1, front.bays // 2)
    board = (bottom - top) // 5
    for k in range(count):
        x0, x1 = (left + (right - left) * (k + e) // count for e in (0, 1))
        pad = max(3, (x1 - x0) // 24)
        colour = rng.uniform(0.15, 0.5, 3)
        wall[top + pad : bottom, x0 + pad // 2 : x1 - pad // 2] = colour * 0.7
        wall[top + pad : top + board, x0 + pad : x1 - pad] = colour
        _lettering(wall, (x0 + 2 * pad, top + pad, x1 - 2 * pad, top + board), rng)
        pane = (x0 + pad, top + board + pad, x1 - pad, bottom - board // 2)
        _glass(wall, rng, pane)
        _goods(wall, rng, pane)


def _lettering(wall: Field, rect: Rect, rng: Generator) -> None:
    left, top, right, bottom = rect
    mask = np.zeros((bottom - top, right - left), np.uint8)
    text = words(rng, 1)[0].upper()[:8]
    write(mask, text, 4, round(0.75 * len(mask)), round(0.5 * len(mask)), bold=True)
    amount = mask[..., None].astype(np.float32) / 255.0
    wall[top:bottom, left:right] = wall[top:bottom, left:right] * (1 - amount) + 0.9 * amount


def _goods(wall: Field, rng: Generator, rect: Rect) -> None:
    left, top, right, bottom = rect
    for _ in range(14):
        w, h = (round(rng.uniform(0.05, 0.16) * side) for side in (right - left, bottom - top))
        x = int(rng.integers(left, max(left + 1, right - w)))
        y = bottom - h - round(rng.choice((0.0, 0.3)) * (bottom - top))
        wall[y : y + h, x : x + w] = rng.uniform(0.15, 0.75, 3)


def door_leaf(shape: tuple[int, int], rng: Generator, colour: Colour) -> Image:
    """Hangs an office door: frame, leaf, a narrow pane, handle, and a plate with a number."""
    height, width = shape
    picture = np.empty((*shape, 3), np.float32)
    picture[:] = 0.66
    frame = width // 14
    picture[frame:, frame : width - frame] = np.asarray(colour) * (
        0.9 + 0.2 * fractal(shape, rng, 0.8, stretch=(12.0, 1.0))[frame:, frame:-frame, None]
    )
    _glass(picture, rng, (int(0.68 * width), height // 8, int(0.82 * width), int(0.55 * height)))
    knob = (int(0.16 * width), int(0.54 * height))
    cv2.rectangle(picture, knob, (knob[0] + width // 7, knob[1] + height // 70), (0.8,) * 3, -1)
    cv2.circle(picture, (knob[0], knob[1] + height // 30), width // 50, (0.25,) * 3, -1)
    mask = np.zeros(shape, np.uint8)
    write(mask, str(rng.integers(100, 400)), int(0.2 * width), int(0.2 * height), height // 22)
    picture[mask > 100] = 0.2
    return finish(picture)


def lockers(shape: tuple[int, int], rng: Generator, columns: int, colour: Colour) -> Image:
    """Stands a row of lockers in two tiers: doors with slots and handles, seamless across."""
    height, width = shape
    picture = np.asarray(colour, np.float32) * np.ones((*shape, 1), np.float32)
    for k in range(columns):
        x0, x1 = width * k // columns, width * (k + 1) // columns
        for y0, y1 in ((0, height // 2), (height // 2, height)):
            picture[y0:y1, x0:x1] *= rng.uniform(0.88, 1.1)
            cv2.rectangle(picture, (x0 + 1, y0 + 2), (x1 - 2, y1 - 3), (0.16,) * 3, 2)
            for slot in range(4):
                y = y0 + (y1 - y0) // 10 + slot * (y1 - y0) // 26
                cv2.line(picture, (x0 + (x1 - x0) // 4, y), (x1 - (x1 - x0) // 4, y), (0.2,) * 3, 2)
            y = (y0 + y1) // 2
            x = x1 - (x1 - x0) // 6
            cv2.rectangle(picture, (x - 3, y - 9), (x + 3, y + 9), (0.75,) * 3, -1)
    return finish(picture * (0.88 + 0.24 * fractal(shape, rng, 1.1))[..., None])


def picket_row(shape: tuple[int, int], rng: Generator, pickets: int) -> Image:
    """Paints weathered boards side by side with dark gaps, seamless across."""
    height, width = shape
    across = np.arange(width, dtype=np.float32) / width * pickets
    board = across.astype(np.int64) % pickets
    gap = (across % 1.0) < 0.1
    shade = rng.uniform(0.5, 0.78, pickets).astype(np.float32)[board]
    grain = 0.8 + 0.4 * fractal(shape, rng, 0.7, stretch=(16.0, 1.0))
    tone = np.broadcast_to(np.where(gap, 0.06, shade), (height, width)) * grain
    return finish(tone[..., None] * np.asarray((1.0, 0.92, 0.8), np.float32))


def checker(shape: tuple[int, int], rng: Generator, count: int, wear: float = 0.12) -> Image:
    """Lays count × count slabs of black and white, worn a little; `count` is even to tile."""
    down, across = np.indices(shape)
    parity = (down * count // shape[0] + across * count // shape[1]) % 2
    return finish(0.16 + 0.6 * parity + wear * (fractal(shape, rng, 0.9) - 0.5))
