# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opening a serial port, and saying in words why that cannot be done."""

import errno
import grp
from pathlib import Path

import serial

_READ_TIMEOUT = 0.1  # s, after which a read returns what has come
_WRITE_TIMEOUT = 1.0  # s


class SerialError(ValueError):
    """What a port or the device on it does not do; the message is one line for a technician."""


def open_port(name: str, baud_rate: int) -> serial.Serial:
    """Open a serial port for this process alone; `SerialError` says why that is not possible."""
    try:
        return serial.Serial(
            name, baud_rate, timeout=_READ_TIMEOUT, write_timeout=_WRITE_TIMEOUT, exclusive=True
        )
    except (OSError, ValueError) as error:  # SerialException is an OSError
        raise SerialError(f'{name}: {reason_of(name, error)}') from None


def reason_of(name: str, error: Exception) -> str:
    """Return what an error of a port means to a technician."""
    # pyserial hands some on as what it was raised from.
    number = getattr(error, 'errno', None) or getattr(error.__context__, 'args', (None,))[0]
    if number in (errno.ENOENT, errno.ENXIO, errno.ENODEV):
        return 'there is no such port; is the device plugged in?'
    if number in (errno.EACCES, errno.EPERM):
        try:
            group = grp.getgrgid(Path(name).stat().st_gid).gr_name
        except (OSError, KeyError):
            group = 'dialout'
        return f'no permission; add the user to the group {group} and log in again'
    if number in (errno.EAGAIN, errno.EBUSY):
        return 'another program has the port open'
    if number == errno.ENOTTY:
        return 'is no serial port'
    return ' '.join(str(error).split())
