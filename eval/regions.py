"""Names of the regions that numbers are about; `eval.masks` draws them."""

from __future__ import annotations

REGIONS: dict[str, str] = {
    "all": "every pixel with ground truth",
    "common": "the pixels that all methods report",
    "interior": "the pixels away from depth discontinuities",
    "boundary": "the pixels at depth discontinuities",
    "edges": "the pixels on texture edges",
    "static": "the pixels of what stands still",
    "moving": "the pixels of what moves by itself",
}

DRAWN: tuple[str, ...] = tuple(name for name in REGIONS if name not in ("all", "common"))
"""Those that are drawn from ground truth."""
