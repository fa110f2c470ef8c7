"""Public names that differ from the names in the modules which define them."""

from eventsweep.eval.scoring.standings import standings as rank_methods

__all__ = ["rank_methods"]
