"""A mount is where MuJoCo has it, and a model's camera sees what MuJoCo's own renderer sees."""

import subprocess
import sys

import numpy as np
import pytest

import rover
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.model.mounts import find_mount, first_camera, rig_of_cameras
from eventsweep.sim.rendering.renderer import StereoRenderer
from places import ROOT
from refusals import refused

mujoco = import_mujoco()  # with the graphics that there are


def placed(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_sites_and_bodies_look_along_x_with_z_up(rover_model):
    data = placed(rover_model)
    for name, position in (("eye", [0.22, 0, 0.35]), ("body:rover", [0, 0, 0.25])):
        T = find_mount(rover_model, name).T_world_body(data)
        assert np.allclose(T[:3, 3], position)
        right, down, forward = T[:3, :3].T
        assert np.allclose(forward, [1, 0, 0])
        assert np.allclose(right, [0, -1, 0])
        assert np.allclose(down, [0, 0, -1])


def test_a_camera_of_the_model_looks_where_mujoco_says(rover_model):
    T = find_mount(rover_model, "left").T_world_body(placed(rover_model))
    assert np.allclose(T[:3, 3], [0.22, 0.05, 0.35])
    assert np.allclose(T[:3, :3].T, [[0, -1, 0], [0, 0, -1], [1, 0, 0]])


@pytest.fixture(scope="module")
def odd(tmp_path_factory):
    """The model with a site that is called like a camera, and with a camera on another body."""
    text = rover.MJCF.replace(
        '<site name="eye"', '<body><camera name="far" resolution="9 9"/></body><site name="left"'
    )
    return mujoco.MjModel.from_xml_path(str(rover.write(tmp_path_factory.mktemp("odd"), text)))


@pytest.mark.parametrize(("name", "words"), [
    ("nose", "nothing is called 'nose'.*camera:left"), ("", "nothing is called ''"),
    ("camera:eye", "nothing is called 'camera:eye'"),
])  # fmt: skip
def test_what_is_not_there_is_refused(rover_model, name, words):
    refused(words, find_mount, rover_model, name)


def test_names_of_several_things_and_cameras_that_are_no_rig_are_refused(rover_model, odd):
    refused(r"called 'left'.*camera:left, site:left$", find_mount, odd, "left")
    assert find_mount(odd, "site:left").kind == "site"
    refused("'blind' of the model has a resolution of", rig_of_cameras, rover_model, ("blind",))
    refused("are on different bodies", rig_of_cameras, odd, ("left", "far"))


def test_a_stereo_rig_is_as_far_apart_as_its_cameras(rover_model):
    rig = rig_of_cameras(rover_model, ("left", "right"))
    assert rig.baseline_m() == pytest.approx(0.1)
    assert np.allclose(rig.T_body_cam[1][:3, 3], [0.1, 0, 0])
    assert first_camera(rover_model) == "camera:left"


BALL = """<mujoco><worldbody>
<geom type="sphere" size=".05" pos="2 {y} {z}" rgba="1 1 1 1"/>
<camera name="c" xyaxes="0 -1 0 0 0 1" {lens}/>
</worldbody></mujoco>"""


@pytest.mark.parametrize(
    "lens",
    [
        'fovy="50" resolution="160 120"',
        'resolution="160 120" sensorsize="0.0016 0.0012" focalpixel="140 150"',
        'resolution="160 120" sensorsize="0.0016 0.0012" focalpixel="140 150" '
        'principalpixel="12 -7"',
    ],
)
def test_pixels_are_those_of_mujocos_own_picture(lens, tmp_path):
    """MuJoCo's renderer with its fixed camera, and ours with the rig made of it, see one ball."""
    text = BALL.format(y=0.3, z=0.2, lens=lens)
    model = mujoco.MjModel.from_xml_string(text)
    data = placed(model)
    expected = centre(theirs(text, tmp_path))
    rig = rig_of_cameras(model, ("c",))
    T_world_body = find_mount(model, "c").T_world_body(data)
    with StereoRenderer(mujoco.MjSpec.from_string(text), rig, 1, (0.5, 5)) as ours:
        found = centre(ours.frame(0, T_world_body).intensity)
    assert np.abs(found - expected).max() < 0.3
    ball_cam = np.linalg.inv(T_world_body) @ [2, 0.3, 0.2, 1]
    assert np.abs(rig.cameras[0].project(ball_cam[:3]) - expected).max() < 0.7


THEIRS = """
import sys
import numpy as np
from eventsweep.sim.graphics import import_mujoco
mujoco = import_mujoco()
model = mujoco.MjModel.from_xml_string(sys.argv[1])
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)
with mujoco.Renderer(model, 120, 160) as renderer:
    renderer.update_scene(data, camera="c")
    np.save(sys.argv[2], renderer.render().mean(axis=-1))
"""


def theirs(text, folder):
    """In a process of its own: contexts of two makers do not get along in one."""
    out = folder / "theirs.npy"
    subprocess.run([sys.executable, "-c", THEIRS, text, str(out)], check=True, cwd=ROOT)
    return np.load(out)


def centre(image):
    rows, columns = np.nonzero(image > 0.2 * image.max())
    return np.array([columns.mean(), rows.mean()])


@pytest.mark.parametrize(("lens", "words"), [
    ('projection="orthographic" fovy="2"', "is orthographic, and event cameras here are pinholes"),
    ('fovy="0"', "has a focal length of inf x inf px"), ('fovy="-5"', "has a focal length of -"),
    ('sensorsize=".01 .02"', "has a focal length of 0 x 0 px"),
    ('sensorsize=".01 .02" focal="-.01 .01"', "has a focal length of -80 x 30 px"),
])  # fmt: skip
def test_a_camera_that_is_no_pinhole_is_refused(lens, words):
    text = BALL.format(y=0, z=0, lens=f'resolution="80 60" {lens}')
    refused(words, rig_of_cameras, mujoco.MjModel.from_xml_string(text), ("c",))
