"""Draws glowing panels with MuJoCo's Filament renderer; a program of its own: failures end it.

Usage: python filament_picture.py SCENE.xml VIEW.json OUT.npy, where the view holds pos, forward,
up, left, right, top, bottom, near, far, width and height.
"""

import collections.abc
import json
import os
import sys
from pathlib import Path

import numpy as np
import typing_extensions

if not hasattr(collections.abc, "Buffer"):  # Python 3.11
    collections.abc.Buffer = typing_extensions.Buffer


def main(scene: str, view_path: str, out: str) -> None:
    import mujoco
    import mujoco.studio.window  # registers what the renderer needs
    from mujoco import mjrf
    from mujoco.rendering.filament import model_scene, renderer

    view = json.loads(Path(view_path).read_text())
    config = mjrf.ContextConfig()
    config.graphics_api = mjrf.GraphicsApi.GRAPHICS_API_VULKAN
    context = mjrf.Context(config)
    model = mujoco.MjModel.from_xml_path(scene)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    made = model_scene.ModelScene(context, model)
    made.update(data)
    drawing = renderer.Renderer(context)
    drawing._scenes["scene"] = made.scene
    light = np.zeros((view["height"], view["width"]), np.float32)
    drawing.target("light", light, mjrf.PixelFormat.PIXEL_FORMAT_R32F)
    camera = mjrf.Camera(
        pos=view["pos"], forward=view["forward"], up=view["up"],
        frustum_bottom=view["bottom"], frustum_top=view["top"],
        frustum_near=view["near"], frustum_far=view["far"],
    )  # fmt: skip
    camera.frustum_center = (view["left"] + view["right"]) / 2
    camera.frustum_width = (view["right"] - view["left"]) / 2
    plain = {"post_processing": False, "reflections": False, "shadows": False}
    drawing.render(
        [renderer.View("scene", "light", camera=camera, skybox=False, haze=False, **plain)]
    )
    np.save(out, light)
    sys.stdout.flush()
    os._exit(0)  # tearing the engine down can crash


if __name__ == "__main__":
    main(*sys.argv[1:])
