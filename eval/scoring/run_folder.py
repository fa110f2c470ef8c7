"""Finds what a run left on disk: its maps, the recordings they came from, and ground truth.

Depth maps of others that were scored are kept beside it, as predictions, for its pages to show.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeGuard

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.data.recording import Recording
from eventsweep.emvs.data.sequence import Sequence as EventSequence
from eventsweep.emvs.datasets import open_recording
from eventsweep.emvs.datasets.ground_truth import truth_at
from eventsweep.emvs.datasets.posed import PosedRecording
from eventsweep.emvs.depth.depth_map import DepthMap
from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.maps.folder import StoredMap, StoredWindow, read_map
from eventsweep.emvs.maps.store import read_entry
from eventsweep.emvs.utils import output_manifest
from eventsweep.emvs.utils.files import is_work_folder
from eventsweep.emvs.utils.outputs import atomic_dir, discard, real
from eventsweep.eval.config import EvalConfig
from eventsweep.eval.found_poses import found_poses
from eventsweep.eval.scoring.pairing import Estimate, Truth
from eventsweep.eval.scoring.predictions import DESCRIPTION, FAMILY, Prediction, TargetView, plain
from eventsweep.eval.scoring.trajectories.own_poses import maps_on_own_poses

MAP_FOLDER, SEQUENCE_FOLDER, CONFIG_FILE = "map", "sequence", "config.toml"
TRACK_FOLDER, TRACKED_MAP_FOLDER = "track", "map-track"
KEPT_FOLDER = "predictions"
"""Of a run: what was scored beside its maps."""
_INDEX = "map.json"
Scored = EventSequence | PosedRecording
"""Recordings that may have ground truth: `emvs.datasets.ground_truth.TruthRecording`."""


def find_maps(folder: Path) -> dict[str, StoredMap]:
    """Opens the maps of a run, by case, or the one map that the folder is."""
    if (folder / _INDEX).exists():
        stored = _with_windows(read_map(folder))
        return {stored.info.recording.name: stored}
    found = sorted(folder.glob(f"*/{MAP_FOLDER}/{_INDEX}"))
    if not found:
        raise InputError(f"{folder}: no maps; needs a folder that `run` or `map` wrote")
    return {path.parents[1].name: _with_windows(read_map(path.parent)) for path in found}


class Tracked(NamedTuple):
    """What a run found from a case's events: poses, or why there are none, and the map on them."""

    poses: Trajectory | str
    map: StoredMap


def tracked_in(made: Path, mapper: str) -> Tracked:
    """What a job found: poses, or why there are none, and a mapper's maps on them."""
    return Tracked(found_poses(made / TRACK_FOLDER), read_map(made / TRACKED_MAP_FOLDER / mapper))


def mapped_window(made: Path) -> StoredWindow:
    """The window that a job mapped."""
    info = read_entry(made)
    return StoredWindow(made / info.name, info)


def tracked(folder: Path, case: str) -> Tracked | None:
    """What a run with poses of its own left of a case; None where it had none."""
    place = folder / case / TRACKED_MAP_FOLDER
    if not (place / _INDEX).is_file():
        return None
    return Tracked(found_poses(folder / case / TRACK_FOLDER), read_map(place))


def _with_windows(stored: StoredMap) -> StoredMap:
    if not stored.windows:
        raise InputError(f"{stored.path}: holds no window yet; map until one is finished")
    return stored


def recording_of(stored: StoredMap) -> Recording:
    """Opens the recording that a map was made from; refuses one that is not the same any more."""
    info, path = stored.info.recording, recording_path(stored)
    recording = open_recording(path)
    digest = recording.manifest.digest() if isinstance(recording, EventSequence) else None
    if digest != info.manifest_sha256:
        raise InputError(
            f"{path}: not the recording that {stored.path} was made from; map it again"
        )
    return recording


def existing_recording(stored: StoredMap) -> Recording | None:
    """The recording of a map, or None where it is no longer there: the map is worth showing."""
    return recording_of(stored) if recording_path(stored).exists() else None


def recording_path(stored: StoredMap) -> Path:
    """Where a map's recording lies; that of a map that is being made, too."""
    folder = real(stored.path)
    # Until it is whole, a map lies in a hidden folder in the place where it will be.
    place = folder.parent if is_work_folder(folder.parent) else folder
    return real(place / stored.info.recording.path)


def sequence_of(stored: StoredMap) -> Scored:
    """Opens a map's recording, which must have ground truth, and checks its hashes."""
    check_view(stored.info.config, str(stored.path))
    return with_ground_truth(verified(stored))


def verified(stored: StoredMap) -> Recording:
    """Opens a map's recording and checks its hashes, where it has any."""
    recording = recording_of(stored)
    if isinstance(recording, EventSequence):
        recording.verify()
    return recording


def check_view(config: MapperConfig, what: str) -> None:
    """Refuses maps, named by `what`, of another view than camera 0's."""
    if not config.is_camera_0_view:
        raise InputError(
            f"{what}: its reference view is not camera 0's, which the ground truth belongs to: "
            "map with reference_shift 0 and without view_* to score"
        )


def has_any_truth(recording: Recording) -> TypeGuard[Scored]:
    """Whether there is ground truth at some time."""
    return isinstance(recording, EventSequence) or (
        isinstance(recording, PosedRecording) and len(recording.truth_times_us(0)) > 0
    )


def with_ground_truth(recording: Recording) -> Scored:
    """The recording itself, which must have ground truth."""
    if has_any_truth(recording):
        return recording
    raise InputError(
        f"{recording.name}: a recording without ground truth; needs one that `simulate` made, "
        "DSEC's disparity, MVSEC's depth, or `[truth]` in a recording.toml"
    )


def provenance(recording: Scored) -> dict[str, Any]:
    """What the results say about where a case's numbers come from."""
    if isinstance(recording, EventSequence):
        return {"rig": recording.rig.name, "sim": recording.manifest.configuration}
    return {"rig": recording.rig.name, "layout": recording.layout}


def with_truth(
    windows: Sequence[StoredWindow], sequence: Scored, config: EvalConfig
) -> tuple[StoredWindow, ...]:
    """The windows whose reference time has ground truth; at least one must."""
    known = tuple(w for w in windows if has_truth(sequence, w.info.t_ref_us, config))
    if not known:
        truth_of(sequence, windows[0].info.t_ref_us, config)
    return known


def has_truth(recording: Recording | None, t_ref_us: int, config: EvalConfig) -> bool:
    """Whether a recording has ground truth for a reference view."""
    if not isinstance(recording, Scored):
        return False
    times_us = recording.truth_times_us(0)
    if isinstance(recording, PosedRecording) and recording.truth_any_time:
        return bool(times_us[0] <= t_ref_us <= times_us[-1])
    tolerance_us = 0 if isinstance(recording, EventSequence) else config.truth_tolerance_us
    return bool((np.abs(times_us - t_ref_us) <= tolerance_us).any())


def truth_of(sequence: Scored, t_ref_us: int, config: EvalConfig) -> Truth:
    """Ground truth in the reference view: camera 0, without lens distortion.

    A sequence of ours has truth exactly then, or none; that of a data set may be carried over, see
    `emvs.datasets.ground_truth`.
    """
    camera = sequence.rig.cameras[0]
    if isinstance(sequence, EventSequence):
        depth_m = sequence.truth_view_depth_m(0, t_ref_us)
    else:
        depth_m = truth_at(sequence, t_ref_us, config.truth_tolerance_us)
    return Truth(
        depth_m=depth_m,
        valid=np.isfinite(depth_m),
        focal_px=camera.fx_px,
        baseline_m=sequence.rig.baseline_m() if len(sequence.rig) > 1 else None,
        limits_m=config.truth_limits_m,
        border_px=config.border_px,
    )


def target_view(sequence: Scored, window: StoredWindow, config: EvalConfig) -> TargetView:
    """The reference view of a window: camera 0 without lens distortion."""
    camera, rig = sequence.rig.cameras[0], sequence.rig
    truth = truth_of(sequence, window.info.t_ref_us, config)
    known_m = truth.depth_m[truth.scored]
    median_m = float(np.median(known_m)) if known_m.size else None
    return TargetView(
        t_us=window.info.t_ref_us,
        width_px=camera.width_px,
        height_px=camera.height_px,
        focal_px=camera.fx_px,
        baseline_m=rig.baseline_m() if len(rig) > 1 else None,
        true_depth_m=None if median_m is None else (median_m, median_m),
    )


@contextmanager
def kept_predictions(folder: Path, predictions: Sequence[Path]) -> Iterator[Path]:
    """Yields where `keep` puts what is scored; takes the place of what an earlier call kept.

    The predictions are folders, which may not lie there; without any, what was kept goes.
    """
    place = folder / KEPT_FOLDER
    if predictions:
        inside = [
            prediction for prediction in predictions if real(prediction).is_relative_to(real(place))
        ]
        with atomic_dir(place, force=True, inputs=inside, part_of=folder) as partial:
            yield partial
        return
    yield place
    if output_manifest.read(place) is not None:
        discard(place)


def keep(folder: Path, case: str, t_us: int, estimates: Mapping[str, Estimate]) -> None:
    """Writes the depth maps of a view as predictions that `Prediction.open` reads."""
    for name, estimate in estimates.items():
        own = folder / file_name(name)
        place = own / _case_folder(case)
        place.mkdir(parents=True, exist_ok=True)
        confidence = (
            {} if estimate.confidence is None else {"confidence": np.float32(estimate.confidence)}
        )
        arrays: dict[str, Any] = {"depth_m": estimate.depth_m, "mask": estimate.mask, **confidence}
        np.savez_compressed(place / f"{t_us}.npz", **arrays)
        facts = f'name = "{name.removeprefix(FAMILY)}"\nscale = 1.0\nmay_be_empty = true\n'
        (own / DESCRIPTION).write_text(facts, encoding="utf-8")


def _case_folder(case: str) -> str:
    """A case's name, which may come from somebody's file, as a folder's: never one elsewhere."""
    return plain(case).lstrip(".") or "case"


def other_maps(folder: Path, case: str, window: StoredWindow) -> list[DepthMap]:
    """Depth maps that were scored beside a window's: on poses that were found, and predictions."""
    own = tracked(folder, case)
    maps = {} if own is None else maps_on_own_poses(own.map, window)
    like = window.depth_map(window.info.methods[0])
    return [*maps.values(), *predicted_maps(folder, case, like)]


def predicted_maps(folder: Path, case: str, like: DepthMap) -> list[DepthMap]:
    """The depth maps that were scored beside those of a map, in the form of `like`, one of its own.

    Confidence is NaN where a method does not say how sure it is; it knows no planes of its own.
    """
    place, own = folder / KEPT_FOLDER, _case_folder(case)
    if output_manifest.read(place) is None:  # somebody's folder of that name
        return []
    camera = like.camera
    view = TargetView(like.t_us, camera.width_px, camera.height_px, camera.fx_px, None)
    folders = [path.parent for path in sorted(place.glob(f"*/{DESCRIPTION}"))]
    found = [Prediction.open(one, own) for one in folders if (one / own).is_dir()]
    return [_as_map(one, view, like) for one in found if view.t_us in one.files]


def _as_map(prediction: Prediction, view: TargetView, like: DepthMap) -> DepthMap:
    depth_m, mask = prediction.depth_m(view)
    said = prediction.confidence(view)
    confidence = np.full(mask.shape, np.nan) if said is None else said
    return replace(
        like,
        method=prediction.name,
        # Finite and positive everywhere, as all depth maps are.
        depth_m=np.where(mask, depth_m, np.float32(1)),
        mask=mask,
        confidence=confidence.astype(np.float32),
        argmax=np.zeros_like(like.argmax),
    )
