"""Numbers that follow from the sensor and the rig."""

from __future__ import annotations

from threading import current_thread

import pytest

import point_world as world
from eventsweep.emvs.odometry.batches import Sizes, planes_for
from eventsweep.emvs.odometry.views import PerCamera


@pytest.mark.parametrize(
    ("width_px", "focal_px", "baseline_m", "range_m", "planes"),
    [
        (346, 226.0, 0.1, (0.45, 4.0), 60),  # 45 px of disparity: never fewer than 60
        (240, 200.0, 0.15, (0.4, 6.0), 70),
        (1280, 1050.0, 0.12, (0.45, 4.0), 100),  # 249 px
    ],
)
def test_a_map_has_a_plane_per_pixel_of_disparity(width_px, focal_px, baseline_m, range_m, planes):
    camera = world.pinhole(width=width_px, height=180, f=focal_px)
    assert planes_for(world.stereo_rig(camera, baseline_m, 2), range_m) == planes
    assert planes_for(world.stereo_rig(camera, baseline_m, 1), range_m) == 100


def test_more_columns_need_more_events_and_levels():
    small, large = (
        Sizes.of(world.stereo_rig(world.pinhole(width=w, height=w * 3 // 4, f=w), 0.1, 2))
        for w in (320, 1280)
    )
    assert large.events == 4 * small.events
    assert large.levels == small.levels + 2


def test_work_of_cameras_comes_back_in_their_order_and_with_their_errors():
    def name(camera):
        if camera == 3:
            raise ValueError("camera 3")
        return camera, current_thread().name

    for threads, used in ((0, 3), (1, 1), (2, 2)):
        each = PerCamera(3, threads)
        found = each(name)
        assert [camera for camera, _ in found] == [0, 1, 2]
        assert found[0][1] == current_thread().name
        assert len({thread for _, thread in found}) <= used
    with pytest.raises(ValueError, match="camera 3"):
        PerCamera(4)(name)
