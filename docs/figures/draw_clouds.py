"""A map's depth, cloud and mesh: `python docs/figures/draw_clouds.py MAP METHOD OUT.png`.

MAP is what `eventsweep map` wrote and `eventsweep fuse --mesh` joined. The cloud and mesh are seen
from beside the middle window's reference view, turned about what it looks at.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import open3d as o3d

from eventsweep.emvs.dsi.method import file_name
from eventsweep.emvs.geometry import se3
from eventsweep.emvs.maps.folder import read_map

SIZE_PX, DPI = (480, 360), 80


def beside(found, turned_deg, raised_deg):
    """A view from another direction at what lies on the axis, nearer than half of the points."""
    target_m = np.array([0, 0, np.percentile(found.depth_m[found.mask], 40)])
    turn, lift = np.deg2rad(turned_deg), np.deg2rad(raised_deg)
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0],
                        [-np.sin(turn), 0, np.cos(turn)]])  # fmt: skip
    about_x = np.array([[1, 0, 0], [0, np.cos(lift), -np.sin(lift)],
                        [0, np.sin(lift), np.cos(lift)]])  # fmt: skip
    T_rv_seen = np.eye(4)
    T_rv_seen[:3, :3] = about_y @ about_x
    T_rv_seen[:3, 3] = target_m - 1.25 * T_rv_seen[:3, :3] @ target_m
    return found.T_world_rv @ T_rv_seen


def pinhole(found, zoom):
    """(3, 3) of a picture of `SIZE_PX` with the map's field of view, times `zoom`."""
    focal_px = zoom * found.camera.fx_px * SIZE_PX[0] / found.camera.width_px
    return np.array([[focal_px, 0, SIZE_PX[0] / 2], [0, focal_px, SIZE_PX[1] / 2], [0, 0, 1.0]])


def draw_cloud(axis, cloud, K, T_world_seen):
    """Points, near ones over far ones."""
    points = np.asarray(cloud.points)
    seen = se3.transform(se3.inverse(T_world_seen), points)
    order = np.argsort(-seen[:, 2])
    order = order[seen[order, 2] > 0.05]
    uv = seen[order] @ K.T
    uv = uv[:, :2] / uv[:, 2:]
    axis.scatter(*uv.T, s=1.8, c=np.asarray(cloud.colors)[order], linewidths=0)
    axis.set(xlim=(0, SIZE_PX[0]), ylim=(SIZE_PX[1], 0), xticks=[], yticks=[], aspect="equal")


def draw_mesh(axis, mesh, K, T_world_seen):
    """The surface, lit from where it is seen."""
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(o3d.t.geometry.TriangleMesh.from_legacy(mesh))
    rays = scene.create_rays_pinhole(
        o3d.core.Tensor(K), o3d.core.Tensor(se3.inverse(T_world_seen)), *SIZE_PX
    )
    hit = scene.cast_rays(rays)
    normals, towards = hit["primitive_normals"].numpy(), rays.numpy()[..., 3:]
    towards /= np.linalg.norm(towards, axis=-1, keepdims=True)
    light = 0.25 + 0.75 * np.abs((normals * towards).sum(axis=-1))
    colours = np.asarray(mesh.vertex_colors)[np.asarray(mesh.triangles)].mean(axis=1)
    ids = hit["primitive_ids"].numpy()
    there = ids < len(colours)
    picture = np.ones((*there.shape, 3))
    picture[there] = (light[..., None] * colours[np.where(there, ids, 0)])[there]
    axis.imshow(picture)
    axis.set(xticks=[], yticks=[])


def main():
    """Draws three panels."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("map", type=Path)
    parser.add_argument("method")
    parser.add_argument("out", type=Path)
    parser.add_argument("--turned-deg", type=float, default=25)
    parser.add_argument("--raised-deg", type=float, default=-15)
    parser.add_argument("--zoom", type=float, default=0.9)
    asked = parser.parse_args()
    stored = read_map(asked.map)
    found = stored.windows[len(stored.windows) // 2].depth_map(asked.method)
    folder = asked.map / "global" / file_name(asked.method)
    K = pinhole(found, asked.zoom)
    T_world_seen = beside(found, asked.turned_deg, asked.raised_deg)
    figure, axes = plt.subplots(1, 3, figsize=(15, 4.1), layout="constrained")
    inverse = np.ma.masked_array(1 / found.depth_m, ~found.mask)
    drawn = axes[0].imshow(inverse, cmap="turbo", vmin=found.rho.min(), vmax=found.rho.max(),
                           interpolation="nearest")  # fmt: skip
    axes[0].set(title=f"{asked.method}, one window of {len(stored.windows)}", xticks=[], yticks=[])
    bar = figure.colorbar(drawn, ax=axes[0], shrink=0.8, label="depth, m")
    ticks = np.linspace(found.rho.min(), found.rho.max(), 6)
    bar.set_ticks(ticks, labels=[f"{1 / rho:.2g}" for rho in ticks])
    cloud = o3d.io.read_point_cloud(str(folder / "cloud.ply"))
    draw_cloud(axes[1], cloud, K, T_world_seen)
    axes[1].set_title(f"global cloud, {len(cloud.points)} points, from beside")
    draw_mesh(axes[2], o3d.io.read_triangle_mesh(str(folder / "mesh.ply")), K, T_world_seen)
    axes[2].set_title("mesh, gaps filled: partly a guess")
    figure.savefig(asked.out, dpi=DPI)


if __name__ == "__main__":
    main()
