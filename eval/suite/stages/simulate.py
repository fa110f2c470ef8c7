"""The first stage of a suite's jobs: a scene to a sequence with ground truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from eventsweep import scenes
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.eval.jobs.code_version import closure, definition_digest
from eventsweep.eval.jobs.job import SEQUENCE
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import drawn_by
from eventsweep.sim.mjcf import files_of
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.scene import Scene
from eventsweep.sim.simulate import simulate


def sequence_parameters(
    scene: str, rig: str | None, seed: int, sim: Mapping[str, Any]
) -> dict[str, Any]:
    """What decides a sequence beside code; `sim` holds the settings that are not the defaults."""
    return {
        "scene": scene,
        "rig": rig or scenes.load(scene).rig,
        "seed": seed,
        "sim": dict(sim),
        "graphics": drawn_by(),
    }


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The scene's own module and files."""
    scene = str(parameters["scene"])
    return (scenes.module_of(scene),), files_of(scenes.load(scene).mjcf)


def scene_digest(scene: str) -> str:
    """A hash over what a scene's modules define, textures among it, and its MJCF; no simulator."""
    root = scenes.module_of(scene)
    modules = {
        name for name in closure([root]) if name == root or name.startswith("eventsweep.scenes.")
    }
    return definition_digest(modules, files_of(scenes.load(scene).mjcf))


def run(parameters: Mapping[str, Any], _inputs: Sequence[Path], out: Path) -> None:
    """Writes the sequence of a scene as it is."""
    simulate_scene(scenes.load(parameters["scene"]), named_rig(parameters["rig"]), parameters, out)


def simulate_scene(scene: Scene, rig: Rig, parameters: Mapping[str, Any], out: Path) -> None:
    """Writes a sequence, in one process and one thread for the pictures."""
    if drawn_by() != parameters["graphics"]:
        raise InputError(
            f"the suite was planned for the renderer {parameters['graphics']}, this worker has "
            f"{drawn_by()}: set MUJOCO_GL=osmesa everywhere, or use machines with the same renderer"
        )
    config = SimConfig.model_validate(parameters["sim"])
    simulate(scene, rig, config, parameters["seed"], out / SEQUENCE)
