"""The stages, one function each, and `run_cases` for all of them: simulate, map, score.

Each imports what it needs itself, so that the first picture waits for nothing of the mapper, and
the first vote for nothing of the simulator.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.inputs import inputs_of
from eventsweep.emvs.utils.outputs import atomic_dir, check_files, files_together, output_folder
from eventsweep.eval.config import EvalConfig, Settings
from eventsweep.eval.progress import Display, MapBars, Silent
from eventsweep.scenes import case_name
from eventsweep.sim.config import SimConfig

if TYPE_CHECKING:
    import pandas as pd

    from eventsweep.emvs.data.recording import Recording
    from eventsweep.emvs.maps.folder import StoredMap, StoredWindow
    from eventsweep.emvs.utils.runtime import Progress
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.pairing import Estimate
    from eventsweep.eval.scoring.predictions import NamedFolder
    from eventsweep.eval.scoring.results import Results

_SILENT = Silent()
_RESULTS = ("results.json", "results.csv")
_BEFORE_MAPPING = ("count", "hot pixels")  # stages after which a map may still be refused


def _add_nothing(folder: Path) -> None:
    """What `finish` is by default."""


def run_cases(
    cases: Sequence[str], out: Path, settings: Settings, rig: str | None, seed: int, *,
    force: bool = False, workers: int = 1, finish: Callable[[Path], None] = _add_nothing,
    track: Callable[[Path, Path], None] | None = None, progress: Display = _SILENT,
) -> Results:  # fmt: skip
    """Simulates, maps and scores every case; `out` appears when all is done.

    Args:
        cases: names of scenes.
        out: folder to write.
        settings: every parameter.
        rig: name of the rig to use instead of each scene's own.
        seed: seed of the head motion.
        force: whether a run that is in the place of `out` is replaced.
        workers: rendering processes.
        finish: adds, such as a report, to the folder of results before it takes its place.
        track: finds the poses of a recording, its first argument, from its events, and writes them
            into a folder, its second; they, and maps on them, are then scored, too.
        progress: shows how far the run is.
    """
    from eventsweep.eval.scoring import run_folder

    _check_run(cases, settings, rig, track=track is not None)
    with atomic_dir(out, force=force, inputs=_inputs(cases, settings, rig)) as folder:
        (folder / run_folder.CONFIG_FILE).write_text(settings.to_toml(), encoding="utf-8")
        for case in cases:
            of_case = folder / case_name(case)
            sequence = of_case / run_folder.SEQUENCE_FOLDER
            with _kernels_beside(case, settings, rig, progress):
                simulate_scene(
                    case, sequence, settings, rig, seed, workers=workers, progress=progress
                )
            map_recording(sequence, of_case / run_folder.MAP_FOLDER, settings, progress=progress)
            if track is not None:
                track(sequence, of_case / run_folder.TRACK_FOLDER)
                _map_on_own_poses(of_case, settings.map, progress)
        results = score_folder(folder, settings.score)
        finish(folder)
    return results


def _kernels_beside(
    case: str, settings: Settings, rig: str | None, progress: Display
) -> AbstractContextManager[None]:
    """On a first run the mapper's kernels are compiled while a case is simulated."""
    from eventsweep import scenes
    from eventsweep.emvs.rehearsal import compiled_beside

    cameras = scenes.rig_for(case, rig, settings.sim)
    return compiled_beside(settings.map, cameras, progress.say)


def _map_on_own_poses(of_case: Path, config: MapperConfig, progress: Display) -> None:
    """Maps the windows of a case again, on the poses that were found."""
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.maps.folder import read_map
    from eventsweep.emvs.windows import Window
    from eventsweep.eval.found_poses import found_poses
    from eventsweep.eval.own_poses import map_on_poses
    from eventsweep.eval.scoring import run_folder

    info = read_map(of_case / run_folder.MAP_FOLDER).info
    lost = (0,) * len(info.windows[0].counts)
    windows = {w.name: Window(w.t0_us, w.t1_us, w.t_ref_us, lost) for w in info.windows}
    with progress.stage(f"map {info.recording.name} on its own poses", 1) as update:
        map_on_poses(
            open_recording(of_case / run_folder.SEQUENCE_FOLDER),
            found_poses(of_case / run_folder.TRACK_FOLDER), windows, config,
            of_case / run_folder.TRACKED_MAP_FOLDER, info.recording,
        )  # fmt: skip
        update(1, "")


def simulate_scene(
    scene: str, out: Path, settings: Settings, rig: str | None, seed: int, *, force: bool = False,
    workers: int = 1, fresh: bool = False, progress: Display = _SILENT,
) -> None:  # fmt: skip
    """Simulates one scene, with its own rig or another one, and writes the sequence.

    Unfinished work of the same arguments is taken up, unless `fresh` says to discard it.
    """
    with (
        progress.stage(f"simulate {case_name(scene)}", 1) as update,
        _collection_paused() as resume,
    ):
        from eventsweep import scenes
        from eventsweep.emvs.data.sequence import Sequence as EventSequence
        from eventsweep.sim.simulate import simulate

        def show(_stage: str, done_us: int, total_us: int) -> None:
            resume()  # the first picture is there: nothing is imported any more
            update(done_us / total_us, f"{done_us / 1e3:.0f} ms")

        simulate(
            *scenes.prepared(scene, rig, settings.sim, seed, progress.say),
            seed,
            out,
            force=force,
            workers=workers,
            resume=not fresh,
            notice=progress.say,
            progress=show,
        )
        made = EventSequence.open(out).manifest
        words = f"{(made.span_us[1] - made.span_us[0]) / 1e3:.0f} ms"
        update(1.0, f"{words}, {sum(made.event_counts):,} events")


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


def score_folder(
    folder: Path, config: EvalConfig, predictions: Sequence[Path | str] = ()
) -> Results:
    """Scores every map of a run, or the one map that the folder is.

    Writes `results.json` and `results.csv` into the folder, and predictions beside them as they
    were scored: folders with depth maps of others, `DIR` or `NAME=DIR`. Windows without ground
    truth at their reference time are left out, and counted in the configuration of their case.

    Raises:
        InputError: no map there, a recording without ground truth, damaged files, or a prediction
            that is not complete.
    """
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.predictions import NamedFolder
    from eventsweep.eval.scoring.results import write_results

    given = tuple(map(NamedFolder.of, predictions))
    names = (*_RESULTS, run_folder.KEPT_FOLDER) if predictions else _RESULTS
    maps = run_folder.find_maps(folder)
    check_files(folder, names, force=True)
    with output_folder(folder, names, force=True):
        with run_folder.kept_predictions(folder, [entry.path for entry in given]) as kept:
            results = _scored(folder, maps, config, given, kept)
        with files_together(folder, _RESULTS) as staged:
            write_results(staged, results)
    return results


def _estimates(
    case: str, sequence: run_folder.Scored, windows: Sequence[StoredWindow], config: EvalConfig,
    folders: Sequence[NamedFolder], kept: Path,
) -> Iterator[Mapping[str, Estimate]]:  # fmt: skip
    """The depth maps of others for each window, by name; all are checked first, and kept."""
    from eventsweep.eval.scoring.predictions import estimates_of, open_predictions
    from eventsweep.eval.scoring.run_folder import keep, target_view

    views = [target_view(sequence, window, config) for window in windows]
    opened = open_predictions(folders, case, views)

    def read() -> Iterator[Mapping[str, Estimate]]:
        for view in views:
            estimates = estimates_of(opened, view)
            keep(kept, case, view.t_us, estimates)
            yield estimates

    return read()


def _scored(
    folder: Path, maps: Mapping[str, StoredMap], config: EvalConfig,
    folders: Sequence[NamedFolder], kept: Path,
) -> Results:  # fmt: skip
    from eventsweep.emvs.data.sequence import Sequence as EventSequence
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.metric_versions import metric_versions
    from eventsweep.eval.scoring.pairing import REFERENCE
    from eventsweep.eval.scoring.results import Results, together
    from eventsweep.eval.scoring.score import rig_rows, score_windows
    from eventsweep.eval.scoring.trajectories.own_poses import pose_rows
    from eventsweep.eval.scoring.trajectories.score import metric_versions as trajectory_versions

    tables: list[pd.DataFrame] = []
    sequences, versions = {}, metric_versions()
    configuration: dict[str, Any] = {"score": config.model_dump(mode="json")}
    for case, stored in maps.items():
        sequence = run_folder.sequence_of(stored)
        windows = run_folder.with_truth(stored, sequence, config)
        # Without predictions nothing is read to check them against.
        others = (case, sequence, windows, config, folders, kept)
        estimates = _estimates(*others) if folders else None
        own = run_folder.tracked(folder, case)
        if own is not None:
            estimates = _with_own(own.map, windows, estimates)
        tables += [
            score_windows(case, sequence, windows, config, estimates, REFERENCE),
            rig_rows(case, sequence, [window.info for window in windows]),
        ]
        if isinstance(sequence, EventSequence):
            sequences[case] = sequence.manifest
        configuration[case] = {
            **run_folder.provenance(sequence),
            "map": stored.info.config.model_dump(mode="json"),
        }
        if own is not None:
            rows, notes = pose_rows(case, sequence.trajectory, own.poses)
            tables.append(rows)
            maps_on = {"windows": len(own.map.windows), "skipped": len(own.map.info.skipped)}
            configuration[case]["track"] = {**maps_on, "notes": list(notes)}
            versions |= trajectory_versions()
        if len(windows) < len(stored.windows):
            counts = {"scored": len(windows), "without_truth": len(stored.windows) - len(windows)}
            configuration[case]["windows"] = counts
    seeds = {manifest.seed for manifest in sequences.values()}
    return Results(
        together(tables),
        configuration,
        seeds.pop() if len(seeds) == 1 else None,
        {case: manifest.digest() for case, manifest in sequences.items()},
        metrics=versions,
    )


def _with_own(
    own: StoredMap, windows: Sequence[StoredWindow],
    others: Iterator[Mapping[str, Estimate]] | None,
) -> Iterator[Mapping[str, Estimate]]:  # fmt: skip
    """Depth maps on poses that were found, beside those of others, for each window."""
    from eventsweep.eval.scoring.trajectories.own_poses import own_estimates

    mapped = own_estimates(own, windows)
    return mapped if others is None else ({**a, **b} for a, b in zip(others, mapped, strict=True))


def _check_run(cases: Sequence[str], settings: Settings, rig: str | None, *, track: bool) -> None:
    """Refuses before the first frame what would fail after the last."""
    if len(set(map(case_name, cases))) != len(cases) or not cases:
        raise InputError(
            f"cases {', '.join(cases) or '(none)'}: name at least one, without repeats"
        )
    for case in cases:
        check_case(case, rig, settings.map, settings.sim, track=track)


def _inputs(*given: object) -> list[object]:
    """What is read: of models also the files that they name."""
    from eventsweep.sim.mjcf import SUFFIXES, files_of

    models = [path for path in inputs_of(*given) if path.suffix.lower() in SUFFIXES]
    return [*given, *map(files_of, models)]


def check_case(
    scene: str, rig: str | None, config: MapperConfig, sim: SimConfig | None = None, *,
    track: bool = False,
) -> None:  # fmt: skip
    """Refuses, before a scene is simulated, what could not be simulated, mapped or tracked."""
    from eventsweep import scenes
    from eventsweep.emvs import methods
    from eventsweep.emvs.dsi.device import check_device
    from eventsweep.emvs.utils.runtime import check_openmp
    from eventsweep.sim.mjcf import is_model_file

    check_openmp()
    configured = sim or SimConfig()
    if not is_model_file(scene):
        scenes.load(scene).configured(configured)
    chosen = scenes.rig_for(scene, rig, configured)
    methods.methods_by_name(config.methods, len(chosen), mcemvs=config.is_mcemvs)
    if track and len(chosen) < 2:
        raise InputError(
            f"{scene}: one camera cannot determine the scale of its poses: choose a stereo rig"
        )
    check_device(config.device)


def map_recording(
    path: Path, out: Path, settings: Settings, *, force: bool = False,
    finish: Callable[[Path], None] = _add_nothing, warn: Callable[[str], None] | None = None,
    progress: Display = _SILENT,
) -> StoredMap:  # fmt: skip
    """Maps one window of a recording and writes the map folder.

    With `window_s` or `window_events` it maps sliding windows: `out` grows window by window, and
    the same call takes up an unfinished one (`emvs.maps.sliding`). `finish` is that of
    `map_windows`, called when the bars of the mapping have ended, so that it may show its own.
    `warn` is called, when mapping begins, with a line on each thing that looks doubtful or wrong to
    the checks of plug-ins; without it nothing is checked. What is refused is refused before that.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.maps.folder import RecordingInfo, StoredMap
    from eventsweep.emvs.maps.sliding import map_windows

    recording = open_recording(path)
    about = RecordingInfo.of(recording, path, out)
    with MapBars(progress, f"map {recording.name}") as bars:

        def end(folder: Path) -> None:
            bars.close()
            finish(folder)

        steps = bars if warn is None else _checking(recording, settings.map, warn, bars)
        info = map_windows(recording, out, settings.map, about, steps, force=force, finish=end)
    return StoredMap(out, info)


def _checking(
    recording: Recording, config: MapperConfig, warn: Callable[[str], None],
    progress: Progress,
) -> Progress:  # fmt: skip
    """A progress that checks the recording once, at the first step of mapping.

    A check is what a plug-in offers in the group `eventsweep.checks`: a function of the recording
    and the configuration that returns lines.
    """
    from eventsweep.emvs.utils.plugins import CHECKS, loaded, points

    waiting = [True]

    def step(stage: str, done: int, total: int) -> None:
        if waiting and stage not in _BEFORE_MAPPING:
            waiting.clear()
            for point in points(CHECKS):
                for doubt in loaded(point, "its check {} cannot be used")(recording, config):
                    warn(doubt)
        progress(stage, done, total)

    return step
