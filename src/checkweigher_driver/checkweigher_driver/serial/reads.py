# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reads of a serial port that complete values."""

from collections.abc import Iterator
import threading
import time
from typing import NamedTuple

import serial

from checkweigher_core.records import NANOSECONDS
from checkweigher_driver.serial.decoder import Decoded, Decoder
from checkweigher_driver.serial.port import SerialError

_RATE_PERIOD = 5.0  # s over which the rate is measured, longer than a stall of the machine
_RATE_TOLERANCE = 0.05
_RESUMING = 0.1  # s of signal after a break that determine the index


class Read(NamedTuple):
    """One read of the port that completed values."""

    values: Decoded
    at: int  # ns, arrival of the last value
    size: int  # bytes


class ValueReader:
    """Reader of one device until `closed` is set; port and decoder are new after a break.

    `rate` is the nominal number of values per second, and `in_block` the number of values in a
    read. The device counts as silent after `timeout` s without a value. `comes` is true while
    values come. `trouble` reports a rate that differs from the nominal one.
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
        """Yield the reads that complete values; `SerialError` if none come for too long."""
        self.comes, self.trouble = False, ''
        began, number = 0.0, 0  # of the measurement of the rate
        last_value, idle_bytes = time.monotonic(), 0
        while not self._closed.is_set():
            # Until the frame size is known, assume one byte for each value.
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
            # Values that wait in the decoder came after the last of these.
            at = now - round(decoder.waiting * NANOSECONDS / self._rate)
            yield Read(values, at, len(data))

    def _check_rate(self, found: float) -> None:
        is_off = abs(found / self._rate - 1) >= _RATE_TOLERANCE
        self.trouble = f'the device sends {found:.0f} values a second' if is_off else ''

    def _silence(self, bytes_came: int) -> str:
        during = f'for {self._timeout:g} s'
        if bytes_came:
            advice = 'check baud_rate and the format that the device is set to'
            return f'bytes come, but no values {during}; {advice}'
        return f'no bytes come {during}; check its supply and the cable'

    def first_reads(self, port: serial.Serial, reads: Iterator[Read]) -> list[Read]:
        """Return the reads after a break, up to one that did not wait in the port.

        The arrival of values that waited is unknown.
        """
        first, number = [], 0
        for read in reads:
            first.append(read)
            number += len(read.values.counts)
            if number >= _RESUMING * self._rate and port.in_waiting <= read.size:
                break
        return first
