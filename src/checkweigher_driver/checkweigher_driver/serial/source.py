# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A load cell on a serial port: opened, read by blocking reads, found again after a break."""

from abc import abstractmethod
from collections.abc import Iterator
from contextlib import closing, suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import chain
import math
import termios
import threading
import time
from typing import NamedTuple

import numpy as np
import serial

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.recording import Event
from checkweigher_core.records import MAX_SAMPLE_RATE, NANOSECONDS, LoadCell, SampleBlock
from checkweigher_driver.serial.decoder import Decoded, Decoder
from checkweigher_driver.serial.port import SerialError, open_port, reason_of
from checkweigher_driver.serial.sample_clock import SampleClock, SampleStamper
from checkweigher_driver.sources import RETRY_TIME, Source

BITS_PER_BYTE = 10  # 8N1: a start bit, eight of data, a stop bit
_BROKEN = (OSError, termios.error)  # errors of a port that is gone
_RATE_PERIOD = 5.0  # s over which the rate is measured, longer than a stall of the machine
_RATE_TOLERANCE = 0.05
_RESUMING = 0.1  # s of signal after a break that determine the index
_reading = partial(parameter, minimum=-(2**31), maximum=2**31 - 1)


@dataclass(frozen=True)
class SerialParameters(Parameters):
    """Parameters that all load cells on serial ports share."""

    port: str = parameter('', 'device file, best one of /dev/serial/by-id')
    baud_rate: int = parameter(
        115_200,
        'baud rate of the device, with 8 data bits, no parity, 1 stop bit',
        unit='Bd',
        minimum=300,
        maximum=4_000_000,
    )
    sample_rate: float = parameter(
        960.0,
        'values a second, as the device is set',
        unit='Hz',
        minimum=1.0,
        maximum=MAX_SAMPLE_RATE,
    )
    block_duration: float = parameter(
        0.01, 'signal in one block', unit='s', minimum=0.001, maximum=1.0
    )
    timeout: float = parameter(
        1.0, 'time without a value before it is started again', unit='s', minimum=0.1, maximum=60.0
    )
    delay: float = parameter(
        0.0, 'delay of the signal by the filter of the device', unit='s', minimum=0, maximum=10
    )
    counts_per_kg: float = parameter(
        0.0, 'static sensitivity, must be given', unit='1/kg', minimum=-1e9, maximum=1e9
    )
    zero_counts: float = _reading(0.0, 'reading of the empty belt')
    min_counts: int = _reading(-(2**23), 'reading at or below which the converter is at its limit')
    max_counts: int = _reading(2**23 - 1, 'reading at or above which the converter is at its limit')
    capacity: float = parameter(
        0.0, 'capacity of the load cell, must be given', unit='kg', minimum=0.0, maximum=1e6
    )
    weigh_length: float = parameter(
        0.0,
        'distance between infeed and outfeed eye, must be given',
        unit='m',
        minimum=0.0,
        maximum=100.0,
    )

    def check_complete(self, bytes_per_value: int) -> None:
        """Raise ParameterError if a parameter is missing or the line too slow for the values."""
        if not self.port:
            raise ParameterError(f'{self.node}.port: empty, must name a port such as /dev/ttyUSB0')
        for name in ('counts_per_kg', 'capacity', 'weigh_length'):
            if getattr(self, name) == 0:
                raise ParameterError(f'{self.node}.{name}: 0, must be given for this machine')
        least = math.ceil(self.sample_rate * bytes_per_value * BITS_PER_BYTE)
        if self.baud_rate < least:
            raise ParameterError(
                f'{self.node}.baud_rate: {self.baud_rate} Bd is too slow for {self.sample_rate:g} '
                f'values a second of {bytes_per_value} bytes; must be {least} Bd or more'
            )


class _RateCheck:
    """Check of the rate of the device against its parameter; `text` is the difference, if any."""

    def __init__(self, parameters: SerialParameters) -> None:
        self._name, self._rate = f'{parameters.node}.sample_rate', parameters.sample_rate
        self._begin: float | None = None
        self._number = 0
        self.text = ''

    def add(self, number: int) -> None:
        """Add a number of values that have come by now."""
        now = time.monotonic()
        if self._begin is None:
            self._begin = now
            return
        self._number += number
        elapsed = now - self._begin
        if elapsed >= _RATE_PERIOD:
            found = self._number / elapsed
            self.text = ''
            if abs(found / self._rate - 1) >= _RATE_TOLERANCE:
                sent = f'the device sends {found:.0f} values a second'
                self.text = f'{sent}, {self._name} is {self._rate:g}'
            self._begin, self._number = now, 0


class _Read(NamedTuple):
    """One read of the port that completed values."""

    values: Decoded
    at: int  # ns, when the last of them had come
    size: int  # bytes


class SerialSource(Source):
    """Values that a device streams over a serial port.

    Opening it includes the start-up of the device, so that a wrong set-up is reported then. If the
    port goes and comes back later, the source opens it again, starts the device again, and
    continues with the index that belongs to the time. An item on the belt has lost samples then.
    """

    paced = False

    def __init__(self, parameters: SerialParameters, bytes_per_value: int) -> None:
        parameters.check_complete(bytes_per_value)
        self._settings = parameters
        self._frame_time = bytes_per_value * BITS_PER_BYTE / parameters.baud_rate
        self._closed = threading.Event()
        self._reading = False
        self._port: serial.Serial | None = None
        self._trouble = ''
        self._rate = _RateCheck(parameters)
        counted = 'samples', 'samples lost', 'bytes skipped', 'bad frames', 'breaks'
        self._figures = dict.fromkeys(counted, 0)
        self._clock = SampleClock(
            parameters.sample_rate, latency=parameters.delay + self._frame_time
        )
        self._stamper = SampleStamper(self._clock)
        self._index = 0  # of the next sample
        try:
            load_cell = LoadCell.of(parameters)
        except ValueError as error:
            raise ParameterError(f'{parameters.node}: {error}') from None
        model, serial_number = self._identity = self._open()
        self.load_cell = replace(load_cell, model=model, serial_number=serial_number)
        self.start_stamp = time.time_ns()

    @abstractmethod
    def _make_decoder(self) -> Decoder:
        """Return a decoder for a stream that begins."""

    def _start_up(self, port: serial.Serial) -> tuple[str, str]:
        """Prepare the device for streaming; return its model and serial number, if any."""
        return '', ''

    def _begin(self, port: serial.Serial) -> None:
        """Start the stream of the device."""

    def _end(self, port: serial.Serial) -> None:
        """Ask the device to stop its stream."""

    # The port: open, broken, open again, closed

    def __iter__(self) -> Iterator[Event]:
        """Yield blocks until `close`; `SerialError` if another device answers after a break."""
        self._reading = True
        try:
            while not self._closed.is_set():
                try:
                    yield from self._stream()
                except (*_BROKEN, SerialError) as error:
                    self._break_off(error)
                    self._open_again()
        finally:
            self._let_go()

    def _open(self) -> tuple[str, str]:
        """Open the port and start the device up."""
        port = open_port(self._settings.port, self._settings.baud_rate)
        try:
            identity = self._start_up(port)
        except _BROKEN as error:
            port.close()
            name = self._settings.port
            raise SerialError(f'{name}: {reason_of(name, error)}') from None
        except BaseException:
            port.close()
            raise
        self._port = port
        return identity

    def _break_off(self, error: Exception) -> None:
        if self._closed.is_set():
            return
        self._figures['breaks'] += 1
        broken = f'{self._settings.port}: the connection broke off; is the device plugged in?'
        self._trouble = broken if isinstance(error, _BROKEN) else str(error)
        self._let_go()

    def _open_again(self) -> None:
        """Open the port as soon as that is possible, unless the source is closed."""
        while not self._closed.wait(RETRY_TIME):
            try:
                identity = self._open()
            except SerialError as error:
                self._trouble = str(error)
                continue
            if identity != self._identity:
                raise SerialError(
                    f'{self._settings.port}: {" ".join(identity)} answers, '
                    f'{" ".join(self._identity)} did at the start; start again with its calibration'
                )
            return

    def _let_go(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with closing(port), suppress(*_BROKEN):
                self._end(port)

    def close(self) -> None:
        """Stop the device and close the port; the iterator ends within a tenth of a second.

        A source that was closed is not iterated again.
        """
        self._closed.set()
        if not self._reading:
            self._let_go()

    # One stream of the device, from its beginning to a break

    def _stream(self) -> Iterator[Event]:
        port = self._port
        assert port is not None
        self._rate = _RateCheck(self._settings)
        self._begin(port)
        reads = self._reads(port)
        first = []
        if self._index:
            first = self._first_reads(port, reads)
            if self._closed.is_set():
                return
            self._jump(self._lost_before(first))
        for read in chain(first, reads):
            yield from self._blocks(read)

    def _reads(self, port: serial.Serial) -> Iterator[_Read]:
        """Yield the reads that complete values; `SerialError` if none come for too long."""
        decoder, rate = self._make_decoder(), self._settings.sample_rate
        values_in_block = max(1, round(self._settings.block_duration * rate))
        last_value, idle_bytes = time.monotonic(), 0
        while not self._closed.is_set():
            # Until the frame size is known, one byte at least for each value.
            rest = (values_in_block - 1) * max(decoder.frame_bytes, 1)
            skipped, bad = decoder.skipped_bytes, decoder.bad_frames
            data = port.read(rest + decoder.missing)
            now = time.time_ns()
            values = decoder.feed(data)
            self._figures['bytes skipped'] += decoder.skipped_bytes - skipped
            self._figures['bad frames'] += decoder.bad_frames - bad
            if len(values.counts):
                last_value, idle_bytes = time.monotonic(), 0
                self._trouble = ''
                self._rate.add(len(values.counts))
                # Values that wait in the decoder have come after the last of these.
                yield _Read(values, now - round(decoder.waiting * NANOSECONDS / rate), len(data))
                continue
            idle_bytes += len(data)
            if time.monotonic() - last_value > self._settings.timeout:
                raise SerialError(self._silence(idle_bytes))

    def _silence(self, bytes_came: int) -> str:
        what, advice = 'no bytes come', 'check its supply and the cable'
        if bytes_came:
            what = 'bytes come, but no values'
            advice = 'check baud_rate and the format that the device is set to'
        return f'{self._settings.port}: {what} for {self._settings.timeout:g} s; {advice}'

    def _first_reads(self, port: serial.Serial, reads: Iterator[_Read]) -> list[_Read]:
        """Return the reads after a break, up to one that has not waited in the port.

        The time of values that have waited is unknown.
        """
        first, number = [], 0
        for read in reads:
            first.append(read)
            number += len(read.values.counts)
            if number >= _RESUMING * self._settings.sample_rate and port.in_waiting <= read.size:
                break
        return first

    def _lost_before(self, reads: list[_Read]) -> int:
        """Return the number of samples lost before some reads, from the time since the last one.

        The read with the smallest delay decides.
        """
        latency = round(NANOSECONDS * (self._settings.delay + self._frame_time))
        index, least = self._index - 1, math.inf
        for read in reads:
            index += len(read.values.counts) + int(read.values.lost.sum())
            least = min(least, read.at - latency - self._clock.stamp(index))
        return max(1, math.floor(least * self._settings.sample_rate / NANOSECONDS))

    def _blocks(self, read: _Read) -> Iterator[SampleBlock]:
        """Yield blocks of values, with a new block behind each gap, where the index jumps."""
        values, limits = read.values, self._settings
        at_limit = np.where(values.counts < 0, limits.min_counts, limits.max_counts)
        counts = np.where(values.overflow, at_limit, values.counts).astype(np.int32)
        gaps = np.flatnonzero(values.lost[1:]) + 1
        lost = values.lost[np.r_[0, gaps]].tolist()
        for lost_before, piece in zip(lost, np.split(counts, gaps), strict=True):
            self._jump(lost_before)
            first, self._index = self._index, self._index + len(piece)
            self._figures['samples'] += len(piece)
            yield from self._stamper.add(first, piece, read.at)

    def _jump(self, lost: int) -> None:
        self._index += lost
        self._figures['samples lost'] += lost

    @property
    def trouble(self) -> str:
        """Present trouble in one line."""
        return self._trouble or self._rate.text

    def figures(self) -> dict[str, float]:
        """Return the counts of samples, losses and breaks, and the figures of their clock."""
        return {**self._figures, **self._clock.figures()}
