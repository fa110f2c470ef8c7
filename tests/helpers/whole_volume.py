"""One camera's rays by a trajectory, and their whole volume, which mapping never has in memory."""

from eventsweep.emvs.dsi.rays import knots, rays_between
from eventsweep.emvs.dsi.voting import Scratch


def event_rays(events, camera, T_body_cam, trajectory, T_world_rv, rv_camera, *, packets=False):
    """Rays of events in the reference view, each by its own pose on the trajectory."""
    poses = knots(trajectory, T_world_rv)
    return rays_between(events, camera, T_body_cam, poses, rv_camera, packets=packets)


def dsi(rays, rho, width_px, height_px, *, nearest=False):
    """(N, H, W) float32 votes of `rays` in (N,) planes `rho`, and what was counted."""
    scratch = Scratch(1, len(rho), width_px, height_px, nearest=nearest)
    counts = scratch.cast(0, rays, rho)
    return scratch.images(len(rho))[0].copy(), counts
