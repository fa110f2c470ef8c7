"""Every rival by name. A method of one's own needs no entry here: `emvs.methods.register`."""

from __future__ import annotations

from emvs.rivals.rival import Rival, found_in

# What `--method baselines` stands for is all of these that need events only, in this order.
RIVALS: tuple[Rival, ...] = (
    Rival(
        "SGM/ts",
        "semi-global matching of the two time surfaces at the reference time",
        found_in("emvs.rivals.sgm"),
        confidence="time surface, 0..1",
    ),
    Rival(
        "SGM/window",
        "SGM/ts at 20 Hz, averaged over the window by the poses",
        found_in("emvs.rivals.sgm", "estimate_window"),
        confidence="sum of time surfaces",
    ),
    Rival(
        "ESVO/own-rate",
        "ESVO's mapping: events refined on time surfaces, the newest maps fused",
        found_in("emvs.rivals.esvo"),
        confidence="1 / σ of inverse depth, m",
    ),
    Rival(
        "ESVO/window",
        "ESVO's mapping, every map of the window fused",
        found_in("emvs.rivals.esvo", "estimate_window"),
        confidence="1 / σ of inverse depth, m",
    ),
    Rival(
        "GTS/events",
        "pairs of events that coincide in row, time and motion",
        found_in("emvs.rivals.gts"),
        confidence="1 / (1 + energy), 0..1",
    ),
    Rival(
        "Frames/sgm",
        "semi-global matching of an ordinary stereo camera's pictures",
        found_in("emvs.rivals.frames"),
        needs="frames of an ordinary camera",
        confidence="contrast, grey levels",
    ),
)

# Words of `--method` for several methods; `all` is `emvs.methods.known_methods`.
GROUPS: dict[str, tuple[str, ...]] = {
    "baselines": tuple(one.name for one in RIVALS if not one.needs),
    "everything": ("all", "Late/union", *(one.name for one in RIVALS if not one.needs)),
}

_BY_NAME = {rival.name: rival for rival in RIVALS}
FAMILIES = tuple(dict.fromkeys(rival.name.split("/")[0] for rival in RIVALS))


def rival(name: str) -> Rival | None:
    """The rival of this name, if there is one."""
    return _BY_NAME.get(name)


def names() -> tuple[str, ...]:
    """What `baselines` stands for: every rival that needs nothing but the events of two cameras."""
    return GROUPS["baselines"]
