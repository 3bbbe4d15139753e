# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors and warnings of the command line."""

import sys

from checkweigher_core.printable import one_line


class UserError(ValueError):
    """Raised if a command fails for a reason that the user can correct. The message is one line."""


class LineError(UserError):
    """Raised if a line, a record or a signature fails, for example if an item has no verdict."""

    exit_status = 1


def warn(text: object) -> None:
    """Print a text as one line on stderr."""
    print(one_line(text), file=sys.stderr, flush=True)
