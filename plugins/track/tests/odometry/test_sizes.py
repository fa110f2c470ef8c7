"""Numbers that follow from the sensor and the rig."""

import pytest

import point_world as world
from eventsweep.emvs.config import MapperConfig
from eventsweep.plugins.track.odometry.batches import Sizes
from eventsweep.plugins.track.odometry.maps import planes_for, small_view


@pytest.mark.parametrize(
    ("width_px", "focal_px", "baseline_m", "range_m", "planes"),
    [
        (346, 226.0, 0.1, (0.45, 4.0), 45),
        (346, 226.0, 0.05, (0.45, 4.0), 40),  # 23 px of disparity: never fewer than 40
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
        Sizes(world.stereo_rig(world.pinhole(width=w, height=w * 3 // 4, f=w), 0.1, 2))
        for w in (320, 1280)
    )
    assert large.events == 4 * small.events
    assert large.levels == small.levels + 2


def test_maps_of_a_wide_sensor_are_made_in_a_smaller_view_of_the_same_angles():
    wide = world.stereo_rig(world.pinhole(width=1280, height=720, f=1050.0), 0.1, 2)
    config = MapperConfig(**small_view(wide, 640))
    view = config.view_width_px, config.view_height_px, config.view_focal_px
    assert view == (640, 360, 525.0)
    assert (
        small_view(world.stereo_rig(world.pinhole(width=346, height=260, f=226.0), 0.1, 2), 640)
        == {}
    )
