"""A preset's file: stands wherever a preset's name does, and is refused in one line if wrong."""

import pytest

from eventsweep.sim.config import ImuConfig, PixelConfig, SimConfig
from eventsweep.sim.sensor_presets import SensorConfig
from refusals import refused

TEXT = """contrast_threshold_pos = 0.31
refractory_period_us = 1200

[sensor]
bandwidth_hz = 120.0
shot_rate_dark_hz = 0.7
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "sensor.toml"
    path.write_text(TEXT)
    return path


def test_a_file_stands_for_a_preset(file):
    config = SimConfig(sensor={"preset": str(file)})
    assert (config.contrast_threshold_pos, config.refractory_period_us) == (0.31, 1200)
    assert config.contrast_threshold_neg == SimConfig().contrast_threshold_neg
    assert config.sensor.resolved().bandwidth_hz == 120
    assert SensorConfig(preset=file).resolved() == config.sensor.resolved()


def test_given_values_beat_the_file(file):
    sensor = SensorConfig(preset=file, bandwidth_hz=50)
    config = PixelConfig(contrast_threshold_pos=0.5, sensor=sensor)
    assert config.contrast_threshold_pos == 0.5
    assert config.sensor.resolved().bandwidth_hz == 50
    assert config.sensor.resolved().shot_rate_dark_hz == 0.7


def test_results_hold_the_values_and_not_the_file(file):
    config = SimConfig(sensor={"preset": file})
    dumped = config.model_dump(mode="json")
    file.unlink()
    assert SimConfig.model_validate(dumped) == config
    assert dumped["sensor"]["preset"] == "ideal"


@pytest.mark.parametrize(("text", "said"), [
    ("[sensor", "readable TOML"), ("nothing = 1", "unknown key nothing"),
    ("[sensor]\nbandwidth_hz = -1", "bandwidth_hz"),
    ("[sensor]\npreset = 'x.toml'", "another file"),
    ("contrast_threshold_neg = nan", "contrast_threshold_neg"), ("\x00", "readable TOML"),
])  # fmt: skip
def test_wrong_files_are_refused_in_one_line(file, text, said):
    file.write_text(text)
    refused(said, SimConfig, sensor={"preset": file})


BAD = (0, -0.1, float("nan"), float("inf"))


@pytest.mark.parametrize(("kind", "values", "words"), [
    *((SimConfig, {name: value}, name) for value in BAD
      for name in ("contrast_threshold_pos", "contrast_threshold_neg", "log_eps")),
    (SimConfig, {"contrast": 0.2}, "contrast"), (SimConfig, {"duration_s": 0}, "duration_s"),
    (SimConfig, {"min_frame_interval_us": 200, "max_frame_interval_us": 100}, "lower the first"),
    (SimConfig, {"sensor": {"preset": "davis347"}}, "davis346"),
    *((ImuConfig, {name: value}, name) for name, value in (
        ("rate_hz", -1.0), ("gyro_noise", -1.0), ("accel_walk", float("nan")), ("rate", 200),
        ("gyro_bias", (0, 0, float("inf"))), ("quat_xyzw", (0, 0, 0, 2)))),
    *((SensorConfig, {name: value}, name) for name, value in (
        ("leak_rate_hz", -1), ("hot_pixel_fraction", 1.1), ("bandwidth_order", 3),
        ("readout_queue_events", 0), ("latency_us", float("nan")),
        ("timestamp_resolution_us", 0))),
])  # fmt: skip
def test_impossible_settings_are_refused(kind, values, words):
    refused(words, kind, **values)
