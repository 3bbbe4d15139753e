# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reader of a load cell on a serial port."""

from collections.abc import Iterator
import threading
import time
from typing import NamedTuple

import serial

from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.serial.decoder import Decoded, Decoder
from checkweigher_driver.serial.port import SerialError

_RATE_PERIOD = 5.0  # time in s over which the sample rate is measured
_RATE_TOLERANCE = 0.05  # smallest relative error of the nominal sample rate that is reported
_RESUMING = 0.1  # shortest duration in s of the readings that determine the index after a break


class Read(NamedTuple):
    """Data of one read of the port, with one or more complete readings."""

    values: Decoded
    at: int  # real time in ns at which the last reading in `values` arrived
    size: int  # number of bytes in this read


class ValueReader:
    """Reader of the readings that one device sends.

    The iterators that the reader returns end when `closed` is set.

    `rate` is the nominal sample rate in Hz, and `in_block` is the number of readings for which a
    read waits. The device counts as silent after `timeout` s without a reading. `comes` is true
    while readings arrive. `trouble` is a message if the measured sample rate differs from `rate` by
    5 % or more, otherwise empty. `figures` contains counts for the diagnostics, by name.
    """

    def __init__(self, rate: float, in_block: int, timeout: float, closed: threading.Event) -> None:
        self._rate = rate
        self._in_block = in_block
        self._timeout = timeout
        self._closed = closed
        self.comes = False
        self.trouble = ''
        self.figures = {'bytes skipped': 0, 'bad frames': 0}

    def reads(self, port: serial.Serial, decoder: Decoder) -> Iterator[Read]:
        """Yield each read that completes at least one reading, until `closed` is set.

        Raises `SerialError` if no reading arrives for `timeout` s. If the port has disappeared, the
        exception of the port is raised.
        """
        self.comes, self.trouble = False, ''
        began, number = 0.0, 0  # start in s and number of readings of the rate measurement
        last_value, idle_bytes = time.monotonic(), 0
        while not self._closed.is_set():
            # While the frame size is unknown, assume one byte, so that the read does not wait too
            # long.
            rest = (self._in_block - 1) * max(decoder.frame_bytes, 1)
            skipped, bad = decoder.skipped_bytes, decoder.bad_frames
            data = port.read(rest + decoder.missing)
            now = time.time_ns()
            values = decoder.feed(data)
            self.figures['bytes skipped'] += decoder.skipped_bytes - skipped
            self.figures['bad frames'] += decoder.bad_frames - bad
            if not len(values.counts):
                idle_bytes += len(data)
                if time.monotonic() - last_value > self._timeout:
                    raise SerialError(f'{port.name}: {self._silence(idle_bytes)}')
                continue
            last_value, idle_bytes = time.monotonic(), 0
            number += len(values.counts)
            if not self.comes:
                began, number = last_value, 0
            elif last_value - began >= _RATE_PERIOD:
                self._check_rate(number / (last_value - began))
                began, number = last_value, 0
            self.comes = True
            # Subtract one sample period for each reading that still waits in the decoder, because
            # this reading has arrived after the last reading in `values`.
            at = now - round(decoder.waiting * NANOSECONDS / self._rate)
            yield Read(values, at, len(data))

    def _check_rate(self, found: float) -> None:
        is_off = abs(found / self._rate - 1) >= _RATE_TOLERANCE
        self.trouble = f'the device sends {found:.0f} values per second' if is_off else ''

    def _silence(self, bytes_came: int) -> str:
        during = f'for {self._timeout:g} s'
        if bytes_came:
            advice = 'check baud_rate and the output format of the device'
            return f'bytes arrive, but no values {during}; {advice}'
        return f'no bytes arrive {during}; check the cable and the supply of the device'

    def first_reads(self, port: serial.Serial, reads: Iterator[Read]) -> list[Read]:
        """Return the first reads after a break, up to the first read whose time is reliable.

        The time of a read is not reliable if its bytes may have waited in the input buffer of the
        port. The returned reads contain at least 0.1 s of readings, unless the reader is closed
        earlier.
        """
        first, number = [], 0
        for read in reads:
            first.append(read)
            number += len(read.values.counts)
            if number >= _RESUMING * self._rate and port.in_waiting <= read.size:
                break
        return first
