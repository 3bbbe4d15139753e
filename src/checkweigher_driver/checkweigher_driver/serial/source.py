# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Load cell on a serial port. The port is opened again after a break of the connection."""

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

import serial

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.recording import Event
from checkweigher_core.records import MAX_SAMPLE_RATE, LoadCell
from checkweigher_driver.serial.blocks import BlockMaker
from checkweigher_driver.serial.decoder import Decoder
from checkweigher_driver.serial.port import SerialError, open_port, reason_of
from checkweigher_driver.serial.reads import Read, ValueReader
from checkweigher_driver.sources import RETRY_TIME, Source

BITS_PER_BYTE = 10  # one start bit, eight data bits, one stop bit
_BROKEN = (OSError, termios.error)  # exceptions of a port that has disappeared
_reading = partial(parameter, minimum=-(2**31), maximum=2**31 - 1)


@dataclass(frozen=True)
class SerialParameters(Parameters):
    """Parameters that all load cells on serial ports have."""

    port: str = parameter('', 'device file, preferably in /dev/serial/by-id')
    baud_rate: int = parameter(
        115_200,
        'baud rate of the device, with 8 data bits, no parity, 1 stop bit',
        unit='Bd',
        minimum=300,
        maximum=4_000_000,
    )
    sample_rate: float = parameter(
        960.0,
        'sample rate to which the device is set',
        unit='Hz',
        minimum=1.0,
        maximum=MAX_SAMPLE_RATE,
    )
    block_duration: float = parameter(
        0.01, 'duration of a block', unit='s', minimum=0.001, maximum=1.0
    )
    timeout: float = parameter(
        1.0, 'silence after which the device is set up again', unit='s', minimum=0.1, maximum=60.0
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
        """Raise ParameterError if a parameter is missing, or if the baud rate is too low.

        `bytes_per_value` is the number of bytes that the device sends for each reading.
        """
        if not self.port:
            raise ParameterError(f'{self.node}.port: empty, must name a port such as /dev/ttyUSB0')
        for name in ('counts_per_kg', 'capacity', 'weigh_length'):
            if getattr(self, name) == 0:
                raise ParameterError(f'{self.node}.{name}: 0, must be given for this machine')
        least = math.ceil(self.sample_rate * bytes_per_value * BITS_PER_BYTE)
        if self.baud_rate < least:
            raise ParameterError(
                f'{self.node}.baud_rate: {self.baud_rate} Bd is too slow for {self.sample_rate:g} '
                f'values per second of {bytes_per_value} bytes; must be {least} Bd or more'
            )


class SerialSource(Source):
    """Load cell that streams readings over a serial port.

    The constructor opens the port and sets up the device. If the port disappears or the device is
    silent, the source opens the port again and sets up the device again. The sample index increases
    by the number of samples that were lost in the meantime.
    """

    paced = False

    def __init__(self, parameters: SerialParameters, bytes_per_value: int) -> None:
        parameters.check_complete(bytes_per_value)
        self._settings = parameters
        frame_time = bytes_per_value * BITS_PER_BYTE / parameters.baud_rate
        self._closed = threading.Event()
        self._reading = False
        self._port: serial.Serial | None = None
        self._broken = ''  # message on the last break, valid until readings arrive again
        self._breaks = 0
        rate, latency = parameters.sample_rate, parameters.delay + frame_time
        in_block = max(1, round(parameters.block_duration * rate))
        self._reader = ValueReader(rate, in_block, parameters.timeout, self._closed)
        self._blocks = BlockMaker(rate, latency, (parameters.min_counts, parameters.max_counts))
        try:
            load_cell = LoadCell.of(parameters)
        except ValueError as error:
            raise ParameterError(f'{parameters.node}: {error}') from None
        model, serial_number = self._identity = self._open()
        self.load_cell = replace(load_cell, model=model, serial_number=serial_number)
        self.start_stamp = time.time_ns()

    @abstractmethod
    def _make_decoder(self) -> Decoder:
        """Return a decoder for a new stream."""

    def _start_up(self, port: serial.Serial) -> tuple[str, str]:
        """Set up the device for streaming; return its model and serial number, empty if unknown."""
        return '', ''

    def _begin(self, port: serial.Serial) -> None:
        """Start the stream of the device. A subclass overrides this if a command is needed."""

    def _end(self, port: serial.Serial) -> None:
        """Stop the stream of the device. A subclass overrides this if a command is needed."""

    def __iter__(self) -> Iterator[Event]:
        """Yield blocks until `close` is called.

        Raises `SerialError` if another device answers after a break of the connection.
        """
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
        self._breaks += 1
        self._reader.comes = False
        broken = f'{self._settings.port}: the connection is broken; is the device plugged in?'
        self._broken = broken if isinstance(error, _BROKEN) else str(error)
        self._let_go()

    def _open_again(self) -> None:
        """Try to open the port every 0.3 s until this succeeds or the source is closed.

        Raises `SerialError` if the device that answers is not the device of the first connection.
        """
        while not self._closed.wait(RETRY_TIME):
            try:
                identity = self._open()
            except SerialError as error:
                self._broken = str(error)
                continue
            if identity != self._identity:
                raise SerialError(
                    f'{self._settings.port}: {" ".join(identity)} answers instead of '
                    f'{" ".join(self._identity)}; restart with the calibration of this device'
                )
            return

    def _let_go(self) -> None:
        port, self._port = self._port, None
        if port is not None:
            with closing(port), suppress(*_BROKEN):
                self._end(port)

    def close(self) -> None:
        """Stop the device and close the port.

        During an iteration, the iterator closes the port after its present read, which ends within
        0.1 s, or after its present attempt to open the port. A closed source cannot be iterated
        again.
        """
        self._closed.set()
        if not self._reading:
            self._let_go()

    def _stream(self) -> Iterator[Event]:
        """Yield the blocks of one stream of the device until the source is closed.

        If the connection breaks, `SerialError` or one of the exceptions in `_BROKEN` is raised.
        """
        port = self._port
        assert port is not None
        self._begin(port)
        reads = self._reader.reads(port, self._make_decoder())
        first: list[Read] = []
        if self._blocks.index:
            first = self._reader.first_reads(port, reads)
            if self._closed.is_set():
                return
            self._blocks.resume(first)
        for read in chain(first, reads):
            yield from self._blocks.blocks(read)

    @property
    def trouble(self) -> str:
        """Present fault of the device in one line, or an empty string if there is no fault."""
        if not self._reader.comes:
            return self._broken
        return self._reader.trouble and (
            f'{self._reader.trouble}, but {self._settings.node}.sample_rate is '
            f'{self._settings.sample_rate:g}'
        )

    def figures(self) -> dict[str, float]:
        """Return values on samples, losses, breaks and the clock for the diagnostics, by name."""
        return {**self._blocks.figures(), **self._reader.figures, 'breaks': self._breaks}
