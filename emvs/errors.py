"""The one error that a user can cause."""


class InputError(ValueError):
    """Input that cannot be used: what came, what is needed, how to cure it, in one line."""
