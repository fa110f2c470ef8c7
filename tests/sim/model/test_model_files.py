"""What a model is made of: every file is found, named in the provenance, and read once."""

import shutil
from hashlib import sha256

import pytest

import rover
from eventsweep.emvs.errors import InputError
from eventsweep.scenes import prepared
from eventsweep.sim import mjcf
from eventsweep.sim.config import ModelConfig, SimConfig
from eventsweep.sim.mjcf import compiled, digests, files_of, model_of, read_spec
from refusals import refused

PARTS = """<mujoco model="parts">
<compiler meshdir='meshes' texturedir="pictures/&#119;ood"/>
<include file="props/sky.xml"/>
<asset>
  <texture name="leaves" type="2d" file="leaves.png"/>
  <material name="leaves" texture="leaves"/>
  <mesh name="hull" file = 'hull.obj'/>
  <model name="crate" file="crate.xml"/>
</asset>
<worldbody>
  <geom type="mesh" mesh="hull" material="leaves"/>
  <frame pos="2 0 0"><attach model="crate" body="crate" prefix="one"/></frame>
</worldbody></mujoco>"""
SKY = """<mujoco><asset><texture name="sky" type="skybox" fileright="side.png" fileleft="side.png"
  fileup="side.png" filedown="side.png" filefront="side.png" fileback="side.png"/>
</asset></mujoco>"""
CRATE = """<mujoco><compiler meshdir="stock"/><asset><mesh name="box" file="box.obj"/></asset>
<worldbody><body name="crate"><geom type="mesh" mesh="box"/></body></worldbody></mujoco>"""
NAMES = {
    "parts.xml", "props/sky.xml", "crate.xml", "meshes/hull.obj", "stock/box.obj",
    "pictures/wood/leaves.png", "pictures/wood/side.png",
}  # fmt: skip


@pytest.fixture
def parts(tmp_path):
    """A model of an include, meshes, textures and another model, each in a folder of its own."""
    folder = tmp_path / "model"
    for name in ("meshes", "pictures/wood", "props", "stock"):
        (folder / name).mkdir(parents=True)
    rover.write(folder)
    (folder / "rover.xml").unlink()
    shutil.copy(folder / "leaves.png", folder / "pictures/wood/side.png")
    shutil.move(folder / "leaves.png", folder / "pictures/wood/leaves.png")
    shutil.copy(folder / "hull.obj", folder / "stock/box.obj")
    shutil.move(folder / "hull.obj", folder / "meshes/hull.obj")
    (folder / "props/sky.xml").write_text(SKY)
    (folder / "crate.xml").write_text(CRATE)
    (folder / "notes.txt").write_text("not of the model")
    (folder / "parts.xml").write_text(PARTS)
    return folder / "parts.xml"


def test_every_file_of_a_model_is_named(parts, tmp_path):
    """Those that are named, and no others, make the same model elsewhere; none can be left out."""
    assert set(digests(parts)) == NAMES
    whole = compiled(read_spec(parts))
    for left_out in (None, *sorted(NAMES)):
        copy = tmp_path / "copy"
        shutil.rmtree(copy, ignore_errors=True)
        for name in NAMES - {left_out}:
            (copy / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(parts.parent / name, copy / name)
        if left_out is None:
            again = compiled(read_spec(copy / "parts.xml"))
            assert (again.nmesh, again.ntex, again.nbody) == (2, 2, whole.nbody)
        else:
            refused("", lambda path: compiled(read_spec(path)), copy / "parts.xml")


def test_a_robots_meshes_are_found_where_its_package_is(tmp_path):
    path = rover.write_urdf(tmp_path)
    assert set(digests(path)) == {"stand.urdf", "base.obj"}
    (tmp_path / "stand" / "urdf").mkdir(parents=True)
    inner = shutil.move(path, tmp_path / "stand" / "urdf" / "stand.urdf")
    shutil.move(tmp_path / "base.obj", tmp_path / "stand" / "base.obj")
    assert set(digests(inner)) == {"stand.urdf", "../base.obj"}


def test_the_parameters_name_the_files_and_know_another_one(tmp_path):
    path = rover.write(tmp_path)
    config = SimConfig(model=ModelConfig(motion="dynamics"), duration_s=0.01, sampling="fast")
    noted = prepared(str(path), "model:left", config, 0).config
    expected = {name: sha256((tmp_path / name).read_bytes()).hexdigest()
                for name in ("rover.xml", "hull.obj", "leaves.png")}  # fmt: skip
    assert {line.split(" ", 1)[1]: line.split(" ", 1)[0] for line in noted.model.files} == expected
    assert prepared(str(path), "model:left", noted, 0).config.model == noted.model
    (tmp_path / "hull.obj").write_text((tmp_path / "hull.obj").read_text() + "\n# heavier\n")
    with pytest.raises(InputError, match=r"its SHA-256 is not .*, hull\.obj is another: rest"):
        prepared(str(path), "model:left", noted, 0)


def test_a_model_is_compiled_once_until_a_file_of_it_changes(tmp_path, monkeypatch):
    path, count = rover.write(tmp_path), []
    bounded = mjcf.bounded
    monkeypatch.setattr(mjcf, "bounded", lambda *a, **k: count.append(1) or bounded(*a, **k))
    config = SimConfig(model=ModelConfig(motion="dynamics"), duration_s=0.01, sampling="fast")
    scene = prepared(str(path), None, config, 0).scene
    scene.motion(0.01, 0).T_world_body(0.005)
    assert len(count) == 1
    assert model_of(path) is model_of(path)
    with (tmp_path / "hull.obj").open("a") as file:
        file.write("\n# changed\n")
    model_of(path)
    assert len(count) == 2


def test_what_is_named_and_not_there_is_no_file_of_it(tmp_path):
    path = tmp_path / "bare.xml"
    path.write_text('<mujoco><!-- file="gone.obj" --><include file="none.xml"/></mujoco>')
    assert files_of(path) == [path.resolve()]
