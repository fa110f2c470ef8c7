"""Writes a recording as a data set's publisher lays it out, or as files with a `recording.toml`."""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
import yaml

from eventsweep.emvs.data.events import Events
from eventsweep.emvs.data.image_stores import FrameCamera, Photo, frame_cameras
from eventsweep.emvs.data.poses import POSES_FILE, write_tum
from eventsweep.emvs.data.recording import Recording, events_span_us, has_poses
from eventsweep.emvs.datasets import dsec, radiance
from eventsweep.emvs.datasets.posed import EventSource
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.formats import FORMATS, in_time_order, write_events
from eventsweep.emvs.formats.base import Checker
from eventsweep.emvs.formats.blocks import within
from eventsweep.emvs.formats.calibration_writers import (
    basalt,
    kalibr_chain,
    pose_values,
    write_rig_json,
)
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.emvs.geometry.trajectory import Trajectory
from eventsweep.emvs.utils.outputs import atomic_dir


@dataclass(frozen=True)
class RecordingExport:
    """What is to be written: a recording, its events per camera, all times shifted."""

    recording: Recording
    sources: tuple[EventSource, ...]
    shift_us: int
    on_written: Callable[[int], None]

    @property
    def rig(self) -> Rig:
        """The cameras."""
        return self.recording.rig

    @property
    def has_poses(self) -> bool:
        """Whether there are poses to write."""
        return has_poses(self.recording)

    def span_us(self) -> tuple[int, int]:
        """First and last instant of the events, on the shifted clock."""
        first_us, last_us = events_span_us(self.recording)
        return first_us + self.shift_us, last_us + self.shift_us

    def poses(self) -> Trajectory:
        """`T_world_cam0`, on the shifted clock.

        Raises:
            InputError: the recording has no poses.
        """
        moved = self.recording.trajectory.times(self.rig.T_body_cam[0])
        return Trajectory(moved.t_us + self.shift_us, moved.positions_m, moved.quats_xyzw)

    def T_cam0_cam(self) -> tuple[np.ndarray, ...]:
        """Where each camera sits in the first one's frame."""
        first = np.linalg.inv(self.rig.T_body_cam[0])
        return tuple(first @ T for T in self.rig.T_body_cam)

    def on_first_camera(self) -> Rig:
        """The rig, whose body is the first camera; without frame cameras."""
        return replace(self.rig, T_body_cam=self.T_cam0_cam(), frame_cameras=None)

    def placed(self, seen: Iterable[FrameCamera]) -> list[radiance.Placed]:
        """Frame cameras with their ways, on the shifted clock."""
        poses, T_first = self.poses(), np.linalg.inv(self.rig.T_body_cam[0])
        return [radiance.Placed(one, poses.times(T_first @ one.T_body_cam)) for one in seen]

    def size_px(self, camera: int) -> tuple[int, int]:
        """Width and height of a sensor."""
        return self.rig.cameras[camera].width_px, self.rig.cameras[camera].height_px

    def sizes_px(self, names: Iterable[str]) -> dict[str, tuple[int, int]]:
        """Width and height of each camera's sensor, by the name of its stream."""
        return {name: self.size_px(k) for k, name in enumerate(names)}

    def packets(self, camera: int) -> Iterator[Events]:
        """A camera's events on the shifted clock."""
        return (events.shifted(self.shift_us) for events in self.sources[camera].chunks())

    def write_camera(self, path: Path, kind: str, camera: int) -> None:
        """Writes one camera's events into a file."""
        path.parent.mkdir(parents=True, exist_ok=True)
        streams = {"events": self.packets(camera)}
        write_events(path, kind, *self.size_px(camera), streams, self.on_written)


def write_recording(
    job: RecordingExport,
    out: Path,
    kind: str,
    *,
    force: bool = False,
    inputs: Collection[Path] = (),
) -> None:
    """Writes a folder that `open_recording` opens again; it appears whole or not at all.

    Args:
        job: what to write.
        out: the folder.
        kind: a key of `LAYOUTS`, or an event format with a file per camera.
        force: whether to replace an existing folder that this wrote.
        inputs: what it is made from, which it never replaces.
    """
    write = LAYOUTS.get(kind)
    if write is None and not (kind in FORMATS and FORMATS[kind].writes):
        raise InputError(f"{out}: layout {kind!r} is unknown; choose {', '.join(kinds())}")
    if kind in ("dsec", "tumvie", "mvsec") and len(job.rig) != 2:
        raise InputError(
            f"{out}: layout {kind} needs two cameras, {job.recording.name} has {len(job.rig)}"
        )
    if kind == "sequence":
        _sequence(job, out, force=force, inputs=inputs)
        return
    with atomic_dir(out, force=force, inputs=inputs) as folder:
        if write is None:
            _described(job, folder, kind)
        else:
            write(job, folder)


def kinds() -> list[str]:
    """Every layout that can be written."""
    return list(dict.fromkeys([*LAYOUTS, *(n for n, f in FORMATS.items() if f.writes)]))


def _described(job: RecordingExport, folder: Path, kind: str) -> None:
    """A file of events per camera, our calibration, poses, and a descriptor."""
    files = [f"cam{k}{FORMATS[kind].suffix}" for k in range(len(job.rig))]
    for k, name in enumerate(files):
        job.write_camera(folder / name, kind, k)
    more: dict[str, Any] = {"events": [{"file": name} for name in files]}
    if job.recording.depth_range_m is not None:
        more["depth_range_m"] = [float(v) for v in job.recording.depth_range_m]
    _describe(job, folder, job.on_first_camera(), **more)


def _describe(job: RecordingExport, folder: Path, rig: Rig, **more: Any) -> None:
    """Calibration, poses, and a descriptor of them and of the events."""
    write_rig_json(folder / "rig.json", rig)
    if job.has_poses:
        write_tum(folder / POSES_FILE, job.poses())
        more["poses"] = {"file": POSES_FILE}
    what = {"name": job.recording.name, "calibration": {"file": "rig.json"}, **more}
    (folder / "recording.toml").write_text(tomli_w.dumps(what), encoding="utf-8")


def _tumvie(job: RecordingExport, folder: Path) -> None:
    name = job.recording.name
    places = job.T_cam0_cam()
    four = (*job.rig.cameras, *job.rig.cameras)  # entries 0 and 1 would be the frame cameras
    calibration = basalt(four, (*places, *places))
    (folder / "camera-calibrationA.json").write_text(json.dumps(calibration, indent=4))
    marker = {"value0": {"T_imu_marker": pose_values(np.eye(4)), "mocap_to_imu_offset_ns": 0}}
    (folder / "mocap-imu-calibrationA.json").write_text(json.dumps(marker, indent=4))
    for k, side in enumerate(("left", "right")):
        job.write_camera(folder / f"{name}-events_{side}.h5", "tumvie", k)
    if job.has_poses:
        _write_mocap(folder, name, job.poses())


def _write_mocap(folder: Path, name: str, poses: Trajectory) -> None:
    data = folder / f"{name}-vi_gt_data" / "mocap_data.txt"
    data.parent.mkdir()
    with data.open("w", encoding="ascii") as file:
        file.write("# timestamp(us) x y z qx qy qz qw\n")
        for t, position, quat in zip(poses.t_us, poses.positions_m, poses.quats_xyzw, strict=True):
            file.write(f"{t} " + " ".join(f"{v:.12f}" for v in (*position, *quat)) + "\n")


def _mvsec(job: RecordingExport, folder: Path) -> None:
    from eventsweep.emvs.datasets.mvsec_m3ed import write_truth

    name = job.recording.name
    streams = {"davis/left": job.packets(0), "davis/right": job.packets(1)}
    data = folder / f"{name}_data.hdf5"
    write_events(
        data, "mvsec", *job.size_px(0), streams, job.on_written, job.sizes_px(streams)
    )  # fmt: skip
    chain = yaml.safe_dump(kalibr_chain(job.rig), sort_keys=False)
    (folder / f"camchain-imucam-{name}.yaml").write_text(chain, encoding="utf-8")
    poses = job.poses() if job.has_poses else None
    write_truth(folder / f"{name}_gt.hdf5", job.recording, poses, job.shift_us)


def _rosbag(job: RecordingExport, folder: Path) -> None:
    from eventsweep.emvs.datasets.bags import info_topic
    from eventsweep.emvs.datasets.rosbag import RecordingBag

    path = folder / f"{job.recording.name}.bag"
    names = [f"/cam{k}/events" for k in range(len(job.rig))]
    sizes_px = job.sizes_px(names)
    check = Checker(path, FORMATS["rosbag1"].limits, sizes_px)
    poses = job.poses() if job.has_poses else None
    first_us = job.span_us()[0] if poses is None else poses.span_us[0]
    if first_us < 0:
        what = "events" if poses is None else "poses"
        raise InputError(f"{path}: {what} begin at {first_us} µs; shift the times above 0")
    streams = {name: job.packets(k) for k, name in enumerate(names)}
    with RecordingBag(path, sizes_px) as bag:
        bag.append_cameras([*map(info_topic, names)], job.rig, first_us)
        if poses is not None:
            bag.append_poses(poses)
        for stream, events in in_time_order(streams):
            bag.append(stream, check(stream, events))
            job.on_written(check.count)


def _nerfstudio(job: RecordingExport, folder: Path) -> None:
    """Files with a `recording.toml`, and the views beside them."""
    model, beside = radiance.one_model(job.rig.cameras, _beside(job.recording))
    radiance.write_transforms(folder, model, _views(job, folder, beside))


def _colmap(job: RecordingExport, folder: Path) -> None:
    """Files with a `recording.toml`, and COLMAP's model of the pictures beside them."""
    radiance.write_colmap(folder, _views(job, folder, _beside(job.recording)))


def _views(
    job: RecordingExport, folder: Path, beside: Sequence[FrameCamera]
) -> Iterator[radiance.View]:
    """Writes the recording, and gives the views of its cameras."""
    poses = job.poses()
    _described(job, folder, "npz")
    cameras = [poses.times(T) for T in job.T_cam0_cam()]
    names = [f"cam{k}{FORMATS['npz'].suffix}" for k in range(len(job.rig))]
    return radiance.views_of(job.recording, cameras, job.placed(beside), names, job.shift_us)


def _beside(recording: Recording) -> list[FrameCamera]:
    """The frame cameras of their own pixels."""
    return [seen for seen in frame_cameras(recording) if seen.shares is None]


def left_out(recording: Recording, kind: str) -> str:
    """Which frame cameras a layout does not take, in a sentence; empty where it takes all."""
    try:
        seen = list(frame_cameras(recording))
        if kind == "nerfstudio":
            kept = radiance.one_model(recording.rig.cameras, seen)[1]
            seen = [each for each in seen if each not in kept]
    except InputError as error:
        return f"frames are left out: {error}"
    if not seen or kind in ("sequence", "colmap", "eventnerf"):
        return ""
    names = ", ".join(each.name for each in seen)
    return (
        f"frames of {names} are left out: {kind} as written here takes none of them; sequence does"
    )


def _eventnerf(job: RecordingExport, folder: Path) -> None:
    """A scene per camera, undistorted, of the events that the poses cover; its clock begins at 0.

    Opened again, it is a recording of pinhole cameras.
    """
    from eventsweep.emvs.formats.tables.npz import SignedNpzWriter

    poses, spans_us = job.poses(), []
    for k, camera in enumerate(job.rig.cameras):
        T_world_cam = poses.times(job.T_cam0_cam()[k])
        split = folder / f"cam{k}" / "train"
        (split / "events").mkdir(parents=True)
        first_us, last_us = _covered(job, k, poses.span_us)
        spans_us.append((first_us, last_us))
        undistorted, done = radiance.Undistorter(camera), 0
        check = Checker(split, FORMATS["npz"].limits, {"events": job.size_px(k)})
        with SignedNpzWriter(split / "events" / "events.npz", *job.size_px(k)) as writer:
            for events in job.packets(k):
                seen = undistorted(within(events, first_us, last_us + 1)).shifted(-first_us)
                writer.append("events", check("events", seen))
                done += len(events)
                job.on_written(done)
        times_us = radiance.view_times_us(poses, (first_us, last_us))
        views = Trajectory.from_matrices(times_us, T_world_cam.at(times_us))
        pictures = radiance.event_views(job.recording, k, views, job.shift_us)
        radiance.write_views(split, camera, pictures)
    for k, placed in enumerate(job.placed(_beside(job.recording))):
        split = folder / f"frame{k}" / "train"
        pictures = radiance.frame_views(placed, job.shift_us)
        radiance.write_views(split, placed.seen.camera, pictures)
    # One recording, on the clock that the scenes came from.
    cameras = tuple(camera.undistorted() for camera in job.rig.cameras)
    files = [
        {"file": f"cam{k}/train/events/events.npz", "time_offset_us": first_us}
        for k, (first_us, _) in enumerate(spans_us)
    ]
    _describe(job, folder, replace(job.on_first_camera(), cameras=cameras), events=files)


def _covered(job: RecordingExport, camera: int, span_us: tuple[int, int]) -> tuple[int, int]:
    """First and last event that the poses cover, µs."""
    first_us, last_us = 1 << 62, -1
    for events in job.packets(camera):
        part = within(events, span_us[0], span_us[1] + 1)
        if len(part):
            first_us, last_us = min(first_us, int(part.t_us.min())), int(part.t_us.max())
    if not first_us < last_us:
        raise InputError(
            f"{job.recording.name}: the poses cover no events of camera {camera}: check that "
            "both use one clock"
        )
    return first_us, last_us


def _sequence(job: RecordingExport, folder: Path, **kept: Any) -> None:
    from eventsweep.emvs.data.writer import SequenceWriter

    done, seen = 0, frame_cameras(job.recording)
    rig = replace(job.on_first_camera(), frame_cameras=_frame_rig(job, seen))
    with SequenceWriter(
        folder,
        name=job.recording.name,
        rig=rig,
        trajectory=job.poses() if job.has_poses else None,
        span_us=None if job.has_poses else job.span_us(),
        config={"converted_from": job.recording.name},
        depth_range_m=job.recording.depth_range_m,
        **kept,
    ) as writer:
        for camera in range(len(job.rig)):
            for events in job.packets(camera):
                writer.append_events(camera, events)
                done += len(events)
                job.on_written(done)
        for one in seen:
            for photo in _photos(one, job.shift_us):
                if one.shares is not None:
                    writer.append_photo(one.shares, photo)
                elif rig.frame_cameras is not None:
                    writer.append_beside(rig.frame_cameras.camera_names.index(one.name), photo)


def _frame_rig(job: RecordingExport, seen: Sequence[FrameCamera]) -> Rig | None:
    """The frame cameras in the first camera's frame, with those that took no picture."""
    rig, T_first = job.rig.frame_cameras, np.linalg.inv(job.rig.T_body_cam[0])
    known = {} if rig is None else dict(
        zip(rig.camera_names, zip(rig.cameras, rig.T_body_cam, strict=True), strict=True)
    )  # fmt: skip
    known |= {one.name: (one.camera, one.T_body_cam) for one in seen if one.shares is None}
    if not known:
        return None
    cameras, places = zip(*known.values(), strict=True)
    return Rig(f"{job.rig.name}, frames", cameras, tuple(T_first @ T for T in places), (*known,))


def _photos(seen: FrameCamera, shift_us: int) -> Iterator[Photo]:
    """A camera's pictures on the shifted clock."""
    for index in range(len(seen.pictures.t_us)):
        photo = seen.photo(index)
        yield photo._replace(start_us=photo.start_us + shift_us, end_us=photo.end_us + shift_us)


def _dsec(job: RecordingExport, folder: Path) -> None:
    for k, side in enumerate(("left", "right")):
        job.write_camera(folder / "events" / side / "events.h5", "dsec", k)
    dsec.write_calibration(folder, job.rig)
    if job.has_poses:
        write_tum(folder / POSES_FILE, job.poses())
    dsec.write_truth(folder, job.recording, job.shift_us)


LAYOUTS: dict[str, Callable[[RecordingExport, Path], None]] = {
    "sequence": _sequence,
    "dsec": _dsec,
    "tumvie": _tumvie,
    "mvsec": _mvsec,
    "rosbag1": _rosbag,
    "nerfstudio": _nerfstudio,
    "colmap": _colmap,
    "eventnerf": _eventnerf,
}
"""Layouts of their own; every other event format becomes files with a `recording.toml`."""
