"""From a recording to a map folder: one window, or sliding windows.

Every window goes the same way: it is checked, mapped and written (`map_into`). A single one appears
with its folder, whole or not at all; sliding windows take constant memory, appear one by one, and a
run that was stopped goes on where it was.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.dsi.device import Device, check_device, projector_on
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.hot_pixels import HotPixels, WithoutPixels, find_hot_pixels
from eventsweep.emvs.mapper import check_request, map_window
from eventsweep.emvs.maps.first_pass import settled
from eventsweep.emvs.maps.folder import (
    SCHEMA_VERSION,
    HotPixelInfo,
    MapInfo,
    RecordingInfo,
    SkippedWindow,
    WindowInfo,
    read_info,
    write_index,
    write_window,
)
from eventsweep.emvs.maps.identity import content_hash
from eventsweep.emvs.maps.store import MapStore, open_store, read_entry, write_entry
from eventsweep.emvs.methods import device_for_methods, methods_by_name
from eventsweep.emvs.preflight import check_view_fits, check_window_fits
from eventsweep.emvs.reference_view import reference_view
from eventsweep.emvs.utils.files import DiskFull, link_tree, names_full_disk
from eventsweep.emvs.utils.outputs import CURE, atomic_dir, check_output, real
from eventsweep.emvs.utils.runtime import Progress, silent, versions
from eventsweep.emvs.windows import Window, WindowPlan, check_poses, choose_window, plan_windows

# The hot pixels of every camera; None where the filter is off
Hot = tuple[HotPixels, ...] | None
Take = Callable[[str, Path | str], None]
"""Takes over a window by its name: the folder of its maps, or why it cannot be mapped."""
Elsewhere = Callable[[MapInfo, Mapping[str, Window], Hot, Take], None]
"""Maps windows, given by name, in other processes, in any order."""
_SINGLE = "w000"


def map_windows(
    recording: Recording,
    out: Path,
    config: MapperConfig,
    about: RecordingInfo,
    progress: Progress = silent,
    *,
    force: bool = False,
    clouds: bool = True,
    finish: Callable[[Path], None] = lambda _folder: None,
    elsewhere: Elsewhere | None = None,
) -> MapInfo:
    """Maps a recording into a map folder: one window, or sliding windows.

    The folder of one window appears whole or not at all. Of sliding windows every one is on disk,
    whole, before the next one begins. A run that was stopped at any moment goes on where it was
    when called again with the same arguments, and ends with the same bytes. A sliding window that
    cannot be mapped is left out and named in `skipped`.

    Args:
        recording: events, poses and calibration.
        out: the map folder: new, or, with sliding windows, of the same run.
        config: `window_s` or `window_events` for sliding windows, and everything else; what it
            leaves to the recording is settled first (`emvs.maps.first_pass`); `map.json` keeps it.
        about: what `map.json` says of the recording.
        progress: called with `count`, `hot pixels`, then, with sliding windows, `windows` done and
            all, with the stages of `map_window` and `write` in between.
        force: whether a map that `out` holds is replaced, when the new one is done.
        clouds: whether to write each window's `cloud.ply`.
        finish: adds to the folder that holds all windows, such as a report; that of one window has
            not taken its place yet.
        elsewhere: maps sliding windows; by default they are mapped here, one after another.

    Returns:
        What `map.json` says in the end.

    Raises:
        InputError: settings that suit no window, an output that exists or is of another run, or no
            window that could be mapped; of sliding windows the reasons are in `map.json`.
    """
    check_out(out, config, force=force)
    config = settled(recording, config).config
    if config.slides:
        _map_sliding(
            recording, out, config, about, progress,
            force=force, clouds=clouds, finish=finish, elsewhere=elsewhere,
        )  # fmt: skip
        return read_info(out)
    inputs = _inputs(out, about, config)
    window, hot = one_window(recording, config, out, progress)
    with atomic_dir(out, force=force, inputs=inputs) as folder:
        kept, place = without(recording, hot), folder / _SINGLE
        info = map_into(place, kept, config, window, progress, clouds=clouds)
        write_index(folder, about, config, [info], described(recording.rig, hot))
        finish(folder)
    return read_info(out)


def check_out(out: Path, config: MapperConfig, *, force: bool) -> None:
    """Refuses an output that exists; one of sliding windows may, and is compared when opened."""
    if not config.slides:
        check_output(out, force=force)


def _inputs(out: Path, about: RecordingInfo, config: MapperConfig) -> tuple[object, ...]:
    """What is read: the recording, whose path `map.json` may give from its own folder, and more."""
    return (real(out) / about.path).resolve(), config


def one_window(
    recording: Recording, config: MapperConfig, out: Path, progress: Progress = silent
) -> tuple[Window, Hot]:
    """Chooses and checks the one window that settings without sliding windows ask for.

    Its maps will lie in `out`, which need not exist; `progress` is called with `hot pixels`.

    Returns:
        The window, and the hot pixels in it.
    """
    check_settings(recording, config, out)
    window = choose_window(recording, config)
    check_window_fits(recording, window)
    return window, find_hot(recording, config, window.t0_us, window.t1_us, progress)


def map_into(
    folder: Path,
    recording: Recording,
    config: MapperConfig,
    window: Window,
    progress: Progress = silent,
    *,
    device: Device | None = None,
    clouds: bool = True,
    name: str | None = None,
) -> WindowInfo:
    """Maps a window that was checked, writes its folder and returns its entry of `map.json`.

    Args:
        folder: such as `MAP/w000`, in a folder that the caller writes atomically.
        recording: without its hot pixels, if they are to be left out.
        config: planes, methods, thresholds.
        window: which events.
        progress: called with the stages of `map_window`, then `write`.
        device: what computes; by default what the configuration says.
        clouds: whether to write `cloud.ply`.
        name: of the window; by default its folder's.
    """
    result = map_window(
        recording, config, progress, window=window, dsi_dir=folder / "dsi", device=device
    )
    progress("write", 0, 1)
    names = recording.rig.camera_names
    return write_window(folder, result, config, names, clouds=clouds, name=name)


def map_sliding_into(
    folder: Path, recording: Recording, config: MapperConfig, window: Window,
    progress: Progress = silent, *, device: Device, clouds: bool, name: str,
) -> None:  # fmt: skip
    """Maps one of the sliding windows into a folder, with its entry; arguments as of `map_into`.

    Raises:
        InputError: it cannot be mapped: poses lie too far apart, or there are too few events.
    """
    check_poses(recording.trajectory, window.t0_us, window.t1_us, config)
    check_window_fits(recording, window)
    info = map_into(
        folder, recording, config, window, progress, device=device, clouds=clouds, name=name
    )
    write_entry(folder, info)


NO_MEMORY = "not enough memory: choose a shorter window"


def check_settings(recording: Recording, config: MapperConfig, out: Path) -> None:
    """Refuses, before any event is read, settings that suit no window of a recording."""
    requested = methods_by_name(config.methods, len(recording.rig), mcemvs=config.is_mcemvs)
    check_device(config.device)
    view = reference_view(recording, config, recording.trajectory.span_us[0])
    check_request(config, view, out)
    check_view_fits(view, len(requested), config, out)


def find_hot(
    recording: Recording, config: MapperConfig, t0_us: int, t1_us: int, progress: Progress = silent
) -> Hot:
    """The hot pixels of every camera, or None where the filter is off."""
    if config.hot_pixels == 0:
        return None
    return find_hot_pixels(recording, t0_us, t1_us, config.hot_pixels, progress)


def without(recording: Recording, hot: Hot) -> Recording:
    """The recording without its hot pixels; itself where the filter is off."""
    return recording if hot is None else WithoutPixels(recording, [camera.mask for camera in hot])


def described(rig: Rig, hot: Hot) -> dict[str, HotPixelInfo]:
    """What `map.json` says of hot pixels; nothing where the filter is off."""
    return {
        name: HotPixelInfo(
            pixels=tuple((int(x), int(y)) for y, x in np.argwhere(pixels.mask)),
            events=pixels.events,
        )
        for name, pixels in zip(rig.camera_names, hot or (), strict=hot is not None)
    }


def _map_sliding(
    recording: Recording, out: Path, config: MapperConfig, about: RecordingInfo,
    progress: Progress, *, force: bool, clouds: bool, finish: Callable[[Path], None],
    elsewhere: Elsewhere | None,
) -> None:  # fmt: skip
    requested = methods_by_name(config.methods, len(recording.rig), mcemvs=config.is_mcemvs)
    device = device_for_methods(config, requested)
    check_settings(recording, config, out)
    stretch = choose_window(recording, config)
    head = MapInfo(
        schema_version=SCHEMA_VERSION,
        recording=about,
        config=config,
        versions=versions(),
        windows=(),
        recording_sha256=content_hash(recording, stretch.t0_us, stretch.t1_us, poses=True),
        complete=False,
    )
    with open_store(out, head, force=force, inputs=_inputs(out, about, config)) as store:
        plan = plan_windows(recording, config, progress)
        hot = find_hot(recording, config, plan.stretch.t0_us, plan.stretch.t1_us, progress)
        lost = zip(recording.rig.camera_names, plan.stretch.left_out, strict=True)
        store.begin(head)
        facts = {"hot_pixels": described(recording.rig, hot), "without_pose": dict(lost)}
        run = _Run(head.model_copy(update=facts), plan, store, clouds, progress, device)
        with run.says_what_is_kept():
            if elsewhere is None:
                skipped = run.here(without(recording, hot))
            else:
                skipped = run.by(elsewhere, hot)
            if len(skipped) == len(plan):
                raise InputError(
                    f"none of {len(plan)} windows could be mapped; {skipped[0].name}: "
                    f"{skipped[0].reason}"
                )
            finish(store.path)


@dataclass
class _Run:
    """One run of sliding windows: what stays the same from window to window."""

    head: MapInfo
    plan: WindowPlan
    store: MapStore
    clouds: bool
    progress: Progress
    device: Device

    def here(self, recording: Recording) -> list[SkippedWindow]:
        """Maps what is not there yet, one window after another."""
        left = (k for k in range(len(self.plan)) if not self.store.has(self.plan.name(k)))
        ahead = [self.plan.window(k) for k in left]
        with projector_on(self.device).reading(recording, ahead) as kept:
            return self._all_windows(kept)

    def by(self, elsewhere: Elsewhere, hot: Hot) -> list[SkippedWindow]:
        """Has others map what is not there yet; the index is written however this ends."""
        windows = {self.plan.name(k): self.plan.window(k) for k in range(len(self.plan))}
        waiting = {name: one for name, one in windows.items() if not self.store.has(name)}
        for name in windows.keys() - waiting.keys():
            _check_entry(self.store.path / name, windows[name], self.device)
        skipped: list[SkippedWindow] = []
        complete, tried = False, 0

        def take(name: str, made: Path | str) -> None:
            skipped.extend(self._taken(name, made, waiting[name]))
            if self.store.index_is_due:
                self._index(skipped, 0, complete=False)

        try:
            elsewhere(self.head, waiting, hot, take)
            complete, tried = True, len(self.plan)
        finally:
            skipped.sort(key=lambda window: window.name)
            self._index(skipped, tried, complete=complete)
        return skipped

    def _taken(self, name: str, made: Path | str, window: Window) -> Iterable[SkippedWindow]:
        """Takes over a window that was mapped elsewhere; gives back one that could not be."""
        if isinstance(made, str):
            yield SkippedWindow(name=name, t0_us=window.t0_us, t1_us=window.t1_us, reason=made)
            return
        _check_entry(made, window, self.device)
        with self.store.window(name) as folder:
            link_tree(made, folder)

    def _all_windows(self, recording: Recording) -> list[SkippedWindow]:
        """Maps what is not there yet; the index is written however this ends."""
        skipped: list[SkippedWindow] = []
        complete, tried = False, 0
        try:
            for k in range(len(self.plan)):
                self.progress("windows", k, len(self.plan))
                skipped += self._skipped(recording, k)
                tried = k + 1
                if self.store.index_is_due:
                    self._index(skipped, tried, complete=False)
            self.progress("windows", tried, tried)
            complete = True
        finally:
            self._index(skipped, tried, complete=complete)
        return skipped

    @contextmanager
    def says_what_is_kept(self) -> Iterator[None]:
        """A disk that is full stops the run, which goes on from the windows that are finished."""
        try:
            with names_full_disk(self.store.path):
                yield
        except DiskFull as error:
            done = sum(self.store.has(self.plan.name(k)) for k in range(len(self.plan)))
            raise DiskFull(
                f"{error.fault}; {done} of {len(self.plan)} windows are finished and kept: make "
                "room, and the same again goes on from there"
            ) from error.__cause__

    def _skipped(self, recording: Recording, k: int) -> Iterable[SkippedWindow]:
        """Maps a window that is not there yet; gives it back where that cannot be done."""
        name, window = self.plan.name(k), self.plan.window(k)
        if self.store.has(name):
            _check_entry(self.store.path / name, window, self.device)
            return ()
        try:
            self._map(recording, name, window)
        except DiskFull:
            raise  # the next windows would meet it, too
        except InputError as error:
            reason = str(error)
        except MemoryError:
            reason = NO_MEMORY
        else:
            return ()
        return (SkippedWindow(name=name, t0_us=window.t0_us, t1_us=window.t1_us, reason=reason),)

    def _map(self, recording: Recording, name: str, window: Window) -> None:
        config = self.head.config
        with self.store.window(name) as folder:
            map_sliding_into(
                folder, recording, config, window, self.progress,
                device=self.device, clouds=self.clouds, name=name,
            )  # fmt: skip

    def _index(self, skipped: list[SkippedWindow], tried: int, *, complete: bool) -> None:
        """Lists the windows on disk; those of an earlier call may lie beyond `tried`."""
        left_out = {window.name for window in skipped}
        names = enumerate(map(self.plan.name, range(len(self.plan))))
        finished = (
            name for k, name in names
            if name not in left_out and (k < tried or self.store.has(name))
        )  # fmt: skip
        update = {"skipped": tuple(skipped), "complete": complete}
        self.store.write_index(self.head.model_copy(update=update), finished)


def _check_entry(path: Path, window: Window, device: Device) -> None:
    entry = read_entry(path)
    if (entry.t0_us, entry.t1_us) != (window.t0_us, window.t1_us):
        raise InputError(f"{path}: belongs to another window; remove it, and map again")
    if entry.device != device.name:
        raise InputError(
            f"{path}: was mapped on {entry.device}, not {device.name}: choose that device, or "
            f"{CURE}"
        )
