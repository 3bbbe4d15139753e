"""A load cell on a serial port: opened, read by blocking reads, found again after a break."""

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
import math
import termios
import threading
import time

import numpy as np
from numpy.typing import NDArray
import serial

from checkweigher_driver.serial.decoding import Decoded, Decoder
from checkweigher_driver.serial.port import SerialError, open_port, reason_of
from checkweigher_driver.serial.sample_clock import SampleClock, SampleStamper
from checkweigher_driver.sources import Source
from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import MAX_SAMPLE_RATE, NANOSECONDS, LoadCell, SampleBlock
from checkweigher_recording.recording import Event

BITS_PER_BYTE = 10  # 8N1: a start bit, eight of data, a stop bit
_BROKEN = (OSError, termios.error)  # what a port raises that is gone; the latter is no OSError
_RATE_PERIOD = 5.0  # s over which the rate is measured; a stall of the machine is shorter
_RATE_TOLERANCE = 0.05
_RESUMING = 0.1  # s of signal after a break, from which the index is found
_FIRST_WAIT, _LONGEST_WAIT = 0.1, 2.0  # s between attempts to open the port again


@dataclass(frozen=True)
class SerialParameters(Parameters):
    """What all load cells on serial ports have in common."""

    port: str = parameter('', 'device file, best one of /dev/serial/by-id')
    baud_rate: int = parameter(
        115_200, 'as the device is set; 8 data bits, no parity, 1 stop bit', unit='Bd',
        minimum=300, maximum=4_000_000,
    )  # fmt: skip
    sample_rate: float = parameter(
        960.0, 'values a second, as the device is set', unit='Hz', minimum=1.0,
        maximum=MAX_SAMPLE_RATE,
    )  # fmt: skip
    block_duration: float = parameter(
        0.01, 'signal in one block', unit='s', minimum=0.001, maximum=1.0
    )
    timeout: float = parameter(
        1.0, 'without a value before the device is asked anew', unit='s', minimum=0.1, maximum=60.0
    )
    delay: float = parameter(
        0.0, 'by which the filter of the device delays the signal', unit='s', minimum=0.0,
        maximum=10.0,
    )  # fmt: skip
    counts_per_kg: float = parameter(
        0.0, 'static sensitivity, must be given', unit='1/kg', minimum=-1e9, maximum=1e9
    )
    zero_counts: float = parameter(
        0.0, 'reading of the empty belt', minimum=-(2**31), maximum=2**31 - 1
    )
    min_counts: int = parameter(
        -(2**23), 'reading at or below which the converter is at its limit', minimum=-(2**31),
        maximum=2**31 - 1,
    )  # fmt: skip
    max_counts: int = parameter(
        2**23 - 1, 'reading at or above which the converter is at its limit', minimum=-(2**31),
        maximum=2**31 - 1,
    )  # fmt: skip
    capacity: float = parameter(
        0.0, 'of the load cell, must be given', unit='kg', minimum=0.0, maximum=1e6
    )
    weigh_length: float = parameter(
        0.0, 'from the infeed eye to the outfeed eye, must be given', unit='m', minimum=0.0,
        maximum=100.0,
    )  # fmt: skip

    def check_complete(self, bytes_per_value: int) -> None:
        """Refuse what cannot work before anything is opened.

        Parameters
        ----------
        bytes_per_value : int
            That the device sends.

        Raises
        ------
        ParameterError
            If what must be given is not, or the line is too slow for the values.
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
                f'values a second of {bytes_per_value} bytes; must be {least} Bd or more'
            )


class _RateCheck:
    """Notice a device that is set to another rate than it is said to be."""

    def __init__(self, parameters: SerialParameters) -> None:
        self._name, self._rate = f'{parameters.node}.sample_rate', parameters.sample_rate
        self._begin: float | None = None
        self._number = 0
        self.text = ''

    def add(self, number: int) -> None:
        """Take a number of values that have come by now."""
        now = time.monotonic()
        if self._begin is None:
            self._begin = now
            return
        self._number += number
        if (elapsed := now - self._begin) >= _RATE_PERIOD:
            found = self._number / elapsed
            well = abs(found / self._rate - 1) < _RATE_TOLERANCE
            self.text = '' if well else (
                f'the device sends {found:.0f} values a second, {self._name} is {self._rate:g}'
            )  # fmt: skip
            self._begin, self._number = now, 0


class SerialSource(Source):
    """Values that a device streams over a serial port.

    Opening it includes the start-up of the device, so that what is wrong is said then. Later the
    port may go and come back: the source opens it again, starts the device anew, and the samples
    go on with the index that the time says. What was on the belt has lost samples.

    Parameters
    ----------
    parameters : SerialParameters
        Port, rate and calibration.
    bytes_per_value : int
        That the device sends.
    """

    paced = False

    def __init__(self, parameters: SerialParameters, bytes_per_value: int) -> None:
        parameters.check_complete(bytes_per_value)
        self._settings = parameters
        self._frame_time = bytes_per_value * BITS_PER_BYTE / parameters.baud_rate
        self._closed = threading.Event()
        self._reading = False
        self._lock = threading.Lock()
        self._port: serial.Serial | None = None
        self._trouble = ''
        self._rate = _RateCheck(parameters)
        self._figures = {'samples': 0, 'samples lost': 0, 'bytes skipped': 0, 'bad frames': 0}
        self._breaks = 0
        self._clock = SampleClock(
            parameters.sample_rate, latency=parameters.delay + self._frame_time
        )
        self._stamper = SampleStamper(self._clock)
        self._index = 0  # of the next sample
        self._identity = self._open()
        try:
            self.load_cell = self._load_cell(*self._identity)
        except ValueError as error:
            self.close()
            raise ParameterError(f'{parameters.node}: {error}') from None
        self.start_stamp = time.time_ns()

    @abstractmethod
    def _make_decoder(self) -> Decoder:
        """Return a decoder for a stream that begins."""

    def _start_up(self, port: serial.Serial) -> tuple[str, str]:
        """Bring the device to where it can stream; return its model and serial number.

        Raises
        ------
        SerialError
            If it does not do what it should.
        """
        return '', ''

    def _begin(self, port: serial.Serial) -> None:
        """Let the device stream."""

    def _end(self, port: serial.Serial) -> None:
        """Let the device stop; whether it does is not known."""

    def _load_cell(self, model: str, serial_number: str) -> LoadCell:
        known = self._settings
        return LoadCell(
            sample_rate=known.sample_rate,
            counts_per_kg=known.counts_per_kg,
            zero_counts=known.zero_counts,
            min_counts=known.min_counts,
            max_counts=known.max_counts,
            capacity=known.capacity,
            weigh_length=known.weigh_length,
            model=model,
            serial_number=serial_number,
        )

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
        with self._lock:
            self._port = port
        return identity

    def __iter__(self) -> Iterator[Event]:
        """Yield blocks of samples until the source is closed.

        Raises
        ------
        SerialError
            If another device answers than at the start.
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

    def _stream(self) -> Iterator[Event]:
        port, decoder = self._port, self._make_decoder()
        if port is None:
            return
        resumed = self._index > 0
        self._rate = _RateCheck(self._settings)
        first_reads: list[tuple[Decoded, int]] = []
        enough = _RESUMING * self._settings.sample_rate
        self._begin(port)
        size = max(1, round(self._settings.block_duration * self._settings.sample_rate))
        before = (0, 0)
        last_value, idle_bytes = time.monotonic(), 0
        while not self._closed.is_set():
            data = port.read((size - 1) * self._frame_bytes(decoder) + decoder.missing)
            now = time.time_ns()
            found = decoder.feed(data)
            idle_bytes += len(data)
            skipped = decoder.skipped_bytes, decoder.bad_frames
            self._figures['bytes skipped'] += skipped[0] - before[0]
            self._figures['bad frames'] += skipped[1] - before[1]
            before = skipped
            if len(found.counts):
                last_value, idle_bytes = time.monotonic(), 0
                self._trouble = ''
                self._rate.add(len(found.counts))
                # What waits in the decoder has come after the last of these.
                read_at = now - round(decoder.waiting * NANOSECONDS / self._settings.sample_rate)
                first_reads.append((found, read_at))
                number = sum(len(read.counts) for read, _ in first_reads)
                if resumed and (number < enough or port.in_waiting > len(data)):
                    continue  # what has waited to be read says nothing about the time
                if resumed:
                    self._jump(self._lost_until(first_reads))
                    resumed = False
                for read, at in first_reads:
                    yield from self._blocks(read, at)
                first_reads = []
            elif time.monotonic() - last_value > self._settings.timeout:
                raise SerialError(self._silence(idle_bytes))

    def _frame_bytes(self, decoder: Decoder) -> int:
        """Return how many bytes a value has, as far as that is known."""
        return max(decoder.frame_bytes, 1)

    def _silence(self, bytes_came: int) -> str:
        what = 'bytes come, but no values' if bytes_came else 'no bytes come'
        advice = (
            'check baud_rate and the format that the device is set to'
            if bytes_came
            else 'check its supply and the cable'
        )
        return f'{self._settings.port}: {what} for {self._settings.timeout:g} s; {advice}'

    def _blocks(self, found: Decoded, read_at: int) -> Iterator[SampleBlock]:
        """Turn values into blocks: a new one behind each gap, so that the index jumps there."""
        limits = self._settings
        counts = np.where(
            found.overflow,
            np.where(found.counts < 0, limits.min_counts, limits.max_counts),
            found.counts,
        ).astype(np.int32)
        for lost, piece in _pieces(found.lost, counts):
            self._jump(lost)
            first, self._index = self._index, self._index + len(piece)
            self._figures['samples'] += len(piece)
            yield from self._stamper.add(first, piece, read_at)

    def _jump(self, lost: int) -> None:
        self._index += lost
        self._figures['samples lost'] += lost

    def _lost_until(self, reads: list[tuple[Decoded, int]]) -> int:
        """Return how many samples the time since the last one has room for, before some reads.

        The read that came with the least delay tells.
        """
        latency = round(NANOSECONDS * (self._settings.delay + self._frame_time))
        index, least = self._index - 1, math.inf
        for found, read_at in reads:
            index += len(found.counts) + int(found.lost.sum())
            try:
                usual = self._clock.stamp(index)
            except ValueError:  # no sample has come before
                return 1
            least = min(least, read_at - latency - usual)
        return max(1, math.floor(least * self._settings.sample_rate / NANOSECONDS))

    def _break_off(self, error: Exception) -> None:
        if self._closed.is_set():
            return
        self._breaks += 1
        text = str(error)
        if isinstance(error, _BROKEN):
            text = f'{self._settings.port}: the connection broke off; is the device plugged in?'
        self._trouble = text
        self._let_go()

    def _open_again(self) -> None:
        """Open the port as soon as that is possible, unless the source is closed."""
        wait = _FIRST_WAIT
        while not self._closed.wait(wait):
            try:
                identity = self._open()
            except SerialError as error:
                self._trouble = str(error)
                wait = min(2 * wait, _LONGEST_WAIT)
                continue
            if identity != self._identity:
                raise SerialError(
                    f'{self._settings.port}: {" ".join(identity)} answers, '
                    f'{" ".join(self._identity)} did at the start; start again with its calibration'
                )
            return

    def _let_go(self) -> None:
        with self._lock:
            port, self._port = self._port, None
        if port is None:
            return
        try:
            self._end(port)
        except _BROKEN:
            pass  # it is gone
        finally:
            port.close()

    def close(self) -> None:
        """Stop the device and close the port; the iterator ends within a tenth of a second.

        A source that was closed is not iterated again.
        """
        self._closed.set()
        if not self._reading:
            self._let_go()

    @property
    def trouble(self) -> str:
        """What is wrong at present, in one line."""
        return self._trouble or self._rate.text

    def figures(self) -> dict[str, float]:
        """Return what was read and lost, and what the clock of the samples says."""
        return {**self._figures, 'breaks': self._breaks, **self._clock.figures()}


def _pieces(
    lost: NDArray[np.int64], counts: NDArray[np.int32]
) -> Iterator[tuple[int, NDArray[np.int32]]]:
    """Cut counts where values are lost; each piece with how many are lost before it."""
    begins = [0, *(at for at in np.flatnonzero(lost).tolist() if at)]
    for begin, end in zip(begins, [*begins[1:], len(counts)], strict=True):
        yield int(lost[begin]), counts[begin:end]
