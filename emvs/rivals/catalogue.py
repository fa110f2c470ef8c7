"""Every baseline by name. A method of one's own needs no entry here: `emvs.methods.register`."""

from __future__ import annotations

from emvs.rivals.rival import BaselineEstimator, found_in

# What `--method baselines` stands for is all of these that need events only, in this order.
BASELINES: tuple[BaselineEstimator, ...] = (
    BaselineEstimator(
        "SGM/ts",
        "semi-global matching of the two time surfaces at the reference time",
        found_in("emvs.rivals.sgm"),
        confidence="time surface, 0..1",
    ),
    BaselineEstimator(
        "SGM/window",
        "SGM/ts at 20 Hz, averaged over the window by the poses",
        found_in("emvs.rivals.sgm", "estimate_window"),
        confidence="sum of time surfaces",
    ),
    BaselineEstimator(
        "ESVO/own-rate",
        "ESVO's mapping: events refined on time surfaces, the newest maps fused",
        found_in("emvs.rivals.esvo"),
        confidence="1 / σ of inverse depth, m",
    ),
    BaselineEstimator(
        "ESVO/window",
        "ESVO's mapping, every map of the window fused",
        found_in("emvs.rivals.esvo", "estimate_window"),
        confidence="1 / σ of inverse depth, m",
    ),
    BaselineEstimator(
        "GTS/events",
        "pairs of events that coincide in row, time and motion",
        found_in("emvs.rivals.gts"),
        confidence="1 / (1 + energy), 0..1",
    ),
    BaselineEstimator(
        "Frames/sgm",
        "semi-global matching of an ordinary stereo camera's pictures",
        found_in("emvs.rivals.frames"),
        needs="frames of an ordinary camera",
        confidence="contrast, grey levels",
    ),
)

# Words of `--method` for several methods; `all` is `emvs.methods.known_methods`.
GROUPS: dict[str, tuple[str, ...]] = {
    "baselines": tuple(one.name for one in BASELINES if not one.needs),
    "everything": ("all", "Late/union", *(one.name for one in BASELINES if not one.needs)),
}

_BY_NAME = {one.name: one for one in BASELINES}
FAMILIES = tuple(dict.fromkeys(one.family for one in BASELINES))


def baseline(name: str) -> BaselineEstimator | None:
    """The baseline of this name, if there is one."""
    return _BY_NAME.get(name)


def names() -> tuple[str, ...]:
    """What `baselines` stands for: every rival that needs nothing but the events of two cameras."""
    return GROUPS["baselines"]
