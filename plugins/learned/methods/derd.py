"""DERD-Net's extraction: a recurrent network reads the whole column of votes of a pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap, confidence_mask, extract, without_border
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.methods.method import Extraction, Method, Swept
from eventsweep.plugins.learned.networks.derd import (
    PLANES,
    SIDE_PX,
    DepthRange,
    columns_of,
    derd_net,
    selecting,
)
from eventsweep.plugins.learned.networks.weights import files_of_weights, packaged


class Derd(Extraction):
    """The published network (`plugins.learned.networks.derd`); no median, as published."""

    family = "DERD"
    grammar = "DERD/H"
    summary = "DERD-Net (published): a recurrent network reads all 100 planes around a pixel"
    examples: tuple[str, ...] = ("DERD/H",)
    how = ", read by DERD-Net"
    keeps_votes = trained = True
    planes = PLANES

    def check(self, config: MapperConfig) -> None:
        """Refuses planes that the network cannot read, and weights that are none."""
        if config.planes not in (None, PLANES) or config.spacing != "inverse":
            raise InputError(
                f"DERD/H with {config.planes or PLANES} planes of {config.spacing} spacing: the "
                f"network reads {PLANES} planes of inverse spacing; set planes {PLANES} and "
                "spacing inverse"
            )
        derd_net(config.derd.weights)

    def files(self, config: MapperConfig) -> tuple[Path, ...]:
        """The weights and their manifest."""
        return files_of_weights(config.derd.weights or packaged("derd"))

    def build(self, name: str, mcemvs: bool = False) -> Method:
        """`DERD/H`; the authors' weights were trained on the H of the compatibility setting."""
        if name != "DERD/H":
            raise InputError(f"unknown method {name!r}: the published network is DERD/H")
        return super().build(name, mcemvs)

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """The network's depth at the pixels that stand out from their surroundings."""
        votes, view = swept.result.maxima[method.name], swept.view
        net, selection = derd_net(swept.config.derd.weights), selecting(swept.config)
        rim = max(selection.border_px, SIDE_PX // 2)
        mask = without_border(confidence_mask(votes.value, selection), rim)
        at = np.nonzero(mask)
        parts = columns_of(method.fusion, swept.votes_of_planes, view, *at)
        places = [np.empty(0, np.float32), *(net.places(part, count) for part, count in parts)]
        plain = extract(method.name, votes, view, selection.model_copy(update={"median_px": 1}))
        depth_m = plain.depth_m
        depth_m[at] = DepthRange.of(view.rho).depth_m(np.concatenate(places), net.uniform_in)
        return replace(plain, depth_m=depth_m, mask=mask)


DERD = Derd()
