# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Errors of the command line itself."""


class UserError(ValueError):
    """Something the user can put right; the message is the one line that is shown."""

    exit_status = 2


class LineError(UserError):
    """The line did not do its work: an item got no verdict."""

    exit_status = 1
