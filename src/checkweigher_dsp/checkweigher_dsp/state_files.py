# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Where a node keeps what outlives its process."""

import os
from pathlib import Path
import re


def state_file(name: str) -> Path:
    """Return a file in $XDG_STATE_HOME/checkweigher, or ~/.local/state/checkweigher.

    Raises
    ------
    RuntimeError
        If the user has no home folder.
    """
    state = os.environ.get('XDG_STATE_HOME') or '~/.local/state'
    return Path(state, 'checkweigher', re.sub(r'[^\w.-]', '_', name)).expanduser()
