"""Mapping for users of the library: all that `eventsweep map` does, but for the report."""

from __future__ import annotations

from pathlib import Path

from emvs import mapper
from emvs.config import MapperConfig
from emvs.data.recording import Recording
from emvs.datasets import open_recording
from emvs.errors import InputError
from emvs.maps import sliding
from emvs.maps.folder import RecordingInfo, StoredMap, read_map
from emvs.preflight import check_window_fits
from emvs.utils.runtime import Progress, silent
from emvs.window_result import WindowResult
from emvs.windows import choose_window


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
            "sliding windows were asked for: call map_windows, or leave out window_s and "
            "window_events"
        )
    window = choose_window(recording, config)
    check_window_fits(recording, window)
    hot = sliding.find_hot(recording, config, window.t0_us, window.t1_us, progress)
    filtered = sliding.without(recording, hot)
    return mapper.map_window(filtered, config, progress, window=window)


def map_windows(
    recording: Recording | str | Path,
    out: str | Path,
    config: MapperConfig,
    *,
    force: bool = False,
    clouds: bool = True,
    progress: Progress = silent,
) -> StoredMap:
    """Maps a whole recording in sliding windows, into a folder that grows window by window.

    A call that was interrupted goes on where it was when it is made again.

    Args:
        recording: what `open_recording` gave, a recording of your own, or the path of one.
        out: the map folder: new, or of the same call.
        config: `window_s` or `window_events`, and everything else.
        force: whether to remove first what `out` holds.
        clouds: whether to write each window's point cloud.
        progress: called with the name of the stage, how much is done and how much there is.

    Returns:
        The map: `windows`, each with `depth_map(method)`; arrays are read when asked for.

    Raises:
        InputError: settings that suit no window, an output of another call, or no window that could
            be mapped.
    """
    recording, config, out = opened(recording), MapperConfig.or_default(config), Path(out)
    path = getattr(recording, "path", recording.name)
    about = RecordingInfo.of(recording, Path(path), out)
    sliding.map_windows(recording, out, config, about, progress, force=force, clouds=clouds)
    return read_map(out)


def opened(recording: Recording | str | Path) -> Recording:
    """A recording, or the one at a path."""
    return open_recording(recording) if isinstance(recording, str | Path) else recording
