# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Child processes that end with their parent process, even if the parent is killed."""

import os
from pathlib import Path
import signal

CANNOT_START = 2  # exit status of a node that cannot start, for example with an invalid parameter
_SET_PARENT_DEATH_SIGNAL = 1  # option PR_SET_PDEATHSIG, see prctl(2)
_VARIABLE = 'CHECKWEIGHER_PARENT'


def child_environment() -> dict[str, str]:
    """Return the environment for a child process that calls `end_with_parent`."""
    return {**os.environ, **child_variable()}


def child_variable() -> dict[str, str]:
    """Return the environment variable that tells a child process the ID of this process."""
    return {_VARIABLE: str(os.getpid())}


def parent_identity() -> str:
    """Return a unique identity of the parent process.

    The identity consists of boot ID, process ID and start time. On a system without /proc, the
    identity is only the process ID.
    """
    parent = os.getppid()
    try:
        after_name = Path(f'/proc/{parent}/stat').read_text(encoding='utf-8').rpartition(')')[2]
        boot = Path('/proc/sys/kernel/random/boot_id').read_text(encoding='utf-8').strip()
    except OSError:
        return str(parent)
    return f'{boot} {parent} {after_name.split()[19]}'  # starttime in proc(5)


def end_with_parent(parent: int | None = None) -> None:
    """Let the kernel send SIGTERM to this process when its parent ends.

    `parent` is the process ID of the parent. The default is the ID in the environment variable that
    `child_variable` returns. Without an ID, no signal is sent, because a command that a user starts
    in a shell may outlive the shell. If the parent has already ended, this process gets the signal
    at once. The kernel also sends the signal if the parent continues but its thread that started
    this process ends. The environment variable is removed, so that the child processes of this
    process do not inherit it.
    """
    stated = os.environ.pop(_VARIABLE, '')
    parent = int(stated or 0) if parent is None else parent
    if not parent:
        return
    import ctypes

    ctypes.CDLL(None).prctl(_SET_PARENT_DEATH_SIGNAL, int(signal.SIGTERM), 0, 0, 0)
    if os.getppid() != parent:  # the parent had ended before prctl was called
        os.kill(os.getpid(), signal.SIGTERM)
