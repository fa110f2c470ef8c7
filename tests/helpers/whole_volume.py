"""One camera's whole ray-density volume, which mapping never has in memory."""

from eventsweep.emvs.dsi.voting import Scratch


def dsi(rays, rho, width_px, height_px, *, nearest=False):
    """(N, H, W) float32 votes of `rays` in (N,) planes `rho`, and what was counted."""
    scratch = Scratch(1, len(rho), width_px, height_px, nearest=nearest)
    counts = scratch.cast(0, rays, rho)
    return scratch.images(len(rho))[0].copy(), counts
