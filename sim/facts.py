"""What a simulated sequence says of itself, and what makes two simulations the same."""

from __future__ import annotations

import hashlib
import json
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from emvs.geometry.trajectory import Trajectory
from emvs.utils.runtime import versions
from sim.graphics import import_mujoco
from sim.motion.curves import sampled
from sim.parallel.render_job import RenderJob
from sim.rendering.renderer import StereoRenderer
from sim.sensor.imu import imu_samples
from sim.truth import geom_table

_ANIMATION_SAMPLES, _ANIMATION_TIMES_S = 32, (0.001, 0.01, 0.1)


class Facts(NamedTuple):
    """What the manifest says of a sequence, and the key of its unfinished work."""

    arguments: dict[str, Any]
    key: str


def facts_of(job: RenderJob, renderer: StereoRenderer) -> Facts:
    """Samples what rides on the motion and describes the rest."""
    duration_s = job.duration_us * 1e-6
    trajectory = sampled(job.motion(), duration_s, job.config.pose_rate_hz)
    arguments = {
        "name": job.scene.name,
        "rig": job.rig,
        "trajectory": trajectory,
        "config": job.config.model_dump(mode="json"),
        "seed": job.seed,
        "renderer": renderer.description,
        "depth_range_m": job.scene.depth_range_m,
    }
    if "segmentation" in job.config.truth:
        arguments["geoms"] = geom_table(renderer.model)
    if job.config.imu.rate_hz:
        arguments["imu"] = imu_samples(job.motion(), duration_s, job.config.imu, job.seed)
    return Facts(arguments, _key(job, renderer, trajectory))


def _key(job: RenderJob, renderer: StereoRenderer, trajectory: Trajectory) -> str:
    """A hash over all that decides the sequence: parameters, geometry, textures and all motion."""
    mj = import_mujoco()
    model = np.zeros(mj.mj_sizeModel(renderer.model), np.uint8)
    mj.mj_saveModel(renderer.model, None, model)
    plain = {
        "scene": [job.scene.name, job.scene.depth_range_m],
        "rig": job.rig.to_json(),
        "config": job.config.model_dump(mode="json"),
        "seed": job.seed,
        "bounds_us": job.bounds_us,
        "renderer": renderer.description,
        "versions": versions(),
    }
    digest = hashlib.sha256(json.dumps(plain, sort_keys=True).encode())
    poses = trajectory.t_us, trajectory.positions_m, trajectory.quats_xyzw
    for array in (model, *poses, *_animation(job, renderer.model)):
        digest.update(np.ascontiguousarray(array).data)
    return digest.hexdigest()


def _animation(job: RenderJob, model: Any) -> list[NDArray[np.float64]]:
    """Where the bodies that move by themselves are at some times, and how often frames are."""
    animate = job.scene.animate
    if animate is None:
        return []
    data, sampled_as = import_mujoco().MjData(model), [np.array([animate.max_interval_us], float)]
    # Early as well: bodies that start at other speeds have not gone far, but may come to rest.
    times_s = (*_ANIMATION_TIMES_S, *np.linspace(0, job.duration_us * 1e-6, _ANIMATION_SAMPLES))
    for t_s in sorted(t for t in times_s if t <= job.duration_us * 1e-6):
        animate(model, data, float(t_s))
        sampled_as += [data.qpos.copy(), data.mocap_pos.copy(), data.mocap_quat.copy()]
    return sampled_as
