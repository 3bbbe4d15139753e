"""Load-cell amplifiers that send a line of text for each value, unasked."""

from dataclasses import dataclass
from typing import ClassVar

import serial

from checkweigher_driver.serial.decoding import Decoder
from checkweigher_driver.serial.line_decoder import LineDecoder
from checkweigher_driver.serial.source import SerialParameters, SerialSource
from checkweigher_dsp.parameters import ParameterError, parameter


@dataclass(frozen=True)
class AsciiParameters(SerialParameters):
    """The port and what a line looks like."""

    node: ClassVar[str] = 'ascii'

    pattern: str = parameter(
        r'S([+-]\d{7})',
        'regular expression of a whole line; its first group is the value',
    )
    decimals: int = parameter(
        0, 'digits after the point: one of the last of them is a count', minimum=0, maximum=9
    )
    line_bytes: int = parameter(
        11, 'length of a line with its end, to see whether baud_rate is enough', minimum=2,
        maximum=256,
    )  # fmt: skip
    start_command: str = parameter('', 'sent to begin; empty if the device sends unasked')
    stop_command: str = parameter('', 'sent at the end')

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
