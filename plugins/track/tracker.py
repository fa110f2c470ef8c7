"""The tracker as runs, suites and studies use it, for the group `eventsweep.trackers`."""

from __future__ import annotations

from pathlib import Path

from eventsweep.emvs.data.poses import write_tum
from eventsweep.emvs.data.recording import Recording
from eventsweep.eval.found_poses import FOUND_FILE
from eventsweep.eval.jobs.job import Runtime
from eventsweep.plugins.track.folder import track_recording
from eventsweep.plugins.track.odometry.config import TrackConfig
from eventsweep.plugins.track.odometry.recorded import track as track_poses


def track(recording: Recording, out: Path, runtime: Runtime, in_full: bool) -> None:
    """Finds poses; in full with `track.json`, the cloud of all maps, and a page."""
    if in_full:
        place = Path(getattr(recording, "path", recording.name))
        track_recording(recording, place, out, TrackConfig(), runtime.display)
        return
    found = track_poses(recording, TrackConfig(**runtime.threads()))
    out.mkdir()
    write_tum(out / FOUND_FILE, found.trajectory)
