"""Public names that differ from the names in the modules which define them."""

from eventsweep.plugins.diagnose.check.findings import Report as CheckReport

__all__ = ["CheckReport"]
