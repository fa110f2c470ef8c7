"""What tests of the simulator share: a folder and a scene of noise in it, one of each a module."""

import pytest

from noise_scene import scene_in


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("simulated")


@pytest.fixture(scope="module")
def scene(folder):
    return scene_in(folder)
