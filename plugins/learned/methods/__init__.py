"""The learned methods, which join the others through the group `eventsweep.methods`."""

from eventsweep.emvs.methods import register
from eventsweep.plugins.learned.methods.derd import DERD
from eventsweep.plugins.learned.methods.learned import LEARNED


def register_methods() -> None:
    """Adds the families `Learned` and `DERD` to those known by name."""
    register(LEARNED)
    register(DERD)
