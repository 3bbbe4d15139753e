# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Processes that are killed at a bag of a certain name, as by the kernel for lack of memory."""

import os
from pathlib import Path

_SITE = """
import os, signal
from checkweigher_recording.archive import digest

def deadly(path):
    if path.name == 'deadly':
        os.kill(os.getpid(), signal.SIGKILL)
    return digest_of(path)

digest_of, digest.bag_digest = digest.bag_digest, deadly
"""


def deadly_environment(folder: Path) -> dict[str, str]:
    """Return variables of processes that die at each bag named deadly; `folder` is for a file."""
    (folder / 'sitecustomize.py').write_text(_SITE)
    return {'PYTHONPATH': os.pathsep.join([str(folder), os.environ.get('PYTHONPATH', '')])}
