"""The first stage: a scene to a sequence with ground truth."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from importlib.metadata import EntryPoint
from pathlib import Path
from types import MappingProxyType
from typing import Any

from eventsweep import scenes
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.plugins import RENDERERS, modules_of, points
from eventsweep.emvs.utils.plugins import files_of as files_of_packages
from eventsweep.eval.jobs.code_version import closure, definition_digest
from eventsweep.eval.jobs.job import SEQUENCE, Runtime
from eventsweep.eval.progress import SILENT, Display
from eventsweep.eval.stages.changes import changed
from eventsweep.scenes import case_name
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import drawn_by
from eventsweep.sim.mjcf import files_of, is_model_file

STAGE = __name__


def sequence_parameters(
    scene: str, rig: str | None, seed: int, sim: Mapping[str, Any],
    change: Mapping[str, float] | None = None,
) -> dict[str, Any]:  # fmt: skip
    """What decides a sequence beside code.

    Args:
        scene: its name, or a model's file.
        rig: the cameras; by default the scene's own.
        seed: of motion and noise.
        sim: settings that are not the defaults.
        change: what a study makes of the scene, see `eval.stages.changes`.
    """
    own = None if is_model_file(scene) else scenes.load(scene).rig
    sim = {**sim, "light": {**sim.get("light", {}), "renderer": _renderer(sim)}}
    facts = {"scene": scene, "rig": rig or own, "seed": seed, "sim": sim}
    return {**facts, "graphics": _graphics(sim)} | ({"change": dict(change)} if change else {})


def _renderer(sim: Mapping[str, Any]) -> str:
    from eventsweep.sim.rendering.drawing import decided

    return decided(SimConfig.model_validate({"light": sim.get("light", {})})).light.renderer


def _renderers(sim: Mapping[str, Any]) -> list[EntryPoint]:
    """The plug-in that draws; none where MuJoCo does."""
    return [point for point in points(RENDERERS) if point.name == sim["light"]["renderer"]]


def _graphics(sim: Mapping[str, Any]) -> str:
    """What decides the pixels beside code: a plug-in, or the graphics library."""
    chosen = _renderers(sim)
    return chosen[0].name if chosen else drawn_by()


def code(parameters: Mapping[str, Any]) -> tuple[Sequence[str], Sequence[Path]]:
    """The scene's own module and files, files that settings name, and the renderer's code."""
    renderers = _renderers(parameters["sim"])
    modules, files = modules_of(renderers), files_of_packages(renderers)
    scene, texts = str(parameters["scene"]), _texts([parameters["rig"], parameters["sim"]])
    named = [path for text in texts if len(text) < 4096 and (path := Path(text)).is_file()]
    if is_model_file(scene):
        return modules, (*files, *files_of(Path(scene)), *named)
    files += files_of(scenes.load(scene).mjcf)
    return (scenes.module_of(scene), *modules), (*files, *named)


def _texts(value: Any) -> Iterator[str]:
    if isinstance(value, str) and value:
        yield value
    elif isinstance(value, Mapping | list | tuple):
        for part in value.values() if isinstance(value, Mapping) else value:
            yield from _texts(part)


def scene_digest(scene: str) -> str:
    """A hash over what a scene's modules define, textures among it, and its MJCF; no simulator."""
    if is_model_file(scene):
        return definition_digest((), files_of(Path(scene)))
    root = scenes.module_of(scene)
    modules = {
        name for name in closure([root]) if name == root or name.startswith("eventsweep.scenes.")
    }
    return definition_digest(modules, files_of(scenes.load(scene).mjcf))


def run(
    parameters: Mapping[str, Any], _inputs: Sequence[Path], out: Path, runtime: Runtime
) -> None:
    """Writes the sequence; one process draws, in one thread, unless the runtime has more."""
    graphics = _graphics(parameters["sim"])
    if graphics != parameters["graphics"]:
        raise InputError(
            f"this was planned for the renderer {parameters['graphics']}, this worker has "
            f"{graphics}: set MUJOCO_GL=osmesa everywhere, or use machines with the same renderer"
        )
    config = SimConfig.model_validate(parameters["sim"])
    # Beside the entry, where a kill leaves what is drawn so far for the next attempt.
    place = runtime.unfinished or out
    place.mkdir(exist_ok=True)
    try:
        simulate_scene(
            parameters["scene"], place / SEQUENCE, config, parameters["rig"], parameters["seed"],
            change=parameters.get("change", {}), force=True, workers=runtime.renderers,
            progress=runtime.display,
        )  # fmt: skip
        (place / SEQUENCE).rename(out / SEQUENCE)
    finally:
        with suppress(OSError):  # unfinished work is in it
            place.rmdir()


def simulate_scene(
    scene: str, out: Path, config: SimConfig, rig: str | None, seed: int, *,
    change: Mapping[str, float] = MappingProxyType({}), force: bool = False, workers: int = 1,
    fresh: bool = False, progress: Display = SILENT,
) -> None:  # fmt: skip
    """Simulates one scene, with its own rig or another one, and writes the sequence.

    Unfinished work of the same arguments is taken up, unless `fresh` says to discard it.
    """
    with (
        progress.stage(f"simulate {case_name(scene)}", 1) as update,
        _collection_paused() as resume_collection,
    ):

        def show(_stage: str, done_us: int, total_us: int) -> None:
            resume_collection()  # the first picture is there: nothing is imported any more
            update(done_us / total_us, f"{done_us / 1e3:.0f} ms")

        from eventsweep.emvs.data.sequence import Sequence as EventSequence
        from eventsweep.sim.parallel.checkpoint import begun_with
        from eventsweep.sim.rendering.drawing import decided
        from eventsweep.sim.simulate import simulate

        config = decided(config, None if fresh else begun_with(out))
        prepared = scenes.prepared(scene, rig, config, seed, progress.say)
        made, cameras = changed(prepared.scene, prepared.rig, change)
        simulate(
            made, cameras, prepared.config, seed, out, force=force, workers=workers,
            resume=not fresh, notice=progress.say, progress=show,
        )  # fmt: skip
        whole = EventSequence.open(out).manifest
        span_ms = (whole.span_us[1] - whole.span_us[0]) / 1e3
        update(1.0, f"{span_ms:.0f} ms, {sum(whole.event_counts):,} events")


@contextmanager
def _collection_paused() -> Iterator[Callable[[], None]]:
    """Keeps Python's collector of cycles from looking through what imports make, which stays.

    It would look through all of it each time that it has grown by a quarter. Yields a function that
    lets it work again; the end does so in any case.
    """
    resume = gc.enable if gc.isenabled() else gc.disable
    gc.disable()
    try:
        yield resume
    finally:
        resume()
