# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Opening of a serial port, with error messages for a technician."""

import errno
import grp
from pathlib import Path

import serial

_READ_TIMEOUT = 0.1  # s
_WRITE_TIMEOUT = 1.0  # s
_NO_PORT = 'there is no such port; is the device plugged in?'
_IN_USE = 'another program has the port open'
_REASONS: dict[int | None, str] = {
    errno.ENOENT: _NO_PORT,
    errno.ENXIO: _NO_PORT,
    errno.ENODEV: _NO_PORT,
    errno.EAGAIN: _IN_USE,
    errno.EBUSY: _IN_USE,
    errno.ENOTTY: 'is not a serial port',
}


class SerialError(ValueError):
    """Raised if a serial port or its device fails. The message is one line for a technician."""


def open_port(name: str, baud_rate: int) -> serial.Serial:
    """Open a serial port for exclusive use. Raises `SerialError` with the reason of a failure."""
    try:
        return serial.Serial(
            name, baud_rate, timeout=_READ_TIMEOUT, write_timeout=_WRITE_TIMEOUT, exclusive=True
        )
    except (OSError, ValueError) as error:  # OSError includes serial.SerialException
        raise SerialError(f'{name}: {reason_of(name, error)}') from None


def reason_of(name: str, error: Exception) -> str:
    """Return the reason of an error of the serial port `name`, in words for a technician."""
    # pyserial wraps some errors in another error without an error number, so use the number of the
    # wrapped error.
    number = getattr(error, 'errno', None) or getattr(error.__context__, 'args', (None,))[0]
    if number in (errno.EACCES, errno.EPERM):
        try:
            group = grp.getgrgid(Path(name).stat().st_gid).gr_name
        except (OSError, KeyError):
            group = 'dialout'
        return f'no permission; add the user to the group {group} and log in again'
    return _REASONS.get(number, ' '.join(str(error).split()))
