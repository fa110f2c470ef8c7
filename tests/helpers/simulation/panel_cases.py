"""Clips of panels in which a simulator can err: thin, near, crossing, fast, distorted, dim, bright.

Each exists as it stands here, and with sizes, speeds and textures drawn by a seed.
"""

import zlib
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from ray_world import Panel, Pose, RayCamera, RayWorld, Vector

Texture = NDArray[np.uint8]
_STILL = (0.0, 0.0, 0.0)
_SPREAD = 1.6
"""Drawn sizes and speeds are up to so many times larger or smaller."""
DAVIS = RayCamera(40, 30, 226.4, 19.6, 14.7)
VGA = RayCamera(48, 32, 450.3, 23.8, 15.4)
MEGAPIXEL = RayCamera(56, 32, 1049.6, 27.7, 15.5)
FISHEYE = RayCamera(44, 32, 23.0, 21.4, 15.7, "kb4", (0.02, -0.005, 0.001, -0.0002))
BARREL = RayCamera(40, 30, 32.0, 19.6, 14.7, "radtan", (-0.28, 0.07, 0.0008, -0.0005))
WIRES_PX = (0.1, 0.2, 0.35, 0.6, 1.0, 1.6)


@dataclass(frozen=True, eq=False)
class PanelCase:
    """A clip of a world.

    Attributes:
        world: what there is to see.
        duration_s: how long, s.
        depth_range_m: nearest and farthest depth, m.
        log_eps: added to intensity before the logarithm.
        hdr: whether there is light above 1.
    """

    world: RayWorld
    duration_s: float
    depth_range_m: tuple[float, float]
    log_eps: float = 0.02
    hdr: bool = False


class Draw:
    """Sizes, speeds and textures of a case: as written, or drawn anew by a seed."""

    def __init__(self, name: str, seed: int | None) -> None:
        self._rng = None
        if seed is not None:
            self._rng = np.random.default_rng([seed, zlib.crc32(name.encode())])

    def factor(self, spread: float = _SPREAD) -> float:
        """1, or drawn from 1 / `spread` to `spread`."""
        return 1.0 if self._rng is None else float(spread ** self._rng.uniform(-1, 1))

    def noise(self, size: int, seed: int, low: int = 28, high: int = 232, slope: float = 1.0):
        """Grey noise (size, size) of spectrum 1 / f^slope; every level equally often."""
        white = self._texture_rng(seed).standard_normal((size, size))
        f = np.hypot(np.fft.fftfreq(size)[:, None], np.fft.rfftfreq(size))
        f[0, 0] = 1.0
        noise = np.fft.irfft2(np.fft.rfft2(white) / f**slope, (size, size))
        rank = np.argsort(np.argsort(noise.ravel())).reshape(size, size) / size**2
        return np.round(low + (high - low) * rank).astype(np.uint8)

    def leaves(self, size: int, seed: int, count: int = 1500) -> Texture:
        """Discs (size, size) of all sizes and greys, fallen over each other."""
        rng, out = self._texture_rng(seed), np.full((size, size), 128, np.uint8)
        for _ in range(count):
            x, y = rng.uniform(0, size, 2)
            radius = min(0.01 * size / rng.uniform(0.03, 1.03), size / 16)
            reach = np.arange(-int(radius) - 1, int(radius) + 2)
            rows, columns = np.meshgrid(int(y) + reach, int(x) + reach, indexing="ij")
            disc = np.hypot(rows - y, columns - x) < radius
            out[rows[disc] % size, columns[disc] % size] = rng.integers(28, 233)
        return out

    def _texture_rng(self, seed: int) -> np.random.Generator:
        return self._rng or np.random.default_rng(seed)


def flat(grey: int) -> Texture:
    """One grey."""
    return np.full((2, 2), grey, np.uint8)


def wall(depth_m: float, half_m: float, texture: Texture, repeats: float = 1.0) -> Panel:
    """A square across the view."""
    return board((0, 0, depth_m), half_m, half_m, texture, repeats=repeats)


def board(
    centre_m: Vector, half_width_m: float, half_height_m: float, texture: Texture,
    velocity_m_s: Vector = _STILL, repeats: float = 1.0,
) -> Panel:  # fmt: skip
    """An upright rectangle across the view."""
    across_m, down_m = (half_width_m, 0.0, 0.0), (0.0, half_height_m, 0.0)
    return Panel(centre_m, across_m, down_m, texture, velocity_m_s, repeats)


def gliding(velocity_m_s: Vector, turn_deg_s: Vector = _STILL, speed: float = 1.0) -> Pose:
    """A camera that moves evenly along a line, and turns evenly about an axis."""

    def T_world_cam(t_s: float) -> NDArray[np.float64]:
        T = np.eye(4)
        T[:3, 3] = np.multiply(speed * t_s, velocity_m_s)
        turned = np.radians(np.multiply(speed * t_s, turn_deg_s))
        T[:3, :3] = Rotation.from_rotvec(turned).as_matrix()
        return T

    return T_world_cam


def wires(
    draw: Draw, depth_m: float, focal_px: float, span_m: float, grey: int = 28
) -> tuple[Panel, ...]:
    """Upright strips 0.1 to 1.6 px wide, each tilted otherwise."""
    out = []
    for k, width_px in enumerate(WIRES_PX):
        half_m = 0.5 * width_px * draw.factor() * depth_m / focal_px
        x_m = span_m * ((2 * k + 1) / len(WIRES_PX) - 1)
        c, s = np.cos(0.25 * (k - 3)), np.sin(0.25 * (k - 3))
        across_m, down_m = (half_m * c, half_m * s, 0.0), (-0.6 * s, 0.6 * c, 0.0)
        out.append(Panel((x_m, 0.0, depth_m), across_m, down_m, flat(grey)))
    return tuple(out)


def _wires(camera: RayCamera, half_m: float, span_m: float, duration_s: float, speed_m_s: float):
    def case(draw: Draw) -> PanelCase:
        pose = gliding((speed_m_s, 0.125 * speed_m_s, 0), speed=draw.factor())
        behind = wall(2.5, half_m, draw.noise(512, 3, 120, slope=1.5))
        panels = (behind, *wires(draw, 0.8, camera.focal_px, span_m))
        return PanelCase(RayWorld(panels, camera, pose), duration_s, (0.5, 4.0))

    return case


def _leaves(draw: Draw) -> PanelCase:
    pose = gliding((0.4, 0.1, 0), speed=draw.factor())
    panels = (wall(2.0, draw.factor(), draw.leaves(1024, 1)),)
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.06, (1.0, 4.0))


def _forward(draw: Draw) -> PanelCase:
    pose = gliding((0, 0, 2.5), speed=draw.factor())
    panels = (wall(1.0, draw.factor(), draw.leaves(1024, 15)),)
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.08, (0.4, 4.0))


def _fence(draw: Draw) -> PanelCase:
    gap_m = 0.0159 * draw.factor()
    slats = tuple(
        board(((k - 11.5) * gap_m, 0, 0.6), gap_m / 4, 0.3, flat(50 + 6 * k)) for k in range(24)
    )
    panels = (wall(2.5, 1.5, draw.leaves(1024, 9)), *slats)
    pose = gliding((0.4, 0.05, 0), speed=draw.factor())
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.05, (0.3, 4.0))


def _slit(draw: Draw) -> PanelCase:
    half_gap_m = 0.0075 * draw.factor()
    boards = tuple(board((side * (0.2 + half_gap_m), 0, 0.5), 0.2, 0.3, flat(40))
                   for side in (-1, 1))  # fmt: skip
    panels = (wall(2.5, 1.5, draw.noise(1024, 9, 60)), *boards)
    pose = gliding((0.3, 0, 0), speed=draw.factor())
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.06, (0.3, 4.0))


def _crossing(draw: Draw) -> PanelCase:
    velocity_m_s: Vector = (3.0 * draw.factor(), 0.3, -0.5)
    half_m = 0.06 * draw.factor()
    body = board((-0.15, 0, 1.2), half_m, 0.05, draw.leaves(256, 8), velocity_m_s)
    panels = (wall(2.5, 1.5, draw.leaves(1024, 7)), body)
    return PanelCase(RayWorld(panels, DAVIS, gliding((0.1, 0, 0))), 0.03, (0.5, 4.0))


def _near(draw: Draw) -> PanelCase:
    across_m, down_m = np.multiply(draw.factor(), [[0.012, 0.004, 0], [-0.00533, 0.016, 0]])
    card = Panel((0.0, 0.0, 0.12), tuple(across_m), tuple(down_m), draw.noise(256, 6))
    panels = (wall(3.0, 2.0, draw.leaves(1024, 5)), card)
    pose = gliding((0.25, 0.05, 0), speed=draw.factor())
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.03, (0.1, 4.0))


def _rotation(draw: Draw) -> PanelCase:
    pose = gliding((0.2, 0, 0), (60, 285, 70), speed=draw.factor())
    panels = (wall(2.0, 3.0, draw.leaves(1024, 4)), *wires(draw, 1.0, 113.0, 0.25, grey=232))
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.02, (0.5, 6.0))


def _lens(camera: RayCamera):
    def case(draw: Draw) -> PanelCase:
        pose = gliding((0.4, 0.1, 0.2), (40, 240, 120), speed=draw.factor())
        panels = (wall(1.5, 9.0 * draw.factor(1.2), draw.leaves(1024, 13), repeats=4),)
        return PanelCase(RayWorld(panels, camera, pose), 0.05, (0.5, 20.0))

    return case


def _dim(draw: Draw) -> PanelCase:
    panels = (wall(2.0, draw.factor(), draw.noise(1024, 2)),)
    world = RayWorld(panels, DAVIS, gliding((0.4, 0.1, 0), speed=draw.factor()), ambient=0.02)
    return PanelCase(world, 0.06, (1.0, 4.0), log_eps=0.001)


def _window(draw: Draw) -> PanelCase:
    window = board((0.1, 0, 2.0), 0.25 * draw.factor(1.2), 0.2, draw.leaves(512, 12))
    panels = (wall(3.0, 2.0, draw.noise(512, 11, 1, 12)), window)
    world = RayWorld(panels, DAVIS, gliding((0.4, 0.1, 0), speed=draw.factor()), ambient=5.0)
    return PanelCase(world, 0.06, (1.0, 4.0), log_eps=0.001, hdr=True)


def _floor(draw: Draw) -> PanelCase:
    floor = Panel((0, 0.06, 1.3), (1, 0, 0), (0, 0, -1.2), draw.leaves(1024, 14))
    panels = (wall(2.6, 3.0, flat(150)), floor)
    pose = gliding((0.8, 0, 1.5), speed=draw.factor())
    return PanelCase(RayWorld(panels, DAVIS, pose), 0.06, (0.5, 20.0))


CASES: dict[str, Callable[[Draw], PanelCase]] = {
    "wires, f = 226 px": _wires(DAVIS, 1.5, 0.075, 0.06, 0.4),
    "wires, f = 450 px": _wires(VGA, 1.0, 0.06, 0.03, 0.35),
    "wires, f = 1050 px": _wires(MEGAPIXEL, 0.5, 0.045, 0.015, 0.3),
    "fence": _fence,
    "slit": _slit,
    "crossing body": _crossing,
    "near occluder": _near,
    "leaves": _leaves,
    "rotation at 300 deg per s": _rotation,
    "fisheye": _lens(FISHEYE),
    "barrel lens": _lens(BARREL),
    "dim": _dim,
    "bright window": _window,
    "forward": _forward,
    "grazing floor": _floor,
}


def panel_case(name: str, seed: int | None = None) -> PanelCase:
    """A case by its name; with a seed, one of other sizes, speeds and textures."""
    return CASES[name](Draw(name, seed))
