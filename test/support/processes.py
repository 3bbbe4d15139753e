# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters and processes of a line."""

from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

from running import children

from checkweigher_bringup.spinning import write_parameter_file
from checkweigher_core.ros.ports import NODES

LINE = 'checkweigher_bringup.line'

Values = Mapping[str, Mapping[str, object]]


def parameter_file(path: Path, values: Values) -> Path:
    """Write the parameters of some nodes to a file and return its path."""
    write_parameter_file(path, values)
    return path


def pids_of(pid: int, name: str) -> list[int]:
    """Return the processes of a node, or of a whole ``line``, that a process has started."""
    module, found = NODES.get(name, LINE), []
    for child in children(pid):
        with suppress(FileNotFoundError, ProcessLookupError):  # it has ended meanwhile
            if module in Path(f'/proc/{child}/cmdline').read_text(encoding='utf-8').split('\0'):
                found.append(child)
    return found


def resident_memory(pid: int, field: str = 'VmRSS') -> int:
    """Return the memory of a process in kB, or with 'VmHWM' the most that it had."""
    status = Path(f'/proc/{pid}/status').read_text(encoding='ascii')
    fields = dict(line.split(':', 1) for line in status.splitlines())
    return int(fields[field].split()[0])
