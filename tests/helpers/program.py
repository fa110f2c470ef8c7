"""The commands of the program, those of groups too: `run`, `archive make`."""

from eventsweep.eval.cli.main import app


def command(name):
    """The program of a command, named by one word or two."""
    found = app
    for word in name.split():
        found = found[word]
    return found


def _expanded(verb):
    if app[verb].default_command is not None:
        return [verb]
    return [f"{verb} {name}" for name in app[verb] if not name.startswith("-")]


COMMANDS = tuple(name for verb in app if not verb.startswith("-") for name in _expanded(verb))
