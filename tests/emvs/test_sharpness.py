"""How sharp a DSI is: what it is made of, and that it is highest where all is true."""

from dataclasses import replace

import numpy as np
import pytest

from emvs.config import MapperConfig
from emvs.data.altered import AlteredRecording
from emvs.errors import InputError
from emvs.mapper import map_window
from emvs.sharpness import sharpness, sharpnesses
from emvs.windows import choose_window
from point_world import fronto_parallel, stereo_rig

CONFIG = MapperConfig(planes=20, min_depth_m=0.5, max_depth_m=4.0, start_s=0.1, duration_s=0.2)


@pytest.fixture(scope="module")
def recording():
    return fronto_parallel(1.2, points=200)


def test_it_is_the_mean_of_the_largest_maxima_that_the_mapper_finds(recording):
    mapped = map_window(recording, CONFIG.model_copy(update={"methods": ("Alg1/H", "EMVS/cam1")}))
    for name, camera in (("Alg1/H", None), ("EMVS/cam1", 1)):
        votes = np.sort(mapped.depth_maps[name].confidence.ravel())[-2000:]
        assert sharpness(recording, CONFIG, camera=camera) == pytest.approx(votes.mean(), rel=1e-6)


def test_volumes_of_one_sweep_are_those_of_a_sweep_each(recording):
    window = choose_window(recording, CONFIG)
    together = sharpnesses(recording, CONFIG, (None, 0, 1), window)
    assert together == tuple(sharpness(recording, CONFIG, window, c) for c in (None, 0, 1))


@pytest.mark.parametrize("late_us", [-20_000, 20_000])
def test_a_late_camera_makes_the_fused_volume_less_sharp(recording, late_us):
    late = AlteredRecording(recording, clock_us=(0, late_us))
    assert sharpness(late, CONFIG) < 0.9 * sharpness(recording, CONFIG)
    assert sharpness(late, CONFIG, camera=0) == sharpness(recording, CONFIG, camera=0)


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_a_wrong_baseline_makes_the_fused_volume_less_sharp(recording, share):
    told = AlteredRecording(recording, rig=stereo_rig(recording.rig.cameras[0], 0.1 * share))
    assert sharpness(told, CONFIG) < 0.9 * sharpness(recording, CONFIG)


def test_one_camera_is_its_own_volume(recording):
    rig = replace(recording.rig, cameras=recording.rig.cameras[:1], camera_names=("cam0",),
                  T_body_cam=recording.rig.T_body_cam[:1])  # fmt: skip
    alone = replace(recording, rig=rig, streams=recording.streams[:1])
    assert sharpness(alone, CONFIG) == sharpness(recording, CONFIG, camera=0)


def test_a_window_without_poses_is_refused_as_the_mapper_does(recording):
    with pytest.raises(InputError, match="after the last of the"):
        sharpness(recording, CONFIG.model_copy(update={"duration_s": 9.0}))
