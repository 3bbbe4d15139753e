# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Load-cell amplifiers that send a line of text for each value without a request."""

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
    """Parameters of the port and the format of a line."""

    node: ClassVar[str] = 'ascii'

    pattern: str = parameter(
        r'S([+-]\d{7})', 'regular expression of a whole line; its first group is the value'
    )
    decimals: int = parameter(
        0, 'digits after the point: one of the last of them is a count', minimum=0, maximum=9
    )
    line_bytes: int = parameter(
        11,
        'length of a line with its end, to see whether baud_rate is enough',
        minimum=2,
        maximum=256,
    )
    start_command: str = parameter('', 'command to begin; empty if the device sends unasked')
    stop_command: str = parameter('', 'command at the end')

    def __post_init__(self) -> None:
        super().__post_init__()
        try:
            LineDecoder(self.pattern, self.decimals)
        except ValueError as error:
            raise ParameterError(f'ascii.{error}') from None


class AsciiSource(SerialSource):
    """Lines such as ``S+0125785``."""

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
    r"""Return the bytes of a command in which \r and \n stand for CR and LF."""
    return text.replace(r'\r', '\r').replace(r'\n', '\n').encode()


class LineDecoder(Decoder):
    """Readings from a stream of lines; its division into reads does not change them.

    `pattern` is the regular expression of a whole line without its end; its first group is the
    number. There is no checksum, so the pattern should fix the number of digits. Otherwise a line
    that lost a digit is read as another number. One count is 1 in the last of the `decimals` digits
    after the point. Raises ValueError if the pattern is not a regular expression or has no group.

    Lines end with CR, LF or both. A line that is not a reading counts as one lost value, or as
    several if it is longer than the line before. Bytes before the first end of a line are skipped.
    """

    waiting = 0  # a line is returned as soon as it is complete

    def __init__(self, pattern: str, decimals: int = 0) -> None:
        try:
            self._pattern = re.compile(pattern.encode())
        except re.error as error:
            raise ValueError(f'pattern: {pattern!r}: {error}') from None
        if self._pattern.groups < 1:
            raise ValueError(f'pattern: {pattern!r} has no group for the number')
        self._scale = 10.0**decimals
        self._data = b''
        self._begun = False  # whether an end of a line has come
        self._lost: int | None = None  # since the last reading, None before the first

    @property
    def missing(self) -> int:
        """Number of bytes until the next line is complete, if it is as long as the line before."""
        return max(self.frame_bytes - len(self._data), 1)

    def feed(self, data: bytes) -> Decoded:
        """Process the next bytes of the stream and return the readings that they complete."""
        self._data += data
        *lines, rest = _ENDS.split(self._data)
        if lines and not self._begun:
            self._begun = True
            self.skipped_bytes += len(lines.pop(0))
        # Only the beginning of a line that is too long is kept. The line is refused at its end.
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
        found = self._pattern.fullmatch(line)
        if found is None:
            return None
        try:
            count = round(float(found.group(1)) * self._scale)
        except (ValueError, OverflowError, TypeError):
            return None
        return count if _INT32.min <= count <= _INT32.max else None
