"""What tests of the simulator share: a folder and a scene of noise in it, one of each a module."""

import pytest

import rover
from eventsweep.sim.graphics import import_mujoco
from mujoco_scenes import noise_scene


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("simulated")


@pytest.fixture(scope="module")
def scene(folder):
    return noise_scene(folder)


@pytest.fixture(scope="module")
def rover_xml(tmp_path_factory):
    return rover.write(tmp_path_factory.mktemp("rover"))


@pytest.fixture(scope="module")
def rover_model(rover_xml):
    return import_mujoco().MjModel.from_xml_path(str(rover_xml))
