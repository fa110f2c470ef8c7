"""The simulator for users of the library: what `eventsweep simulate` does."""

from __future__ import annotations

from pathlib import Path

from eventsweep import scenes
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import check_path, check_type, check_whole
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.sim.config import SimConfig
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.scene import Scene
from eventsweep.sim.simulate import simulate as simulate_to_disk


def simulate(
    scene: Scene | str,
    out: str | Path,
    config: SimConfig | None = None,
    seed: int = 0,
    rig: Rig | str | None = None,
    *,
    force: bool = False,
    workers: int = 1,
    progress: Progress = silent,
) -> Sequence:
    """Renders a scene and simulates its events, with exact depth and poses.

    Args:
        scene: a scene, the name of one (`scenes` lists them), or the path of a model in MJCF or
            URDF, with `config.model`.
        out: the folder to write; it appears when it is complete. What an interrupted call left
            beside it is taken up by the next one.
        config: every parameter; by default the benchmark's.
        seed: of the head's motion and the sensor's noise, 0 or more.
        rig: the cameras, by name or by the path of a calibration; by default the scene's own.
        force: whether to replace `out`.
        workers: rendering processes; with more than 1 a script needs the usual `__main__` guard.
        progress: called with `simulate`, the time done and the time in total, µs.

    Returns:
        The sequence, opened.

    Raises:
        InputError: an unknown scene or rig, an existing `out`, motion too fast, no graphics
            library, or too little disk or memory.
    """
    check_path("out", out)
    check_whole("seed", seed)
    check_whole("workers", workers)
    config, out = SimConfig.or_default(config), Path(out)
    made, cameras, config = _prepared(scene, rig, config, seed)
    simulate_to_disk(
        made, cameras, config, seed, out, force=force, workers=workers, progress=progress
    )
    return Sequence.open(out)


def _prepared(
    scene: Scene | str, rig: Rig | str | None, config: SimConfig, seed: int
) -> tuple[Scene, Rig, SimConfig]:
    if rig is not None and not isinstance(rig, str):
        check_type("rig", rig, Rig, "a rig's name, a calibration's path or a Rig")
    if isinstance(scene, str):
        return scenes.prepared(scene, rig, config, seed)
    check_type("scene", scene, Scene, "a scene's name, a model's path or what load_scene gave")
    return scene, rig if isinstance(rig, Rig) else named_rig(rig or scene.rig), config
