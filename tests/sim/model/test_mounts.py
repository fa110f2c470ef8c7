"""A mount is where MuJoCo has it, and a model's camera sees what MuJoCo's own renderer sees."""

import subprocess
import sys

import numpy as np
import pytest

import rover
from eventsweep.emvs.errors import InputError
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.model.mounts import find_mount, first_camera, rig_of_cameras
from eventsweep.sim.rendering.renderer import StereoRenderer
from places import ROOT

mujoco = import_mujoco()  # with the graphics that there are


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    return mujoco.MjModel.from_xml_path(str(rover.write(tmp_path_factory.mktemp("rover"))))


def placed(model):
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return data


def test_sites_and_bodies_look_along_x_with_z_up(model):
    data = placed(model)
    for name, position in (("eye", [0.22, 0, 0.35]), ("body:rover", [0, 0, 0.25])):
        T = find_mount(model, name).T_world_body(data)
        assert np.allclose(T[:3, 3], position)
        right, down, forward = T[:3, :3].T
        assert np.allclose(forward, [1, 0, 0])
        assert np.allclose(right, [0, -1, 0])
        assert np.allclose(down, [0, 0, -1])


def test_a_camera_of_the_model_looks_where_mujoco_says(model):
    T = find_mount(model, "left").T_world_body(placed(model))
    assert np.allclose(T[:3, 3], [0.22, 0.05, 0.35])
    assert np.allclose(T[:3, :3].T, [[0, -1, 0], [0, 0, -1], [1, 0, 0]])


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nose", "nothing is called 'nose'.*camera:left"),
        ("camera:eye", "nothing is called 'camera:eye'"),
        ("", "nothing is called ''"),
    ],
)
def test_what_is_not_there_is_refused(model, name, message):
    with pytest.raises(InputError, match=message):
        find_mount(model, name)


def test_a_name_that_several_things_have_needs_its_kind(tmp_path):
    path = rover.write(tmp_path, rover.MJCF.replace('site name="eye"', 'site name="left"'))
    model = mujoco.MjModel.from_xml_path(str(path))
    with pytest.raises(InputError, match=r"called 'left'.*camera:left, site:left$"):
        find_mount(model, "left")
    assert find_mount(model, "site:left").kind == "site"


def test_a_stereo_rig_is_as_far_apart_as_its_cameras(model):
    rig = rig_of_cameras(model, ("left", "right"))
    assert rig.baseline_m() == pytest.approx(0.1)
    assert np.allclose(rig.T_body_cam[1][:3, 3], [0.1, 0, 0])
    assert first_camera(model) == "camera:left"


def test_cameras_without_resolution_or_of_two_bodies_are_refused(tmp_path, model):
    with pytest.raises(InputError, match="'blind' of the model has a resolution of"):
        rig_of_cameras(model, ("blind",))
    apart = rover.MJCF.replace(
        '<site name="eye"', '<body><camera name="far" resolution="9 9"/></body><site name="eye"'
    )
    other = mujoco.MjModel.from_xml_path(str(rover.write(tmp_path, apart)))
    with pytest.raises(InputError, match="are on different bodies"):
        rig_of_cameras(other, ("left", "far"))


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
