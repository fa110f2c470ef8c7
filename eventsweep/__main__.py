"""The command line, `eventsweep` and `python -m eventsweep`, wherever it is started.

A folder of the user's called `eval` or `sim`, and a PYTHONPATH that names its parent, must not take
the place of our packages; so ours are put first before any of them is imported.
"""

from __future__ import annotations

import sys

from eventsweep.installation import PACKAGES, put_first, refuse_hidden


def main() -> None:
    """Runs one command and ends the process with its code."""
    put_first()
    try:
        refuse_hidden(PACKAGES[-1])
    except ImportError as error:
        sys.stderr.write(f"eventsweep: {error}\n")
        sys.exit(2)
    from eval.cli.main import main as command

    command()


if __name__ == "__main__":
    main()
