"""How close simulated events come to those of the continuous world, per scene and way to simulate.

Events are compared one to one. Each case is a short clip of one camera; of sensors with many
pixels, of their middle. For scenes of the suite the truth is the finest pictures that are
practical: 16 x 16 samples per pixel, 0.05 px apart, by MuJoCo's renderer. With `--rays` the cases
are worlds of panels, and the truth is cast by rays, which shares no code with the simulator;
`--drawn SEED` is the same with other sizes, speeds and textures.

Run: python tests/benchmarks fidelity --truth FOLDER [CASE ...] [--rays | --drawn SEED]
[--page docs/simulator.md] [--picture docs/images/fidelity.png]. The truth is kept in FOLDER: of a
scene it takes minutes, of panels seconds. Renderers are compared by `--way accurate --renderer
raster`, and by motions that nobody has seen, `--seed 7`.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from eventsweep import scenes
from eventsweep.emvs.data.events import Events
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.files import atomic_path
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rendering.adaptive_sampling import adaptive_frames
from eventsweep.sim.rendering.moving_bodies import MovingBodies
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import rig as rig_called
from eventsweep.sim.scene import Scene
from eventsweep.sim.sensor.esim import EventSimulator
from markdown_blocks import show
from one_to_one import TOLERANCE_US, Agreement, agreement
from panel_cases import CASES as RAY_CASES
from panel_cases import PanelCase, panel_case
from panel_scene import panel_rig, panel_scene, simulated_events
from ray_events import PixelEvents, ray_events
from table_code import DRAWS, FOREIGN, Code, of_scenes

# Okabe and Ito's colours, distinguishable to everybody; line styles differ as well.
_STYLES = (("#777777", ":"), ("#E69F00", "--"), ("#0072B2", "-"), ("#009E73", "-."))
_NEAREST_US, _FURTHEST_US, _ACROSS = 10, 10_000, 4
AT_US = np.geomspace(_NEAREST_US, _FURTHEST_US, 61)


def draw(recalls: Mapping[str, Mapping[str, NDArray[np.float64]]], path: Path) -> None:
    """Draws one panel per scene with one curve per way to simulate, as a PNG.

    Args:
        recalls: by scene and way, the share of true events with a partner within each of `AT_US`.
        path: the picture.
    """
    rows = -(-len(recalls) // _ACROSS)
    figure = Figure(figsize=(2.9 * _ACROSS, 2.5 * rows + 0.4), layout="constrained", dpi=100)
    panels = np.atleast_1d(figure.subplots(rows, _ACROSS, sharex=True, sharey=True)).ravel()
    for axes, (scene, ways) in zip(panels, recalls.items(), strict=False):
        for (way, recall), (colour, style) in zip(ways.items(), _STYLES, strict=False):
            axes.plot(AT_US, 100 * recall, style, color=colour, label=way)
        axes.set(title=scene, xscale="log", ylim=(0, 100), xlim=(_NEAREST_US, _FURTHEST_US))
        axes.grid(alpha=0.3)
    for axes in panels[len(recalls) :]:
        axes.set_axis_off()
    figure.supxlabel("time error (µs)")
    figure.supylabel("true events with a partner so near (%)")
    handles, names = panels[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper center", ncols=len(names))
    with atomic_path(path) as part, part.open("wb") as file:
        figure.savefig(file, format="png")


FINEST_SAMPLES, FINEST_PX = 16, 0.05
_MARK = "fidelity"


@dataclass(frozen=True)
class Clip:
    """A short piece of a scene, seen by one camera.

    Attributes:
        scene: its name.
        duration_us: length, µs.
        rig: name of the rig; that of the scene unless given.
        crop_px: width and height of the middle part of the sensor; all of it unless given.
    """

    scene: str
    duration_us: int
    rig: str | None = None
    crop_px: tuple[int, int] | None = None


CLIPS = {
    "desk": Clip("desk", 30_000),
    "boxes": Clip("boxes", 20_000, None, (240, 180)),
    "thin-structures": Clip("thin-structures", 15_000, None, (240, 180)),
    "moving-objects": Clip("moving-objects", 10_000, None, (240, 180)),
    "hdr-window": Clip("hdr-window", 8_000, None, (240, 180)),
    "reflective": Clip("reflective", 20_000),
    "low-texture": Clip("low-texture", 30_000),
    "tumvie-6dof": Clip("tumvie-6dof", 12_000, None, (480, 270)),
    "desk, 1280×720": Clip("desk", 6_000, "tumvie", (320, 180)),
    "mvsec-flying": Clip("mvsec-flying", 20_000, None, (240, 180)),
    "dsec-street": Clip("dsec-street", 10_000, None, (320, 240)),
}
WAYS: dict[str, dict[str, Any]] = {
    "linear": {"sampling": "linear"},
    "fast": {"sampling": "fast"},
    "accurate": {"sampling": "accurate"},
}
PANEL_WAYS: dict[str, dict[str, Any]] = {"accurate": {}}
PANELS = (
    "fidelity:simulated_panels", "fidelity:RAY_CASES", "fidelity:panel_case", "fidelity:ray_events",
    "fidelity:table",
)  # fmt: skip


def view_of(clip: Clip) -> tuple[Scene, Rig]:
    """The clip's scene, and its one camera."""
    scene = scenes.load(clip.scene)
    whole = rig_called(clip.rig or scene.rig)
    camera = whole.cameras[0]
    if clip.crop_px is not None:
        width, height = clip.crop_px
        left, top = (camera.width_px - width) // 2, (camera.height_px - height) // 2
        camera = replace(
            camera, width_px=width, height_px=height,
            cx_px=camera.cx_px - left, cy_px=camera.cy_px - top,
        )  # fmt: skip
    return scene, Rig(whole.name, (camera,), (whole.T_body_cam[0],), ("left",))


def kept_events(path: Path, kind: type, make: Callable[[], Any]) -> Any:
    """Events from a file, where they have been made before."""
    if path.exists():
        stored = np.load(path)
        return kind(*(stored[name] for name in ("x", "y", "t", "p")))
    events = make()
    with atomic_path(path) as part, part.open("wb") as file:
        np.savez(file, x=events.x, y=events.y, t=events.t_us, p=events.p)
    return events


def finest(clip: Clip, seed: int) -> Events:
    """The events of the finest pictures."""
    scene, rig = view_of(clip)
    config = scene.configured(
        SimConfig(sampling="linear", max_displacement_px=FINEST_PX, min_frame_interval_us=1)
    )
    motion, camera = scene.motion(scene.duration_s, seed), rig.cameras[0]
    pixels, parts = EventSimulator(camera.width_px, camera.height_px, config), []
    with StereoRenderer(
        scene.spec(), rig, FINEST_SAMPLES, scene.depth_range_m,
        floats=config.light.floats(scene.hdr), animate=scene.animate,
    ) as renderer:  # fmt: skip
        bodies = MovingBodies(renderer) if scene.animate else None
        stops_us = [0, clip.duration_us]
        for number, frame in enumerate(
            adaptive_frames(renderer, motion, stops_us, config, bodies=bodies)
        ):
            if number == 0:
                pixels.start(frame.frames[0].intensity, frame.t_us)
            else:
                parts.append(pixels.step(frame.frames[0].intensity, frame.t_us))
    return Events.concat(parts)


def simulated(clip: Clip, settings: dict[str, Any], seed: int) -> Events:
    """The clip's events as the simulator makes them."""
    scene, rig = view_of(clip)
    # The whole scene's motion, of which the clip is the beginning.
    clipped = replace(scene, motion=lambda _s, _seed: scene.motion(scene.duration_s, seed))
    config = SimConfig(duration_s=1e-6 * clip.duration_us, **settings)
    return cast(Events, simulated_events(clipped, rig, config))


def simulated_panels(case: PanelCase, settings: dict[str, Any]) -> Events:
    """The events of a world of panels as the simulator makes them."""
    config = SimConfig(duration_s=case.duration_s, log_eps=case.log_eps, **settings)
    with tempfile.TemporaryDirectory() as folder:
        scene = panel_scene(case.world, case.depth_range_m, Path(folder), hdr=case.hdr)
        return cast(Events, simulated_events(scene, panel_rig(case.world.camera), config))


def table(results: dict[str, dict[str, Agreement]], against: str) -> str:
    """The results as Markdown, a row per case and way."""
    lines = [
        f"Events compared one to one within {TOLERANCE_US / 1000:g} ms, against {against}; median "
        "time error of those that agree. Written by `python tests/benchmarks fidelity`.",
        "",
        "| Case | way | true events | count error | recall | precision | median, µs |",
        "|---|---|--:|--:|--:|--:|--:|",
    ]
    for case, ways in results.items():
        for number, (way, same) in enumerate(ways.items()):
            count = f"{same.true:,}"
            first = f"{case} | {way} | {count}" if number == 0 else f" | {way} | "
            error = f"{100 * same.count_error:+.1f} %".replace("-", "−")
            shares = f"{100 * same.recall:.1f} % | {100 * same.precision:.1f} %"
            lines.append(f"| {first} | {error} | {shares} | {same.median_us:.0f} |")
    return "\n".join(lines) + "\n"


def runs(given: argparse.Namespace) -> Iterator[tuple[str, str, Any, Any]]:
    """Case, way, events and true events, one by one."""
    light = {"light": {"renderer": given.renderer}}
    for name in given.cases or (RAY_CASES if given.rays else CLIPS):
        if given.rays:
            case = panel_case(name, given.drawn)
            drawn = "" if given.drawn is None else f", seed {given.drawn}"
            world, seconds, log_eps = case.world, case.duration_s, case.log_eps
            cast_rays = partial(ray_events, world, seconds, log_eps=log_eps)
            true = kept_events(given.truth / f"rays, {name}{drawn}.npz", PixelEvents, cast_rays)
            for way, settings in _ways(given).items():
                yield name, way, simulated_panels(case, settings | light), true
            continue
        clip, path = CLIPS[name], f"{name}{f', seed {given.seed}' if given.seed else ''}.npz"
        true = kept_events(given.truth / path, Events, partial(finest, clip, given.seed))
        for way, settings in _ways(given).items():
            yield name, way, simulated(clip, settings | light, given.seed), true


def _ways(given: argparse.Namespace) -> dict[str, dict[str, Any]]:
    ways = PANEL_WAYS if given.rays else WAYS
    return {way: ways[way] for way in ways if way in (given.way or ways)}


def parsed(arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("cases", nargs="*", metavar="CASE")
    parser.add_argument("--truth", type=Path, required=True, help="folder that keeps the truth")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--rays", action="store_true", help="worlds of panels, by ray casting")
    kind.add_argument("--drawn", type=int, metavar="SEED", help="the same, other panels")
    parser.add_argument("--way", action="append", choices=WAYS, help="this one alone")
    parser.add_argument("--renderer", default="auto", help="of what is judged")
    parser.add_argument("--seed", type=int, default=0, help="of the motion through a scene")
    parser.add_argument("--page", type=Path)
    parser.add_argument("--picture", type=Path)
    given = parser.parse_args(arguments)
    given.rays |= given.drawn is not None
    known = RAY_CASES if given.rays else CLIPS
    unknown = set(given.cases) - set(known)
    if unknown:
        parser.error(f"no case {', '.join(sorted(unknown))}: choose of {', '.join(known)}")
    return given


def code() -> dict[str, Code]:
    """What the numbers depend on."""
    return {
        "docs/simulator.md#fidelity": Code(
            ("fidelity:simulated", "fidelity:finest", "fidelity:table", "fidelity:WAYS")
        )
        + of_scenes(clip.scene for clip in CLIPS.values()),
        "docs/simulator.md#fidelity-rays": Code(
            (*PANELS, "fidelity:PANEL_WAYS"), (DRAWS,), without=FOREIGN
        ),
        "docs/simulator.md#fidelity-drawn": Code(
            (*PANELS, "fidelity:PANEL_WAYS"), (DRAWS,), without=FOREIGN
        ),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Compares all ways to simulate with the truth and prints, writes or draws what came out."""
    given = parsed(arguments)
    given.truth.mkdir(parents=True, exist_ok=True)
    results: dict[str, dict[str, Agreement]] = {}
    curves: dict[str, dict[str, NDArray[np.float64]]] = {}
    for case, way, found, true in runs(given):
        same = agreement(found, true)
        results.setdefault(case, {})[way] = same
        if given.picture:
            shares = [agreement(found, true, at_us).recall for at_us in AT_US]
            curves.setdefault(case, {})[way] = np.array(shares)
        sys.stderr.write(f"{case}, {way}: {same}\n")
    against = (
        "ray casting" + f", panels drawn by seed {given.drawn}" * (given.drawn is not None)
        if given.rays
        else (f"{FINEST_SAMPLES} × {FINEST_SAMPLES} samples {FINEST_PX:g} px apart")
    )
    drawn = given.drawn is not None
    mark = _MARK + "-drawn" * drawn + "-rays" * (given.rays and not drawn)
    show(table(results, against), given.page, mark, code)
    if given.picture:
        draw(curves, given.picture)
    return 0


if __name__ == "__main__":
    sys.exit(main())
