"""Whole objects: books, cartons, crates, cans, drums, toy blocks, keyboards; signs and cars."""

from __future__ import annotations

from itertools import pairwise

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.cubes import cube, wrap
from eventsweep.scenes.textures.noise import (
    BRIGHTEST,
    DARKEST,
    Colour,
    Field,
    Image,
    blend,
    finish,
    fractal,
)
from eventsweep.scenes.textures.printing import label, paragraph, words, write
from eventsweep.scenes.textures.surfaces import cardboard, wood


def book(size_px: int, rng: Generator, colour: Colour, accent: Colour) -> Image:
    """Binds a book as a cube map: spine in front, covers left and right, page edges elsewhere."""
    cover = _cover(size_px, rng, colour, accent)
    spine = _spine(size_px, rng, colour, accent)
    lines = fractal((size_px, size_px), rng, 0.35, stretch=(1.0, 30.0))
    edges = finish(blend(lines, (0.42, 0.38, 0.3), (0.95, 0.92, 0.84)))
    turned = np.ascontiguousarray(edges.swapaxes(0, 1))
    return cube(spine, cover, turned, cover, turned, turned)


def _tinted(size_px: int, rng: Generator, colour: Colour) -> Field:
    wear = 0.72 + 0.56 * fractal((size_px, size_px), rng, 0.8)
    return np.asarray(colour, np.float32) * wear[..., None]


def _ink(canvas: Field, mask: Image, colour: Colour) -> Field:
    amount = (mask.astype(np.float32) / 255.0)[..., None]
    return np.asarray(canvas * (1 - amount) + np.asarray(colour, np.float32) * amount)


def _spine(size_px: int, rng: Generator, colour: Colour, accent: Colour) -> Image:
    canvas = _tinted(size_px, rng, colour)
    for at in rng.choice([0.06, 0.1, 0.2, 0.8, 0.88, 0.94], 3, replace=False):
        row = int(at * size_px)
        canvas[row : row + max(2, size_px // 60)] = accent
    mask = np.zeros((size_px, size_px), np.uint8)
    strip = np.zeros((size_px // 7, size_px), np.uint8)
    title = " ".join(words(rng, 2)).upper()[:12]
    end = write(strip, title, 4, int(0.75 * len(strip)), int(0.55 * len(strip)), bold=True)
    # The face is square but a spine is narrow: tall letters on the face look right on the spine.
    rows, columns = (slice(int(k * size_px), int((1 - k) * size_px)) for k in (0.24, 0.22))
    mask = np.zeros((size_px, size_px), np.uint8)
    shape = mask[rows, columns].shape
    mask[rows, columns] = cv2.resize(strip[:, : end + 4], shape[::-1], interpolation=cv2.INTER_AREA)
    return finish(_ink(canvas, np.rot90(mask, -1), accent))


def _cover(size_px: int, rng: Generator, colour: Colour, accent: Colour) -> Image:
    canvas = _tinted(size_px, rng, colour)
    mask = np.zeros((size_px, size_px), np.uint8)
    for k in range(2):
        height = size_px // (9 + 4 * k)
        title = words(rng, 1)[0].title()[:9]
        write(mask, title, size_px // 10, int((0.2 + 0.16 * k) * size_px), height, bold=True)
    centre = (int(rng.uniform(0.35, 0.65) * size_px), int(0.62 * size_px))
    for ring in range(4):
        cv2.circle(mask, centre, size_px * (ring + 1) // 20, 255, 2 + ring, cv2.LINE_AA)
    foot = (size_px // 10, int(0.86 * size_px), int(0.9 * size_px), int(0.97 * size_px))
    paragraph(mask, foot, max(5, size_px // 40), rng)
    return finish(_ink(canvas, mask, accent))


def carton(size_px: int, rng: Generator, colour: Colour) -> Image:
    """Folds a cardboard box as a cube map: label in front, tape on top, stamps on the sides."""
    shape = (size_px, size_px)
    inset = int(0.62 * size_px)
    front = finish(cardboard(shape, rng))
    at = (size_px - inset) // 2
    front[at : at + inset, at : at + inset] = label((inset, inset), rng, colour)
    sides = []
    for _ in range(3):
        mask = np.zeros(shape, np.uint8)
        text = words(rng, 1)[0].upper()[:6]
        write(mask, text, size_px // 8, int(0.45 * size_px), size_px // 8, bold=True)
        box = (size_px // 8, int(0.55 * size_px), int(0.8 * size_px), int(0.85 * size_px))
        paragraph(mask, box, max(5, size_px // 26), rng)
        sides.append(finish(_ink(cardboard(shape, rng), mask, (0.18, 0.12, 0.1))))
    top = cardboard(shape, rng)
    tape = slice(int(0.42 * size_px), int(0.58 * size_px))
    top[tape] = 0.45 * top[tape] + np.asarray((0.42, 0.4, 0.34), np.float32)
    lid = finish(top)
    return cube(front, sides[0], sides[1], sides[2], lid, lid)


def _lid(size_px: int, rng: Generator) -> Image:
    away = np.hypot(*(np.indices((size_px, size_px), dtype=np.float32) / size_px - 0.5))
    ribs = 0.55 + 0.12 * np.sin(90.0 * away) + 0.4 * (fractal((size_px, size_px), rng, 0.7) - 0.5)
    return finish(ribs)


def can(size_px: int, rng: Generator, colour: Colour) -> Image:
    """Wraps a tin can as a cube map: its label twice around it, ribbed metal at both ends."""
    side = np.tile(label((size_px, 3 * size_px // 2), rng, colour), (1, 2, 1))
    rim = np.minimum(np.arange(size_px), np.arange(size_px)[::-1]) < size_px // 24
    side[rim] = _lid(size_px, rng)[0, 0]
    return wrap(side, _lid(size_px, rng))


def drum(size_px: int, rng: Generator, colour: Colour) -> Image:
    """Paints an oil drum as a cube map: hoops, stencilled words, a sticker, scuffs and runs."""
    shape = (size_px, 3 * size_px)
    rows = np.linspace(0, 1, size_px, dtype=np.float32)[:, None]
    hoops = sum(
        np.exp(-(((rows - at) / 0.018) ** 2), dtype=float) for at in (0.03, 0.35, 0.66, 0.97)
    )
    scuffs = fractal(shape, rng, 0.9) + 0.7 * fractal(shape, rng, 0.6, (9.0, 1.0)) - 0.85
    tone = 1.0 + 0.9 * scuffs - 0.45 * np.roll(hoops, size_px // 40) + 0.4 * hoops
    side = np.asarray(colour, np.float32) * np.asarray(tone)[..., None]
    mask = np.zeros(shape, np.uint8)
    for left in (0.15, 1.2, 2.2):
        text = words(rng, 1)[0].upper()[:6]
        write(mask, text, int(left * size_px), int(0.57 * size_px), size_px // 7, bold=True)
    painted = finish(_ink(side, mask, (0.86, 0.84, 0.76)))
    sticker = size_px // 4
    row, column = int(0.69 * size_px), int(1.3 * size_px)
    patch = label((sticker, sticker), rng, (0.8, 0.6, 0.15))
    painted[row : row + sticker, column : column + sticker] = patch
    return wrap(painted, _lid(size_px, rng))


def crate(size_px: int, rng: Generator) -> Image:
    """Nails a crate out of planks; one square face that serves all six sides."""
    boards = wood((size_px, size_px), rng, planks=5).astype(np.float32)
    beam = wood((size_px, size_px), rng).astype(np.float32)
    wide = size_px // 8
    near = np.minimum(np.arange(size_px), np.arange(size_px)[::-1])
    rim = np.minimum(near[:, None], near[None, :])
    upright = near[None, :] <= near[:, None]
    frame = np.where(upright[..., None], beam.swapaxes(0, 1), beam)
    face = np.where((rim < wide)[..., None], frame, 0.8 * boards)
    face[np.abs(rim - wide) < max(1, size_px // 128)] *= 0.55
    return np.clip(np.rint(face), DARKEST, BRIGHTEST).astype(np.uint8)


def toy_block(size_px: int, rng: Generator, colour: Colour) -> Image:
    """Paints a wooden block as a cube map: a framed letter on each face."""
    faces = []
    for _ in range(6):
        canvas = _tinted(size_px, rng, (0.8, 0.66, 0.46))
        mask = np.zeros((size_px, size_px), np.uint8)
        edge = size_px // 12
        cv2.rectangle(mask, (edge, edge), (size_px - edge, size_px - edge), 255, edge // 2)
        letter = chr(int(rng.integers(65, 91)))
        write(mask, letter, int(0.28 * size_px), int(0.74 * size_px), size_px // 2, bold=True)
        faces.append(finish(_ink(canvas, mask, colour)))
    return cube(*faces)


def keyboard(shape: tuple[int, int], rng: Generator) -> Image:
    """Draws the top of a keyboard: five staggered rows of keys with letters, a space bar."""
    height, width = shape
    canvas = np.full((height, width, 3), (0.16, 0.17, 0.19), np.float32)
    legend = np.zeros(shape, np.uint8)
    pitch = width / 15.4
    rows = height / 5.3
    for row in range(5):
        edges = [0.2, *(1.2 + 0.25 * row + np.arange(13)), 15.2]
        if row == 4:
            edges = [0.2, 1.5, 2.8, 4.1, 10.4, 11.6, 12.8, 14.0, 15.2]
        for left, right in pairwise(edges):
            _key(canvas, legend, ((0.15 + row) * rows, rows, left * pitch, right * pitch), rng)
    canvas = canvas * (0.85 + 0.3 * fractal(shape, rng, 0.6)[..., None])
    return finish(_ink(canvas, legend, (0.12, 0.12, 0.13)))


def _key(
    canvas: Field, legend: Image, at: tuple[float, float, float, float], rng: Generator
) -> None:
    top, tall, left, right = at
    gap = 0.06 * tall
    y0, y1 = int(top + gap), int(top + tall - gap)
    x0, x1 = int(left + gap), int(right - gap)
    shade = 0.62 + 0.1 * rng.random()
    canvas[y0:y1, x0:x1] = shade * 0.62
    bevel = int(0.1 * tall)
    canvas[y0 + bevel // 2 : y1 - bevel * 2, x0 + bevel : x1 - bevel] = shade
    letter = chr(int(rng.integers(65, 91)))
    if right - left < 4 * tall:
        write(legend, letter, x0 + 2 * bevel, y0 + int(0.52 * tall), max(6, int(0.3 * tall)))


def disc(size_px: int, rng: Generator, colour: tuple[float, float, float], text: str) -> Image:
    """Prints a round sign, a cylinder about z, as a cube map: `text` in a ring on both ends."""
    face = np.empty((size_px, size_px, 3), np.float32)
    face[:] = colour
    dark = 0.15 if sum(colour) > 1.5 else 0.9
    ring = (0.62, 0.14, 0.12) if dark < 0.5 else (0.85, 0.85, 0.85)
    middle = (size_px // 2, size_px // 2)
    cv2.circle(face, middle, int(0.44 * size_px), ring, size_px // 9, cv2.LINE_AA)
    mask = np.zeros((size_px, size_px), np.uint8)
    height = size_px // (2 + len(text) // 2)
    write(mask, text, int(0.22 * size_px), int(0.5 * size_px + 0.4 * height), height, bold=True)
    face[mask > 100] = dark
    lid = finish(face * (0.95 + 0.1 * fractal((size_px, size_px), rng))[..., None])
    return wrap(finish(np.full((8, 32), 0.5)), lid)


def car_side(shape: tuple[int, int], rng: Generator, colour: Colour) -> Image:
    """Paints the lower side of a car, front at the right: seams, handles, arches, lamps."""
    height, width = shape
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    gleam = 1.15 - 0.5 * down + 0.25 * np.exp(-(((down - 0.22) / 0.05) ** 2), dtype=float)
    dirt = 0.9 + 0.2 * fractal(shape, rng, 1.2)
    paint = np.asarray(colour, np.float32) * (gleam * dirt)[..., None]
    seam = tuple(0.35 * c for c in colour)
    for at in (0.32, 0.53, 0.74):
        cv2.line(paint, (int(at * width), 0), (int(at * width), int(0.8 * height)), seam, 2)
    for at in (0.35, 0.56):
        knob = (int(at * width), int(0.25 * height))
        cv2.rectangle(paint, knob, (knob[0] + width // 28, knob[1] + height // 20), seam, -1)
    for at in (0.19, 0.81):
        cv2.circle(paint, (int(at * width), height), int(0.088 * width), (0.04,) * 3, -1)
    paint[int(0.86 * height) :] = 0.1
    paint[int(0.2 * height) : int(0.48 * height), : width // 40] = (0.62, 0.12, 0.1)
    paint[int(0.25 * height) : int(0.5 * height), -width // 40 :] = 0.88
    return finish(paint)


def car_cabin(shape: tuple[int, int], rng: Generator, colour: Colour) -> Image:
    """Glazes a car's cabin: dark panes with a gleam between pillars under a painted roof."""
    height, width = shape
    down, across = np.mgrid[0:height, 0:width].astype(np.float32)
    down, across = down / height, across / width
    gleam = np.clip(1 - np.abs(across - 0.35 - 0.3 * down) / 0.12, 0, 1)
    glass = 0.10 + 0.22 * gleam + 0.12 * (1 - down) + 0.06 * (fractal(shape, rng, 1.2) - 0.5)
    pane = glass[..., None] * np.asarray((0.9, 1.0, 1.08), np.float32)
    post = (np.abs(across - 0.48) < 0.018) | (down < 0.13) | (down > 0.93)
    return finish(np.where(post[..., None], np.asarray(colour, np.float32), pane))


def wheel(size_px: int, rng: Generator) -> Image:
    """Mounts a wheel, a cylinder about z, as a cube map: rubber around, spokes on the ends."""
    side = finish(0.1 + 0.14 * fractal((size_px // 2, 2 * size_px), rng, 0.4))
    rim = np.full((size_px, size_px, 3), 0.07, np.float32)
    middle = size_px // 2
    cv2.circle(rim, (middle, middle), int(0.33 * size_px), (0.3,) * 3, -1, cv2.LINE_AA)
    for k in range(5):
        turn = 2 * np.pi * k / 5
        end = (
            middle + int(0.3 * size_px * np.cos(turn)),
            middle + int(0.3 * size_px * np.sin(turn)),
        )
        cv2.line(rim, (middle, middle), end, (0.72,) * 3, max(2, size_px // 14), cv2.LINE_AA)
    cv2.circle(rim, (middle, middle), int(0.33 * size_px), (0.7,) * 3, 2, cv2.LINE_AA)
    return wrap(side, finish(rim))
