"""The verbs of the command line, a module each; importing this package registers them all.

Modules here import what is light at their top and what is heavy inside their function: help must
come at once.
"""

from eval.commands import (  # noqa: F401
    compare,
    convert,
    fuse,
    gate,
    info,
    inventory,
    map,  # noqa: A004
    report,
    run,
    score,
    simulate,
    study,
    suite,
)
