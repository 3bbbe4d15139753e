# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Load-cell amplifiers that send a line of text for each reading."""

from dataclasses import dataclass
import math
import re
from typing import ClassVar

import numpy as np
import serial

from checkweigher_core.parameters import ParameterError, parameter
from checkweigher_driver.serial.decoder import Decoded, Decoder
from checkweigher_driver.serial.source import SerialParameters, SerialSource

_LONGEST_LINE = 256  # bytes
_ENDS = re.compile(rb'[\r\n]+')
_INT32 = np.iinfo(np.int32)


@dataclass(frozen=True)
class AsciiParameters(SerialParameters):
    """Parameters of the serial port and of the format of a line."""

    node: ClassVar[str] = 'ascii'

    pattern: str = parameter(
        r'S([+-]\d{7})', 'regular expression of a whole line; its first group is the value'
    )
    decimals: int = parameter(
        0, 'number of decimals; one unit of the last decimal is one count', minimum=0, maximum=9
    )
    line_bytes: int = parameter(
        11,
        'length of a line with its line end in bytes, for the check of baud_rate',
        minimum=2,
        maximum=256,
    )
    start_command: str = parameter('', 'command that starts the stream; empty if none is needed')
    stop_command: str = parameter('', 'command that stops the stream; empty if none is needed')

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            LineDecoder(self.pattern, self.decimals)
        except ValueError as error:
            raise ParameterError(f'ascii.{error}') from None


class AsciiSource(SerialSource):
    """Amplifier that sends lines such as ``S+0125785``."""

    parameters = AsciiParameters

    def __init__(self, parameters: AsciiParameters) -> None:
        self._ascii = parameters
        super().__init__(parameters, parameters.line_bytes)

    def _make_decoder(self) -> Decoder:
        return LineDecoder(self._ascii.pattern, self._ascii.decimals)

    def _begin(self, port: serial.Serial) -> None:
        port.reset_input_buffer()
        port.write(_command(self._ascii.start_command))

    def _end(self, port: serial.Serial) -> None:
        port.write(_command(self._ascii.stop_command))


def _command(text: str) -> bytes:
    r"""Return the bytes of a command, in which \r and \n are replaced by CR and LF."""
    return text.replace(r'\r', '\r').replace(r'\n', '\n').encode()


class LineDecoder(Decoder):
    """Decoder of a stream of lines.

    `pattern` is a regular expression that matches a whole line without its line end. The first
    group of the pattern matches the number. The pattern should fix the number of digits, because
    without a checksum a line that has lost a digit would be read as another number. One count is
    one unit of the last decimal, and `decimals` is the number of decimals. Raises ValueError if the
    pattern is invalid.

    Lines end with CR, LF or both. A line is invalid if it does not match the pattern, or if its
    count is not a 32-bit integer. An invalid line counts as one lost reading, or as several if it
    is more than two bytes longer than the last valid line. Lost readings are counted only after the
    first valid reading. Bytes before the first line end are skipped.
    """

    waiting = 0  # `feed` returns the reading of every complete line immediately

    def __init__(self, pattern: str, decimals: int = 0) -> None:
        try:
            self._pattern = re.compile(pattern.encode())
        except re.error as error:
            raise ValueError(f'pattern: {pattern!r}: {error}') from None
        if self._pattern.groups < 1:
            raise ValueError(f'pattern: {pattern!r} has no group for the number')
        self._scale = 10.0**decimals
        self._data = b''
        # Whether a line end was found.
        self._begun = False
        # Number of readings lost since the last valid reading, None before the first reading.
        self._lost: int | None = None

    @property
    def missing(self) -> int:
        """Estimated number of bytes until the next line is complete, at least 1.

        The next line is assumed to be as long as the last valid line.
        """
        return max(self.frame_bytes - len(self._data), 1)

    def feed(self, data: bytes) -> Decoded:
        """Decode the next bytes of the stream; return the readings that are complete now."""
        self._data += data
        *lines, rest = _ENDS.split(self._data)
        if lines and not self._begun:
            self._begun = True
            self.skipped_bytes += len(lines.pop(0))
        # Keep only the beginning of a line that is too long; the line is refused at its end.
        self._data = rest[: _LONGEST_LINE + 1]
        self.skipped_bytes += len(rest) - len(self._data)
        counts, lost = [], []
        for line in filter(None, lines):
            count = self._count(line)
            if count is None:
                self.skipped_bytes += len(line)
                self._refuse(line[: _LONGEST_LINE + 1])
                continue
            counts.append(count)
            lost.append(self._lost or 0)
            self._lost = 0
            self.frame_bytes = len(line) + 2
        return Decoded(
            np.array(counts, np.int32), np.zeros(len(counts), bool), np.array(lost, np.int64)
        )

    def _refuse(self, line: bytes) -> None:
        self.bad_frames += 1
        if self._lost is not None:
            self._lost += max(1, math.ceil(len(line) / (self.frame_bytes or len(line))))

    def _count(self, line: bytes) -> int | None:
        found = self._pattern.fullmatch(line) if len(line) <= _LONGEST_LINE else None
        if found is None:
            return None
        try:
            count = round(float(found.group(1)) * self._scale)
        except (ValueError, OverflowError, TypeError):
            return None
        return count if _INT32.min <= count <= _INT32.max else None
