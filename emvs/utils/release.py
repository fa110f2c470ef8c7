"""Where this project is found: the one place that changes when it is published or moves.

The package's metadata (`hatch_build.py`), the documentation site and errors take addresses from
here, so that none of them names another. Nothing is imported: packaging reads this file alone.
"""

REPOSITORY = "https://github.com/OWNER/eventsweep"
"""The repository; OWNER stands for whoever hosts it."""

DOCUMENTATION = "https://OWNER.github.io/eventsweep"
"""The documentation site, as `make site` builds it."""

ON_INDEX = False
"""Whether a package index has eventsweep. If not, it is installed from the repository."""


def requirement(extra: str = "") -> str:
    """What `pip install` takes, with an extra's name; in quotes as a shell needs them."""
    name = f"eventsweep[{extra}]" if extra else "eventsweep"
    if ON_INDEX:
        return f"'{name}'" if extra else name
    return f"'{name} @ git+{REPOSITORY}'"


def install(extra: str = "") -> str:
    """The command that installs eventsweep with an extra."""
    return f"pip install {requirement(extra)}"


def page(name: str, section: str = "") -> str:
    """The address of a page: its file in `docs/` without the ending, and a heading's anchor."""
    return f"{DOCUMENTATION}/{name}.html" + (f"#{section}" if section else "")
