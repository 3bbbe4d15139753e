"""Errors of the command line itself."""


class UserError(ValueError):
    """Something the user can put right; the message is the one line that is shown."""
