"""Methods from other installed packages, found by their entry points.

A package offers them in its `pyproject.toml`; the function takes nothing and calls `register`:

    [project.entry-points."eventsweep.methods"]
    mine = "my_package.eventsweep:register_methods"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from emvs.errors import InputError

GROUP = "eventsweep.methods"


@cache
def load() -> None:
    """Lets every installed package register its methods, once in a process.

    Raises:
        InputError: one that cannot be imported, or fails.
    """
    for point in entry_points(group=GROUP):
        try:
            point.load()()
        except Exception as error:  # whatever a stranger's code raises
            reason = " ".join(str(error).split()) or type(error).__name__
            package = point.dist.name if point.dist else "a package"
            raise InputError(
                f"{package}: its methods ({point.name} = {point.value}) cannot be registered "
                f"({reason}): mend or uninstall it"
            ) from error
