"""Runs cases from a scene to a report, scores folders, and maps recordings."""

from __future__ import annotations

import json
import logging
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.utils.outputs import atomic_dir, check_files, files_together, output_folder
from eventsweep.eval.config import EvalConfig, Settings
from eventsweep.eval.progress import SILENT, Display, MapBars
from eventsweep.scenes import case_name

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from eventsweep.emvs.data.recording import Recording
    from eventsweep.emvs.maps.folder import MapInfo, StoredMap, StoredWindow
    from eventsweep.emvs.maps.sliding import Elsewhere, Hot, Take
    from eventsweep.emvs.utils.cache import Cache
    from eventsweep.emvs.utils.runtime import Progress
    from eventsweep.emvs.windows import Window
    from eventsweep.eval.jobs.job import Job, Outcome
    from eventsweep.eval.jobs.scheduler import Open
    from eventsweep.eval.results.results import Results
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.pairing import Estimate
    from eventsweep.eval.scoring.predictions import NamedFolder

_log = logging.getLogger(__name__)
_RESULTS = ("results.json", "results.csv")
_BEFORE_MAPPING = ("count", "hot pixels")  # stages after which a map may still be refused


def _add_nothing(folder: Path) -> None:
    """What `finish` is by default."""


class Watch:
    """Receives what a run makes, as soon as it is made; this one ignores it."""

    def sequence(self, case: str, folder: Path) -> None:
        """A case was simulated into a folder."""

    def maps(self, case: str, folder: Path) -> None:
        """A case was mapped into a folder."""


_UNWATCHED = Watch()


def run_cases(
    cases: Sequence[str], out: Path, settings: Settings, rig: str | None, seed: int, *,
    force: bool = False, renderers: int = 1, finish: Callable[[Path], None] = _add_nothing,
    tracker: str | None = None, cache: Path | None = None, crew: Open | None = None,
    progress: Display = SILENT, watch: Watch = _UNWATCHED,
) -> Results:  # fmt: skip
    """Simulates, maps and scores every case; `out` appears when all is done.

    Its jobs are those of a suite: what is finished is in the cache, so a run that was interrupted
    goes on there, and one with other methods does not simulate again.

    Args:
        cases: names of scenes, or model files.
        out: folder to write.
        settings: every parameter.
        rig: name of the rig to use instead of each scene's own.
        seed: seed of the head motion.
        force: whether a run that is in the place of `out` is replaced.
        renderers: rendering processes.
        finish: adds, such as a report, to the folder of results before it takes its place.
        tracker: finds poses from the events, too; they, and maps on them, are then scored.
        cache: where jobs' results are kept; by default that of suites.
        crew: opens workers that do the jobs; by default they are done here, one after another.
        progress: shows how far the run is.
        watch: receives what was made, case by case.
    """
    from eventsweep.emvs.utils.cache import Cache, default_cache
    from eventsweep.eval.jobs.job import RESULT, SEQUENCE, Runtime, entry
    from eventsweep.eval.results.results import joined, results_from, write_results
    from eventsweep.eval.scoring import run_folder

    jobs = _planned(cases, settings, rig, seed, tracker)
    store, runtime = Cache(cache or default_cache()), Runtime(renderers, True, progress)
    with atomic_dir(out, force=force, inputs=(cases, settings, rig)) as folder:
        (folder / run_folder.CONFIG_FILE).write_text(settings.to_toml(), encoding="utf-8")
        if crew is not None:
            _done_by(crew, jobs.values(), progress)
        parts = []
        for case, job in jobs.items():
            sequence, mapped = job.needs[:2]
            with _kernels_beside(case, settings, rig, progress):
                drawn = entry(sequence, store, runtime)
            watch.sequence(case_name(case), drawn.path / SEQUENCE)
            maps = entry(mapped, store, runtime)
            watch.maps(case_name(case), maps.path / run_folder.MAP_FOLDER)
            made = entry(job, store, runtime)
            _place(job, store, folder / case_name(case))
            text = (made.path / RESULT).read_text(encoding="utf-8")
            parts.append(results_from(json.loads(text)))
        scored = {"score": settings.score.model_dump(mode="json")}
        results = joined(parts, configuration=scored)
        write_results(folder, results)
        finish(folder)
    return results


def _planned(
    cases: Sequence[str], settings: Settings, rig: str | None, seed: int, tracker: str | None
) -> dict[str, Job]:
    """The jobs, by case; what would fail after the last frame is refused before the first."""
    from eventsweep.eval.suite.plan import check_case, run_job
    from eventsweep.eval.trackers import tracker as load_tracker

    if len(set(map(case_name, cases))) != len(cases) or not cases:
        raise InputError(
            f"cases {', '.join(cases) or '(none)'}: name at least one, without repeats"
        )
    if tracker is not None:
        load_tracker(tracker)
    for case in cases:
        check_case(case, rig, settings.map, settings.sim, track=tracker is not None)
    return {case: run_job(case, settings, rig, seed, tracker) for case in cases}


def _done_by(crew: Open, jobs: Iterable[Job], progress: Display) -> None:
    from eventsweep.eval.jobs.job import Failed
    from eventsweep.eval.jobs.scheduler import run_jobs

    outcomes = run_jobs(jobs, crew, progress)
    failed = [outcome for outcome in outcomes.values() if isinstance(outcome, Failed)]
    if failed:
        raise InputError(f"{failed[0].name}: {failed[0].reason}")


def _place(job: Job, store: Cache, folder: Path) -> None:
    """Puts what the jobs of a case made where people look for it."""
    from eventsweep.emvs.utils.files import link_tree
    from eventsweep.eval.jobs.job import SEQUENCE, entry
    from eventsweep.eval.results.results import DEFAULT_MAPPER
    from eventsweep.eval.scoring import run_folder

    sequence, mapped, *tracked = (entry(need, store).path for need in job.needs)
    places = {
        run_folder.SEQUENCE_FOLDER: sequence / SEQUENCE,
        run_folder.MAP_FOLDER: mapped / run_folder.MAP_FOLDER,
    }
    own = run_folder.TRACKED_MAP_FOLDER
    for made in tracked:
        places[run_folder.TRACK_FOLDER] = made / run_folder.TRACK_FOLDER
        places[own] = made / own / DEFAULT_MAPPER
    for name, source in places.items():
        link_tree(source, folder / name)


def _kernels_beside(
    case: str, settings: Settings, rig: str | None, progress: Display
) -> AbstractContextManager[None]:
    """On a first run the mapper's kernels are compiled while a case is simulated."""
    from eventsweep import scenes
    from eventsweep.emvs.rehearsal import compiled_beside

    cameras = scenes.rig_for(case, rig, settings.sim)
    return compiled_beside(settings.map, cameras, progress.say)


def score_folder(
    folder: Path, config: EvalConfig, predictions: Sequence[Path | str] = ()
) -> Results:
    """Scores every map of a run, or the one map that the folder is.

    Writes `results.json` and `results.csv` into the folder, and predictions beside them as they
    were scored: folders with depth maps of others, `DIR` or `NAME=DIR`. Windows without ground
    truth at their reference time are left out, and counted in the configuration of their case. Of
    a recording without any, the maps are only described (`eval.scoring.case.describe_case`).

    Raises:
        InputError: no map there, predictions for a recording without ground truth, damaged files,
            or a prediction that is not complete.
    """
    from eventsweep.eval.results.results import write_results
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.predictions import NamedFolder

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
    from eventsweep.emvs.datasets.posed import PosedRecording
    from eventsweep.eval.results.results import DEFAULT_MAPPER, joined
    from eventsweep.eval.scoring import run_folder
    from eventsweep.eval.scoring.case import CaseMaps, describe_case, score_case

    parts = []
    for name, stored in maps.items():
        recording = run_folder.verified(stored)
        if isinstance(recording, PosedRecording) and not (
            folders or run_folder.has_any_truth(recording)
        ):
            parts.append(describe_case(CaseMaps.of_map(name, recording, stored)))
            continue
        run_folder.check_view(stored.info.config, str(stored.path))
        recording = run_folder.with_ground_truth(recording)
        case = CaseMaps.of_map(name, recording, stored, run_folder.tracked(folder, name))
        windows = case.with_truth(config).windows[DEFAULT_MAPPER]
        # Without predictions nothing is read to check them against.
        others = _estimates(name, recording, windows, config, folders, kept) if folders else None
        parts.append(score_case(case, config, others))
    return joined(parts, configuration={"score": config.model_dump(mode="json")})


def map_recording(
    path: Path, out: Path, settings: Settings, *, force: bool = False,
    finish: Callable[[Path], None] = _add_nothing, warn: Callable[[str], None] | None = None,
    note: Callable[[str], None] = _log.warning, progress: Display = SILENT,
    crew: Open | None = None, cache: Path | None = None,
) -> StoredMap:  # fmt: skip
    """Maps one window of a recording and writes the map folder.

    With `window_s` or `window_events` it maps sliding windows: `out` grows window by window, and
    the same call takes up an unfinished one (`emvs.maps.sliding`). `finish` is that of
    `map_windows`, called when the bars of the mapping have ended, so that it may show its own.
    `warn` is called, when mapping begins, with a line on each thing that looks doubtful or wrong to
    the checks of plug-ins; without it nothing is checked. What is refused is refused before that.
    `note` is called with a line if the depth range is a guess; a range that was found is shown
    with the progress. `crew` opens workers that map the sliding windows, which the cache then has,
    too; by default they are mapped here, one after another.
    """
    from eventsweep.emvs.datasets import open_recording
    from eventsweep.emvs.maps.first_pass import settled
    from eventsweep.emvs.maps.folder import RecordingInfo, StoredMap
    from eventsweep.emvs.maps.sliding import check_out, map_windows

    recording = open_recording(path)
    about = RecordingInfo.of(recording, path, out)
    check_out(out, settings.map, force=force)
    chosen = settled(recording, settings.map, note)
    if chosen.found:
        progress.say(chosen.found)
    with MapBars(progress, f"map {recording.name}") as bars:

        def end(folder: Path) -> None:
            bars.close()
            finish(folder)

        steps = bars if warn is None else _checking(recording, chosen.config, warn, bars)
        elsewhere = None if crew is None else windows_by(crew, path, cache, progress)
        info = map_windows(
            recording, out, chosen.config, about, steps,
            force=force, finish=end, elsewhere=elsewhere,
        )  # fmt: skip
    return StoredMap(out, info)


def windows_by(
    crew: Open, path: Path, cache: Path | None, progress: Display, *, clouds: bool = True
) -> Elsewhere:
    """What maps windows of the recording at a path by jobs, done by the workers that `crew` opens.

    A worker that dies takes no window along; one that no worker can map for a reason other than
    the input ends the run, after the others.
    """
    from eventsweep.emvs.utils.cache import Cache, default_cache
    from eventsweep.eval.jobs.job import Failed, stored
    from eventsweep.eval.jobs.scheduler import run_jobs
    from eventsweep.eval.stages.window import window_job

    store = Cache(cache or default_cache())

    def by_jobs(head: MapInfo, windows: Mapping[str, Window], hot: Hot, take: Take) -> None:
        jobs = {
            f"map/{name}": (name, window_job(path, head, name, window, hot, clouds=clouds))
            for name, window in windows.items()
        }
        broken: list[Failed] = []

        def over(outcome: Outcome) -> None:
            name, job = jobs[outcome.name]
            if not isinstance(outcome, Failed):
                made = stored(job, store)
                if made is None:
                    raise InputError(
                        f"{outcome.name}: its worker keeps it in another folder than {store.folder}"
                        ": workers need to share the cache; name one that all of them see"
                    )
                take(name, made.path)
            elif outcome.again:
                broken.append(outcome)
            else:
                take(name, outcome.reason)

        run_jobs([job for _, job in jobs.values()], crew, progress, over)
        if broken:
            raise InputError(f"{broken[0].name}: {broken[0].reason}; the other windows are kept")

    return by_jobs


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
