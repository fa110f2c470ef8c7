"""The painted sides of cars: doors, lamps, windows, and wheels."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.random import Generator

from eventsweep.scenes.textures.cubes import wrap
from eventsweep.scenes.textures.noise import Colour, Image, finish, fractal


def car_side(shape: tuple[int, int], rng: Generator, colour: Colour) -> Image:
    """Paints the lower side of a car, front at the right: seams, handles, arches, lamps."""
    height, width = shape
    down = np.linspace(0, 1, height, dtype=np.float32)[:, None]
    gleam = 1.15 - 0.5 * down + 0.25 * np.exp(-(((down - 0.22) / 0.05) ** 2))
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
