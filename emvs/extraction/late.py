"""Late fusion: the single cameras' depth maps, joined."""

from __future__ import annotations

from eventsweep.emvs.config import MapperConfig
from eventsweep.emvs.depth.depth_map import DepthMap, union
from eventsweep.emvs.dsi.fusion import Fusion
from eventsweep.emvs.errors import InputError
from eventsweep.emvs.extraction.method import Extraction, Method, Swept, single_cameras


class Late(Extraction):
    """Per pixel the most confident camera; the volume, the cameras' maximum, only shows a slice."""

    family = "Late"
    grammar = "Late/union"
    summary = "per pixel the most confident camera among those that pass their own threshold"
    examples = ("Late/union",)
    calibrated = ("Late/union",)

    def measure(self, config: MapperConfig) -> None:
        """Nothing: it searches no rays of its own."""

    def parts(self, n_cameras: int) -> tuple[Method, ...]:
        """EMVS with each camera."""
        return single_cameras(n_cameras)

    def extract(self, method: Method, swept: Swept, /) -> DepthMap:
        """Joins the single cameras' depth maps."""
        parts = self.parts(len(swept.result.votes))
        return union(method.name, [swept.depth_map(part) for part in parts])

    def build(self, name: str, mcemvs: bool = False) -> Method:
        """The late fusion, the same in the compatibility setting."""
        del mcemvs
        if name != "Late/union":
            raise InputError(f"unknown method {name!r}: the late fusion is Late/union")
        return Method(name, "the single cameras' maps, joined", Fusion(), self)


LATE = Late()
