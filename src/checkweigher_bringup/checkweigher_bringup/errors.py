# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors and warnings of the command line."""

import sys

from checkweigher_core.printable import one_line


class UserError(ValueError):
    """An error that the user can correct. Its message is one line."""


class LineError(UserError):
    """A failure of the line, such as an item without a verdict."""

    exit_status = 1


def warn(text: object) -> None:
    """Print a text as one line on stderr."""
    print(one_line(text), file=sys.stderr, flush=True)
