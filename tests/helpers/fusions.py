"""Every compiled mean as a function of (C, N, H, W) votes, by its name."""

from functools import partial

from eventsweep.emvs.dsi.fusion import MEANS, Fusion, fuse

FUSIONS = {name: partial(fuse, Fusion(mean.code)) for name, mean in MEANS.items()}
