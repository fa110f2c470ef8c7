"""The verbs of the command line, a module each; importing this package registers them all.

Modules here import what is light at their top and what is heavy inside their function: help must
come at once.
"""

from eval.commands import inventory, map, report, run, score, simulate  # noqa: A004, F401
