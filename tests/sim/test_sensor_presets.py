"""A preset's file: stands wherever a preset's name does, and is refused in one line if wrong."""

import pytest

from eventsweep.sim.config import PixelConfig, SimConfig
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


def test_an_unknown_name_is_refused_with_those_that_are_known():
    refused("davis346", SimConfig, sensor={"preset": "davis347"})
