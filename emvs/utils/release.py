"""Where this project is found: the one place that changes when it is published or moves.

The package's metadata (`hatch_build.py`), the documentation site and errors take addresses from
here. While they are empty, texts name no address and give commands that need none. Nothing is
imported at the top: packaging reads this file alone.
"""

REPOSITORY = ""
"""Address of the repository, such as `https://example.org/eventsweep`; empty: not published."""

DOCUMENTATION = ""
"""Address of the documentation site, as `make site` builds it; empty: not published."""

ON_INDEX = False
"""Whether a package index has eventsweep. If not, it is installed from the repository."""


def requirement(extra: str = "") -> str:
    """What `pip install` takes, with an extra's name; in quotes as a shell needs them.

    Without any address it is the folder of a checkout, in which the command is called.
    """
    brackets = f"[{extra}]" if extra else ""
    if not ON_INDEX and REPOSITORY:
        return f"'eventsweep{brackets} @ git+{REPOSITORY}'"
    name = f"{'eventsweep' if ON_INDEX else '.'}{brackets}"
    return f"'{name}'" if extra else name


def install(extra: str = "") -> str:
    """The command that installs eventsweep with an extra."""
    return f"pip install {requirement(extra)}"


def install_extra(extra: str) -> str:
    """The command that adds an extra to an installed eventsweep.

    Without any address it installs what the extra consists of, by the installed metadata: that
    works beside a checkout as well as beside a wheel.
    """
    parts = [] if ON_INDEX or REPOSITORY else _parts(extra)
    return f"pip install {' '.join(parts)}" if parts else install(extra)


def _parts(extra: str) -> list[str]:
    """Requirements of an extra on this machine, quoted; none where nothing is installed."""
    from importlib.metadata import PackageNotFoundError, requires

    from packaging.requirements import Requirement

    try:
        every = [Requirement(line) for line in requires("eventsweep") or ()]
    except PackageNotFoundError:
        return []
    wanted = [
        one
        for one in every
        if one.marker
        and one.marker.evaluate({"extra": extra})
        and not one.marker.evaluate({"extra": ""})
    ]
    for one in wanted:
        one.marker = None
    return [f"'{one}'" for one in wanted]


def page(name: str, section: str = "") -> str:
    """The address of a page, or how to name it while there is no site.

    Args:
        name: its file in `docs/` without the ending.
        section: a heading's anchor.
    """
    if not DOCUMENTATION:
        return f"the page `{name}` of the documentation"
    return f"{DOCUMENTATION}/{name}.html" + (f"#{section}" if section else "")
