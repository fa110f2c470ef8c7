"""The tracker as runs, suites and studies use it, for the group `eventsweep.trackers`."""

from eventsweep.plugins.track.folder import track_stage as track_stage

STAGE = "eventsweep.plugins.track.stage"
