"""Mapping for users of the library: what the verbs do, but for their pages."""

from __future__ import annotations

from concurrent.futures import Executor
from functools import partial
from pathlib import Path

from eventsweep.emvs import mapper
from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.datasets import opened
from eventsweep.emvs.errors import InputError, check_path
from eventsweep.emvs.maps import sliding
from eventsweep.emvs.maps.first_pass import settled
from eventsweep.emvs.maps.folder import RecordingInfo, StoredMap, read_map
from eventsweep.emvs.methods import overview as methods
from eventsweep.emvs.methods import register as register_method
from eventsweep.emvs.preflight import check_window_fits
from eventsweep.emvs.utils.cache import default_cache
from eventsweep.emvs.utils.runtime import Progress, silent
from eventsweep.emvs.window_result import WindowResult
from eventsweep.emvs.windows import choose_window
from eventsweep.eval.jobs.executor import executor_workers
from eventsweep.eval.pipeline import windows_by
from eventsweep.eval.progress import SILENT

__all__ = [
    "map_window",
    "map_windows",
    "methods",
    "register_method",
]


def map_window(
    recording: Recording | str | Path,
    config: MapperConfig | None = None,
    *,
    progress: Progress = silent,
) -> WindowResult:
    """Maps one window of a recording by every requested method at once.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one.
        config: window, planes, methods, thresholds; by default all methods, and all events that
            the poses cover.
        progress: called with the name of the stage, how much is done and how much there is.

    Returns:
        Depth and confidence per method, and what became of the events; nothing is written.

    Raises:
        InputError: a window that events or poses do not cover, no events in it, an impossible depth
            range, an unknown method, a GPU that is not there, or too little memory.
    """
    recording, config = opened(recording), MapperConfig.or_default(config)
    if config.slides:
        raise InputError(
            "sliding windows are set: call map_windows, or leave out window_s and window_events"
        )
    window = choose_window(recording, config)
    check_window_fits(recording, window)
    config = settled(recording, config).config
    hot = sliding.find_hot(recording, config, window.t0_us, window.t1_us, progress)
    filtered = sliding.without(recording, hot)
    return mapper.map_window(filtered, config, progress, window=window)


def map_windows(
    recording: Recording | str | Path,
    out: str | Path,
    config: MapperConfig | None = None,
    *,
    force: bool = False,
    clouds: bool = True,
    progress: Progress = silent,
    executor: Executor | None = None,
    cache: str | Path | None = None,
) -> StoredMap:
    """Maps a recording into a folder: in sliding windows, or, without `window_s`, in one window.

    A folder of sliding windows grows window by window; a call that was interrupted goes on where it
    was when it is made again. The folder of one window appears whole or not at all.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one.
        out: the map folder: new, or, with sliding windows, of the same call.
        config: `window_s` or `window_events` for sliding windows, and everything else; by default
            one window of all events that the poses cover, by all methods.
        force: whether to remove first what `out` holds.
        clouds: whether to write each window's point cloud.
        progress: called with the name of the stage, how much is done and how much there is.
        executor: maps sliding windows, such as one of processes, MPI, Ray or Parsl; it stays open.
            Its workers need this version of the code, a thread each, and the cache's folder.
        cache: folder of windows that an executor mapped; by default that of the command line.

    Returns:
        The map: `windows`, each with `depth_map(method)`; arrays are read when asked for.

    Raises:
        InputError: settings that suit no window, an output that exists or is of another call, or no
            window that could be mapped.
    """
    check_path("out", out)
    config, out = MapperConfig.or_default(config), Path(out)
    given = recording if isinstance(recording, str | Path) else getattr(recording, "path", None)
    recording = opened(recording)
    path = getattr(recording, "path", recording.name)
    about = RecordingInfo.of(recording, Path(path), out)
    elsewhere = None
    if executor is not None:
        elsewhere = _elsewhere(executor, given, config, cache, clouds=clouds)
    sliding.map_windows(
        recording, out, config, about, progress, force=force, clouds=clouds, elsewhere=elsewhere
    )
    return read_map(out)


def _elsewhere(
    executor: Executor, path: str | Path | None, config: MapperConfig, cache: str | Path | None,
    *, clouds: bool,
) -> sliding.Elsewhere:  # fmt: skip
    """What maps windows by an executor, whose workers open the recording themselves."""
    if not config.slides:
        raise InputError("an executor maps sliding windows: set window_s or window_events")
    if path is None:
        raise InputError(
            "an executor's workers open the recording themselves: give its path as recording"
        )
    store = Path(cache) if cache is not None else default_cache()
    crew = partial(executor_workers, executor, store.absolute())
    return windows_by(crew, Path(path), store, SILENT, clouds=clouds)
