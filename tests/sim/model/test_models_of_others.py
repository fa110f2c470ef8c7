"""Models as others make them: drawn are their geoms and nothing else, and all simulate."""

from functools import cache

import numpy as np
import pytest

from eventsweep.emvs.data.sequence import Sequence
from eventsweep.scenes import load, prepared
from eventsweep.sim.config import ModelConfig, ReplayConfig, SimConfig
from eventsweep.sim.rendering.drawing import MUJOCO
from eventsweep.sim.rigs import rig
from eventsweep.sim.simulate import simulate
from tiers import often
from twin_checks import smaller

EYE = '<camera name="eye" pos="0 0 1" xyaxes="0 -1 0 0 0 1"/>'
ASSETS = """
<texture name="check" type="2d" builtin="checker" rgb1=".2 .3 .4" rgb2=".8 .7 .6" width="64"
height="64"/>
<material name="check" texture="check" texrepeat="8 8" specular="0"/>"""
BALL = """<body name="ball" pos="1.5 .2 1"><geom name="ball" size=".1" rgba="1 0 0 1"/>
<site name="s1"/></body>"""
FREE = BALL.replace("<geom", "<freejoint/><geom")
POST = '<site name="s0" pos="1.5 -.4 1"/>'
RAYS = "".join(
    f'<site name="r{k}" pos="{1 + 0.1 * (k % 4)} {0.1 * k - 0.4} 1" zaxis="1 .{k} 0"/>'
    for k in range(9)
)
FINDERS = "".join(f'<sensor><rangefinder site="r{k}"/></sensor>' for k in range(9))
TENDON = (
    '<tendon><spatial name="t" range="0 1" width=".03" rgba="1 1 0 1">'
    '<site site="s0"/><site site="s1"/></spatial></tendon>'
)
SKIN = """<deformable><skin name="k" vertex="0 0 0 .5 0 0 0 .5 0 0 0 .5" face="0 1 2 0 2 3 0 1 3">
<bone body="ball" bindpos="0 0 0" bindquat="1 0 0 0" vertid="0 1 2 3" vertweight="1 1 1 1"/>
</skin></deformable>"""
CLOTH = """<flexcomp name="cloth" type="grid" count="4 4 1" spacing=".1 .1 .1" pos="1.5 0 1.2"
dim="2" radius=".01" mass="1" rgba="0 1 0 1"><edge equality="true"/></flexcomp>"""


def mjcf(body=BALL, more="", asset="", eye=EYE, light='<light pos="0 0 4"/>'):
    return f"""<mujoco><option timestep=".002"/><asset>{ASSETS}{asset}</asset><worldbody>{light}
    <geom name="wall" type="box" size=".1 3 3" pos="2.5 0 1" material="check"/>
    <body name="cart"><joint name="slide" type="slide" axis="0 1 0" springref="3" stiffness="900"/>
    <geom size=".05" pos="0 0 .3" mass="1"/>{eye}</body>{body}</worldbody>{more}</mujoco>"""


MODELS = {
    "nothing more": mjcf(),
    "range finders": mjcf(BALL + RAYS, FINDERS),
    "tendons": mjcf(BALL + POST, TENDON),
    "muscles": mjcf(
        BALL.replace("<geom", '<joint name="h"/><geom') + POST,
        TENDON + '<actuator><muscle tendon="t" lengthrange="0 1"/></actuator>',
    ),
    "a skin": mjcf(BALL, SKIN),
    "a cloth": mjcf(BALL + CLOTH),
    "hills": mjcf(
        BALL + '<geom name="hills" type="hfield" hfield="h" pos="1.5 0 0"/>',
        asset='<hfield name="h" nrow="8" ncol="8" size="1 1 .3 .1"/>',
    ),
    "mocap": mjcf(BALL.replace('name="ball" pos', 'name="ball" mocap="true" pos')),
    "no light": mjcf(light=""),
    "sites of all groups": mjcf(
        BALL + "".join(f'<site pos="1.5 {k * 0.1} 1" size=".1" group="{k}"/>' for k in range(6))
    ),
    "constraints": mjcf(FREE, '<equality><connect body1="ball" anchor="0 0 .1"/></equality>'),
    "a camera that looks after": mjcf(
        FREE, eye='<camera name="eye" mode="targetbody" target="ball" pos="0 0 1"/>'
    ),
    "a lens of no size": mjcf(eye=EYE.replace("pos", 'fovy="60" pos')),
    "a sky": mjcf(
        asset='<texture type="skybox" builtin="gradient" rgb1=".4 .6 .8" width="64" height="64"/>'
    ),
    "glass": mjcf(BALL.replace('rgba="1 0 0 1"', 'rgba="0 1 0 .4"')),
    "sensors": mjcf(FREE, '<sensor><touch site="s1"/><accelerometer site="s1"/></sensor>'),
    "adhesion": mjcf(FREE, '<actuator><adhesion body="ball" ctrlrange="0 1"/></actuator>'),
}
FEW = ("nothing more", "range finders", "a cloth", "hills", "a sky", "glass")
NOT_DRAWN = {
    "tendons": "1 tendons", "muscles": "1 tendons", "a skin": "1 skins", "a cloth": "1 flex",
}  # fmt: skip
CONFIG = SimConfig(
    sampling="fast", duration_s=0.01, truth=("segmentation",), truth_interval_s=0.01,
    model=ModelConfig(motion="dynamics"),
)  # fmt: skip


RIG = smaller(rig("oblique"), 2)


def made(folder, text, said=None):
    path = folder / "theirs.xml"
    path.write_text(text)
    return prepared(str(path), RIG, CONFIG, 0, [].append if said is None else said.append)


def looked(one):
    """What camera 0 sees at the start: light, depth and geoms; and the names of these."""
    with MUJOCO.open(one.scene, one.rig, 1, floats=False, border_px=None) as renderer:
        place = one.scene.motion(0.01, 0).T_world_body(0.0)
        renderer.at(0.0)
        light, depth_m = renderer.frame(0, place).intensity, renderer.depth(0, place)
        return light, depth_m, renderer.segmentation(0, place), renderer.geoms


@pytest.fixture(scope="module")
def look(tmp_path_factory):
    """What is seen of a model of that kind, and what was said of it; each is looked at once."""

    @cache
    def seen(kind):
        said = []
        return looked(made(tmp_path_factory.mktemp("model"), MODELS[kind], said)), said

    return seen


@pytest.mark.parametrize("kind", often(FEW, MODELS))
def test_only_geoms_are_seen(look, kind):
    (_, depth_m, geoms, known), said = look(kind)
    assert set(np.unique(geoms)) <= {-1, *known}
    assert ((geoms >= 0) == np.isfinite(depth_m)).mean() > 0.99
    assert "wall" in {known[k].name for k in np.unique(geoms) if k >= 0}
    assert NOT_DRAWN.get(kind, "") in "".join(said)
    assert any("not rendered" in line for line in said) == (kind in NOT_DRAWN)


@pytest.mark.parametrize("kind", ["range finders", "tendons", "a skin", "sites of all groups"])
def test_what_is_no_geom_changes_nothing(look, kind):
    for with_it, without in zip(look(kind)[0][:3], look("nothing more")[0][:3], strict=True):
        assert np.array_equal(with_it, without)


def test_a_model_with_range_finders_simulates(tmp_path):
    one, said = made(tmp_path, MODELS["range finders"]), []
    simulate(one.scene, one.rig, one.config, 0, tmp_path / "out", notice=said.append)
    assert sum(Sequence.open(tmp_path / "out").manifest.event_counts) > 100
    assert said == []


def test_next_to_no_events_are_said(tmp_path):
    still = mjcf().replace('stiffness="900"', "")
    one, said = made(tmp_path, still), []
    simulate(one.scene, one.rig, one.config, 0, tmp_path / "out", notice=said.append)
    assert any("are very few" in line for line in said)


def test_a_trajectory_that_looks_past_the_scene_is_said(tmp_path):
    rows = "".join(f"{0.01 * k:.2f} {900 + 0.01 * k} 0 0 0 0 0 1\n" for k in range(12))
    (tmp_path / "far.txt").write_text(rows)
    replay = ReplayConfig(trajectory=tmp_path / "far.txt", place="world")
    far, said = SimConfig(replay=replay, duration_s=0.03), []
    out = tmp_path / "out"
    simulate(load("planes"), rig("oblique"), far, 0, out, notice=said.append)
    assert any("surfaces fill 0 % of the view" in line for line in said)
