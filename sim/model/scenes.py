"""A scene made of a model's file: where the rig sits, what moves, how near and far things are."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from copy import copy
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eventsweep.emvs.data.poses import read_poses
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.geoms import moving_geoms
from eventsweep.sim.mjcf import digests, model_of
from eventsweep.sim.model.drives import (
    initial_data,
    load_controller,
    read_joints,
    run_dynamics,
)
from eventsweep.sim.model.mounts import (
    Mount,
    find_mount,
    first_camera,
    has_resolution,
    rig_of_cameras,
)
from eventsweep.sim.model.survey import not_drawn, survey
from eventsweep.sim.model.tracks import CarriedMotion, StateTrack
from eventsweep.sim.motion import Motion
from eventsweep.sim.motion.head_motion import styled
from eventsweep.sim.motion.head_styles import STYLES
from eventsweep.sim.rigs import rig as named_rig
from eventsweep.sim.scene import Scene

Array = NDArray[np.float64]
DYNAMICS = "dynamics"
_DURATION_S = 1.0
_OWN, _USUAL_RIG = "model:", "davis346"


@dataclass(frozen=True, eq=False)
class FixedMotion:
    """The same motion for every duration and seed."""

    motion: Motion

    def __call__(self, _duration_s: float, _seed: int) -> Motion:
        """The motion."""
        return self.motion


@dataclass(frozen=True, eq=False)
class Still:
    """A rig at rest, where a recorded trajectory may begin."""

    T_start: Array

    def T_world_body(self, _t_s: float) -> Array:
        """Pose (4, 4), always the same."""
        return self.T_start


def clip_of(model: Any) -> tuple[float, float]:
    """Where MuJoCo itself has the clipping planes, m."""
    extent_m, planes = float(model.stat.extent), model.vis.map
    return float(planes.znear) * extent_m, float(planes.zfar) * extent_m


def scene_of(
    path: Path, config: SimConfig, rig: Rig, seed: int, notice: Callable[[str], None]
) -> tuple[Scene, SimConfig]:
    """Makes a scene of a model's file, and looks around in it.

    Args:
        path: MJCF or URDF.
        config: `config.model` says where the rig sits and what moves; a recorded trajectory
            (`config.replay`) may move the rig instead.
        rig: the cameras, to find out how near and far things are.
        seed: of the motion.
        notice: called with a line for what looks wrong.

    Returns:
        The scene, and the parameters with the hashes of all files of the model noted and, for a
        recorded trajectory, its world taken for the model's.

    Raises:
        InputError: an unusable model, an unknown mount, joint, key frame or head style, nothing
            that moves, a controller that fails, or nothing to be seen.
    """
    model = model_of(path)
    config = _noted(path, config)
    drive = _Drive(path, model, config)
    clip_m = clip_of(model)
    if left_out := not_drawn(model):
        notice(f"{path}: {left_out}")
    motion = drive.motion()
    start = motion(drive.duration_s, seed).T_world_body(0.0)
    scene = Scene(
        name=path.stem,
        summary=f"the model {path.name}",
        mjcf=path.resolve(),
        textures=dict,
        motion=motion,
        depth_range_m=clip_m,
        rig=rig.name,
        duration_s=drive.duration_s,
        animate=drive.animation(),
        clip_m=clip_m,
        lamp_at=start if config.model.headlight == "fixed" else None,
        carrier=drive.carrier,
    )
    return survey(scene, rig, config, seed, notice), config


def rig_on(path: Path, rig: str | None, mount: str) -> Rig:
    """The cameras that look at a model.

    Args:
        path: of the model.
        rig: name or calibration of a rig, or `model:NAME,NAME` for the model's own cameras; by
            default the camera that the rig is mounted on if it has a resolution, else `davis346`.
        mount: of `config.model`.

    Raises:
        InputError: an unusable model, or an unknown rig or camera.
    """
    if rig is not None and not rig.startswith(_OWN):
        return named_rig(rig)
    model = model_of(path)
    if rig is not None:
        return rig_of_cameras(model, tuple(rig.removeprefix(_OWN).split(",")))
    name = mount or first_camera(model)
    place = find_mount(model, name, path) if name else None
    if place and place.kind == "camera" and has_resolution(model, place.name):
        return rig_of_cameras(model, (place.name,))
    return named_rig(_USUAL_RIG)


def _noted(path: Path, config: SimConfig) -> SimConfig:
    said, files = config.model, tuple(f"{sha256} {name}" for name, sha256 in digests(path).items())
    digest = hashlib.sha256("\n".join(files).encode()).hexdigest()
    if said.sha256 not in ("", digest):
        others = [line.partition(" ")[2] for line in said.files if line not in files]
        which = f", {others[0]} is another" if others else ""
        raise InputError(f"{path}: its SHA-256 is not {said.sha256}{which}: restore that file")
    noted = said.model_copy(update={"sha256": digest, "files": files})
    update: dict[str, object] = {"model": noted}
    replay = config.replay
    if replay.trajectory is not None and "place" not in replay.model_fields_set:
        update["replay"] = replay.model_copy(update={"place": "world"})
    return config.model_copy(update=update)


class _Drive:
    """What moves the rig and the model."""

    def __init__(self, path: Path, model: Any, config: SimConfig) -> None:
        self._path, self._model, self._config = path, model, config.model
        self._recorded = config.replay.trajectory
        self._check()
        self.duration_s = config.duration_s or _DURATION_S
        self._track = self._states(config)
        name = self._config.mount or first_camera(model)
        self._mount = find_mount(model, name, path) if name else None

    def _check(self) -> None:
        what = self._config.motion
        if what not in ("", DYNAMICS, *STYLES) and not what.lower().endswith(".csv"):
            raise InputError(
                f"model.motion {what!r}: give {DYNAMICS}, a table of joints (.csv) or one of "
                f"{', '.join(STYLES)}; poses in TUM format are replay.trajectory"
            )
        if not what and self._recorded is None:
            raise InputError(
                f"{self._path}: nothing moves, so there are no events: set model.motion to one of "
                f"{DYNAMICS}, a table of joints (.csv), {', '.join(STYLES)}, or replay.trajectory "
                "to poses in TUM format"
            )
        if self._config.controller and what != DYNAMICS:
            raise InputError(
                f"model.controller needs model.motion {DYNAMICS}: set that, or leave the "
                "controller out"
            )
        if what in STYLES and self._recorded is not None:
            raise InputError(f"model.motion {what} and replay.trajectory: give one of the two")

    def _states(self, config: SimConfig) -> StateTrack:
        key, what = self._config.key, self._config.motion
        if what == DYNAMICS:
            control = self._config.controller
            loaded = load_controller(control) if control else None
            # A controller of somebody else's may change the model that it is given.
            model = copy(self._model) if loaded else self._model
            return run_dynamics(model, self.duration_s, key, loaded)
        if what.lower().endswith(".csv"):
            track = read_joints(Path(what), self._model, key)
            self.duration_s = config.duration_s or float(track.t_us[-1] * 1e-6)
            return track
        if self._recorded is not None and config.duration_s is None:
            first_us, last_us = read_poses(self._recorded).span_us
            self.duration_s = (last_us - first_us) * 1e-6 - config.replay.start_s
        return StateTrack.at_rest(initial_data(self._model, key))

    @property
    def carrier(self) -> str:
        """Name of the body that carries the rig; empty for the world, or none."""
        return self._model.body(self._mount.body).name if self._mount and self._mount.body else ""

    def animation(self) -> StateTrack | None:
        """What moves the model's bodies; None where none is seen to move."""
        if len(self._track.t_us) == 1 and self._config.key == "":
            return None
        return self._track if moving_geoms(self._model).any() else None

    def motion(self) -> Callable[[float, int], Motion]:
        """What moves the rig."""
        start = self._start()
        if self._config.motion in STYLES:
            return partial(styled, self._config.motion, start)
        if self._recorded is not None:
            return FixedMotion(Still(start))
        return FixedMotion(CarriedMotion(self._path.resolve(), self._track, self._needed_mount()))

    def _start(self) -> Array:
        if self._mount is None:
            if self._recorded is None:
                self._needed_mount()
            return np.eye(4)
        data = initial_data(self._model, self._config.key)
        return self._mount.T_world_body(data)

    def _needed_mount(self) -> Mount:
        return self._mount or find_mount(self._model, self._config.mount, self._path)
