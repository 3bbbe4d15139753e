# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors and warnings of the command line."""

import sys

from checkweigher_core.printable import one_line


class UserError(ValueError):
    """Raised if a command fails for a reason that the user can correct. The message is one line."""


class LineError(UserError):
    """Raised if a replay fails, a record cannot be trusted, or a signature is refused.

    Also raised if no record contains a verdict on the requested item. With this error, the exit
    status of a command is 1 instead of 2.
    """

    exit_status = 1


def warn(text: object) -> None:
    """Print a text as one line on stderr."""
    print(one_line(text), file=sys.stderr, flush=True)
