"""Light of fine frames worked out in a shader: what the kernels say, with any lens."""

import gc

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.data.sequence import Sequence
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.config import SimConfig
from eventsweep.sim.graphics import current_driver, open_context
from eventsweep.sim.graphics.choice import Driver
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering import light_shader, renderer
from eventsweep.sim.rendering.base import Samples
from eventsweep.sim.rendering.draw_target import GLObjects, opengl
from eventsweep.sim.rendering.renderer import StereoRenderer
from eventsweep.sim.rigs import RIGS
from eventsweep.sim.simulate import simulate
from refusals import refused

RANGE_M = (0.5, 8.0)
POSE = look_at((0, 0, 1), (2, 0.1, 0.95))
OTHER = look_at((0.1, -0.05, 1.1), (2, -0.2, 0.9))
PINHOLES = made.small_rig()
BARREL = Camera(80, 60, 55.0, 56.0, 35.4, 33.2, "radtan", (-0.30, 0.09, 0.002, -0.003))
PINCUSHION = Camera(72, 56, 54.6, 52.2, 39.25, 24.9, "radtan", (0.12, 0.05, -0.001, 0.002, 0.01))
FISHEYE = Camera(80, 60, 47.0, 48.0, 41.0, 28.0, "kb4", (-0.02, 0.01, -0.02, 0.004))
GPU = Driver("NVIDIA Corporation", "NVIDIA H100/PCIe/SSE2", "4.6.0 NVIDIA 580.0")


def rig_of(*cameras: Camera) -> Rig:
    return Rig("rig", cameras, tuple(np.eye(4) for _ in cameras))


def textured(folder):
    return made.noise_scene(folder).spec()


def glowing(folder):
    """Panels a million to one, in front of each other."""
    built = made.spec(made.BOXES)
    for k, brightness in enumerate(np.geomspace(1e-3, 1e3, 7)):
        material = built.add_material(name=f"m{k}", emission=brightness, rgba=[1, 1, 1, 1])
        built.worldbody.add_geom(
            type=6, size=[0.05, 0.1, 0.5], pos=[2, 0.6 - 0.2 * k, 1], material=material.name
        )
    return built


def mirrored(folder):
    """A mirror beside the boxes, and a pane of glass before them: every switch of MuJoCo's."""
    mirror = '<material name="mirror" reflectance=".7" rgba=".5 .5 .5 1"/>'
    geoms = (
        '<geom type="box" size="1 .6 .02" pos="2 .2 .7" material="mirror"/>'
        '<geom type="box" size=".01 .3 .3" pos="1 .1 1" rgba=".9 .2 .2 .4"/>'
    )
    return made.spec(made.BOXES + geoms, mirror)


SCENES = {"textured": textured, "glowing": glowing, "mirrored": mirrored}


def drawn(spec, rig, shader, supersample=3, floats=False, border_px=5, places=(POSE, OTHER)):
    """All that a renderer shows of all cameras from two places, in turns."""
    with StereoRenderer(
        spec, rig, supersample, RANGE_M, floats=floats, border_px=border_px, shader=shader
    ) as renderer:
        assert ("light in a shader" in renderer.description) is shader
        return [
            (renderer.frame(k, pose), renderer.depth(k, pose), renderer.segmentation(k, pose))
            for pose in places
            for k in range(len(rig))
        ]


def check_alike(*arguments, **settings):
    """Light within 1e-6 of full scale, everything else to the bit."""
    pairs = zip(
        drawn(*arguments, True, **settings), drawn(*arguments, False, **settings), strict=True
    )
    for (frame, *geometry), (expected, *same) in pairs:
        light, expected_light = frame.samples.light, expected.samples.light
        assert light.shape == expected_light.shape
        assert light.dtype == frame.nearest_depth_m.dtype == np.float32
        full_scale = max(1.0, expected_light.max())
        assert np.ptp(expected_light) > 0.1
        assert np.abs(light - expected_light).max() <= 1e-6 * full_scale
        rho, expected_rho = (f.samples.inverse_depth_per_m for f in (frame, expected))
        np.testing.assert_array_equal(rho, expected_rho)
        assert np.abs(frame.intensity - expected.intensity).max() <= 1e-6 * full_scale
        np.testing.assert_array_equal(frame.nearest_depth_m, expected.nearest_depth_m)
        for ours, theirs in zip(geometry, same, strict=True):
            np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("floats", [False, True])
@pytest.mark.parametrize("scene", SCENES)
def test_a_pinhole_s_light_is_that_of_the_kernels(tmp_path, scene, floats):
    check_alike(SCENES[scene](tmp_path), PINHOLES, floats=floats)


@pytest.mark.parametrize("floats", [False, True])
def test_so_it_is_through_a_lens(tmp_path, floats):
    check_alike(textured(tmp_path), rig_of(BARREL, PINCUSHION, FISHEYE), floats=floats)


@pytest.mark.parametrize(("supersample", "border_px"), [
    (1, 0), (3, 1), (3, 11), (8, 2),
    *(pytest.param(n, 2, marks=pytest.mark.slow) for n in (2, 4, 5, 6, 7)),
])  # fmt: skip
def test_so_it_is_of_any_number_of_samples_and_border(tmp_path, supersample, border_px):
    mixed = rig_of(made.tiny_rig().cameras[0], BARREL if supersample % 2 else FISHEYE)
    check_alike(textured(tmp_path), mixed, supersample=supersample, border_px=border_px)


@pytest.mark.slow
def test_so_it_is_of_a_large_sensor_behind_a_wide_lens(tmp_path):
    """Thousands of samples along a side: where a position has few bits left for its fraction."""
    wide = rig_of(RIGS["tumvie-kb4"].cameras[0])
    check_alike(textured(tmp_path), wide, supersample=2, places=(POSE,))


def test_no_switch_keeps_numbers_from_the_picture_and_all_stay_as_they_are(tmp_path):
    """Everything that can discard a fragment does so here: nothing, or less, would be drawn."""
    gl = opengl()
    with opened(textured(tmp_path), border_px=2, shader=True) as fine:
        expected = fine.frame(0, POSE)
        fine.frame(0, OTHER)
        view, samples = fine._views[0], Samples(*map(np.empty_like, expected.samples))
        for picture in view.pictures():
            for part in picture.parts:
                fine._render(part, 0, POSE, *picture.samples, fine._clip_m(view.lens))
            if picture.first_row == 0:
                fine._light.take(view, picture, samples)
        switches = [getattr(gl, f"GL_{name}") for name in light_shader._SWITCHES]
        for switch in switches:
            gl.glEnable(switch)
        gl.glScissor(0, 0, 1, 1)
        gl.glAlphaFunc(gl.GL_NEVER, 0)
        gl.glCullFace(gl.GL_FRONT_AND_BACK)
        gl.glBlendFunc(gl.GL_ZERO, gl.GL_ZERO)
        before = gl.glGetIntegerv(gl.GL_VIEWPORT).tolist()
        fine._light.take(view, picture, samples)
        assert all(gl.glIsEnabled(switch) for switch in switches)
        assert gl.glGetIntegerv(gl.GL_VIEWPORT).tolist() == before
        assert gl.glGetIntegerv(gl.GL_ATTRIB_STACK_DEPTH) == 0
    np.testing.assert_array_equal(samples.light, expected.samples.light)


def opened(spec, rig=PINHOLES, **settings):
    return StereoRenderer(spec, rig, 2, RANGE_M, **settings)


@pytest.fixture
def on_a_gpu(monkeypatch):
    monkeypatch.setattr(renderer, "current_driver", lambda: GPU)


def test_software_leaves_light_to_the_kernels():
    with opened(made.spec(made.BOXES), border_px=2) as fine:
        if current_driver().hardware:
            pytest.skip("a GPU draws here")
        assert "shader" not in fine.description


def test_a_gpu_works_light_out_by_itself_and_says_so(on_a_gpu):
    with opened(made.spec(made.BOXES), border_px=2) as fine:
        assert " classic, light in a shader, " in fine.description
    with opened(made.spec(made.BOXES), border_px=2, floats=True) as fine:
        assert " classic in float, light in a shader, " in fine.description
    with opened(made.spec(made.BOXES), border_px=2, shader=False) as fine:
        assert "shader" not in fine.description
    with opened(made.spec(made.BOXES)) as plain:
        assert "shader" not in plain.description


def test_a_gpu_that_cannot_says_so_and_leaves_light_to_the_kernels(on_a_gpu, monkeypatch):
    with opened(made.spec(made.BOXES), border_px=2, shader=False) as fine:
        expected = fine.frame(0, POSE)
    monkeypatch.setattr(light_shader, "_HEADER", "#version 999\n")
    with opened(made.spec(made.BOXES), border_px=2) as fine:
        assert "light on the CPU, no shader can (" in fine.description
        assert "\n" not in fine.description
        found = fine.frame(0, POSE)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


@pytest.mark.parametrize("broken", ["_HEADER", "_LENS_SAMPLES", "_LENS_DEPTHS", None])
def test_a_shader_that_cannot_be_had_and_too_large_a_picture_are_one_line(monkeypatch, broken):
    if broken is None:
        vast = rig_of(Camera(20_000, 8, 1000, 1000, 10_000, 4))
        refused("lower supersample", opened, made.spec(made.BOXES), vast)
        return
    monkeypatch.setattr(light_shader, broken, "void main() { no }")
    asked = {"border_px": 2, "shader": True}
    refused("shader=False", opened, made.spec(made.BOXES), rig_of(BARREL), **asked)


def test_all_that_was_made_is_deleted(monkeypatch):
    """Numbers that a context gives out anew are those that came free."""
    context, gl = open_context(16, 16), opengl()
    try:
        for _ in range(2):
            objects = GLObjects()
            texture = objects.texture("GL_R32F", 8, 8)
            buffer = objects.framebuffer(texture)
            program = objects.program(light_shader._VERTEX, "void main() { gl_FragColor *= 0.5; }")
            made_now = gl.glIsTexture(texture), gl.glIsFramebuffer(buffer), gl.glIsProgram(program)
            assert all(made_now)
            objects.free()
            kept = gl.glIsTexture(texture), gl.glIsFramebuffer(buffer), gl.glIsProgram(program)
            assert not any(kept)
    finally:
        context.free()


@pytest.mark.parametrize("shader", [True, False])
def test_one_renderer_s_end_leaves_another_as_it_is(tmp_path, shader):
    spec = textured(tmp_path)
    settings = {"border_px": 2, "shader": shader, "floats": True}
    with opened(spec, **settings) as alone:
        expected = alone.frame(0, POSE)
    first, second = opened(spec, **settings), opened(spec, **settings)
    first.close()
    found = second.frame(0, POSE)
    second.close()
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def test_a_renderer_that_could_not_be_made_leaves_another_as_it_is(tmp_path, monkeypatch):
    """Nor does what is left of it, when Python deletes that at a time of its own."""
    spec = textured(tmp_path)
    with opened(spec, border_px=2) as other:
        monkeypatch.setattr(light_shader, "_HEADER", "#version 999\n")
        with pytest.raises(InputError) as caught:
            opened(spec, border_px=2, shader=True)
        expected = other.frame(0, POSE)
        del caught
        gc.collect()
        found = other.frame(0, POSE)
    for ours, theirs in zip(found, expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def no_shader(*_):
    raise light_shader.NoShader("none here")


def test_a_sequence_has_the_same_events_and_tells_who_made_its_light(tmp_path, on_a_gpu):
    scene = made.noise_scene(tmp_path)
    config = SimConfig(duration_s=0.02, light={"renderer": "mujoco"})
    simulate(scene, made.tiny_rig(), config, 0, tmp_path / "shader")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(renderer, "ShaderLight", no_shader)
        simulate(scene, made.tiny_rig(), config, 0, tmp_path / "kernels")
    ours, theirs = (Sequence.open(tmp_path / name) for name in ("shader", "kernels"))
    assert "light in a shader" in ours.manifest.renderer
    assert "light on the CPU, no shader can (none here)" in theirs.manifest.renderer
    for k in (0, 1):
        events, expected = ours.events(k, 0, 20_001), theirs.events(k, 0, 20_001)
        assert abs(len(events) - len(expected)) <= 0.001 * len(expected)
        assert len(expected) > 100
