"""Float light against an independent renderer: MuJoCo's Filament, where Vulkan runs."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import mujoco_scenes as made
from eventsweep.emvs.geometry.camera import Camera
from eventsweep.emvs.geometry.rig import Rig
from eventsweep.sim.graphics import import_mujoco
from eventsweep.sim.motion.curves import look_at
from eventsweep.sim.rendering.renderer import StereoRenderer

# Filament's own unit of emission for nearly black surfaces, and the light that it adds from all
# around, which the classic renderer does not know. Measured once: two numbers for seven panels.
EMISSION, AROUND = 0.02322, 1.437e-5
GLOW = (1e-2, 1e-1, 1.0, 10.0, 100.0, 1000.0, 10_000.0)
# Nearly black surfaces: what Filament adds from all around is in proportion to their colour.
DARK = 1e-4
CAMERA = Camera(240, 120, 190.0, 188.0, 112.3, 66.7)
LEVEL = look_at((0, 0, 1), (2, 0.1, 0.97))
NEAR_M, FAR_M = 0.25, 32.0


def panels() -> str:
    """Seven panels in a dark room, a million to one."""
    materials = "".join(
        f'<material name="m{k}" emission="{g / DARK}" specular="0" shininess="0" reflectance="0" '
        f'rgba="{DARK} {DARK} {DARK} 1"/>'
        for k, g in enumerate(GLOW)
    )
    geoms = "".join(
        f'<geom type="box" size=".02 .08 .3" pos="2 {0.6 - 0.2 * k} 1" material="m{k}"/>'
        for k in range(len(GLOW))
    )
    return (
        f"<mujoco>{made.DARK}<asset>{materials}</asset><worldbody>"
        '<light type="directional" castshadow="false" dir="0 0 1" diffuse="0 0 0" ambient="0 0 0" '
        f'specular="0 0 0"/>{geoms}</worldbody></mujoco>'
    )


def filament(folder: Path) -> np.ndarray:
    (folder / "scene.xml").write_text(panels())
    view = {
        "pos": LEVEL[:3, 3].tolist(), "forward": LEVEL[:3, 2].tolist(),
        "up": (-LEVEL[:3, 1]).tolist(),
        "left": NEAR_M * (-0.5 - CAMERA.cx_px) / CAMERA.fx_px,
        "right": NEAR_M * (CAMERA.width_px - 0.5 - CAMERA.cx_px) / CAMERA.fx_px,
        "top": NEAR_M * (0.5 + CAMERA.cy_px) / CAMERA.fy_px,
        "bottom": NEAR_M * (0.5 + CAMERA.cy_px - CAMERA.height_px) / CAMERA.fy_px,
        "near": NEAR_M, "far": FAR_M, "width": CAMERA.width_px, "height": CAMERA.height_px,
    }  # fmt: skip
    (folder / "view.json").write_text(json.dumps(view))
    names = [str(folder / name) for name in ("scene.xml", "view.json", "light.npy")]
    program = Path(__file__).with_name("filament_picture.py")
    done = subprocess.run(
        [sys.executable, str(program), *names], capture_output=True, text=True, timeout=120
    )
    if not (folder / "light.npy").exists():
        said = (done.stdout + done.stderr).strip().splitlines() or ["nothing"]
        pytest.skip(f"Filament does not run here (exit {done.returncode}): {said[-1][:150]}")
    return np.load(folder / "light.npy")


def test_glowing_panels_agree_over_120_db(tmp_path):
    """Edges to a pixel, light to 0.2 % after Filament's own scale."""
    theirs = filament(tmp_path)
    spec = import_mujoco().MjSpec.from_string(panels())
    rig = Rig("one", (CAMERA,), (np.eye(4),))
    with StereoRenderer(spec, rig, 1, (2 * NEAR_M, FAR_M / 4), floats=True) as renderer:
        ours, geom = renderer.frame(0, LEVEL).intensity, renderer.segmentation(0, LEVEL)
    lit = [(geom == k) & (theirs > 0) for k in range(len(GLOW))]
    assert min(mask.sum() for mask in lit) > 300
    for glow, mask in zip(GLOW, lit, strict=True):
        assert np.median(ours[mask]) == pytest.approx(glow, rel=1e-3)
        assert np.median(theirs[mask]) == pytest.approx(EMISSION * glow + AROUND, rel=2e-3)
    assert ((ours > 0) != (theirs > 0)).mean() < 0.01
