"""Digital load cells of the AED family on RS-485 or RS-232: HBM/HBK AED, FIT and AD."""

from dataclasses import dataclass
from typing import ClassVar

import serial

from checkweigher_driver.serial.aed_dialogue import AedDialogue
from checkweigher_driver.serial.decoding import Decoder
from checkweigher_driver.serial.frame_decoder import TRAILERS, FrameDecoder
from checkweigher_driver.serial.port import SerialError
from checkweigher_driver.serial.source import SerialParameters, SerialSource
from checkweigher_dsp.parameters import ParameterError, parameter

_AS_IT_IS = -1


@dataclass(frozen=True)
class AedParameters(SerialParameters):
    """The port, the device and what it is set to at the start."""

    node: ClassVar[str] = 'aed'

    address: int = parameter(
        -1, 'on the bus (S command); -1: the only device, none is selected', minimum=-1, maximum=31
    )
    trailer: str = parameter(
        'auto', 'whether CR LF ends each frame; auto finds out', choices=TRAILERS
    )
    checksum: bool = parameter(
        True, 'XOR in each frame (CSM 1); false: the status of the device, disturbances pass'
    )
    termination: bool = parameter(True, 'termination of the bus in the device (STR)')
    filter: int = parameter(-1, 'ASF: the filter; -1 leaves it as it is', minimum=-1, maximum=99)
    filter_mode: int = parameter(
        1, 'FMD: the kind of filter; -1 leaves it as it is', minimum=-1, maximum=99
    )
    output_rate: int = parameter(
        -1, 'ICR: the code of the output rate; -1 leaves it as it is', minimum=-1, maximum=99
    )
    reset: bool = parameter(False, 'restart the device before (RES), which takes 3 s')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.checksum and self.trailer == 'none':
            raise ParameterError(
                'aed.trailer: none without aed.checksum: frames could not be told apart'
            )


class AedSource(SerialSource):
    """Frames of three bytes of the reading and a check, streamed by the device (COF 8, MSV?0)."""

    parameters = AedParameters

    def __init__(self, parameters: AedParameters) -> None:
        self._aed = parameters
        super().__init__(parameters, 4 if parameters.trailer == 'none' else 6)

    def _make_decoder(self) -> Decoder:
        return FrameDecoder(checksum=self._aed.checksum, trailer=self._aed.trailer)

    def _start_up(self, port: serial.Serial) -> tuple[str, str]:
        wanted, device = self._aed, AedDialogue(port)
        device.stop()
        if wanted.address >= 0:
            device.select(wanted.address)
        if wanted.reset:
            device.reset()
            if wanted.address >= 0:
                device.select(wanted.address)
        identity = device.identify()
        device.order(f'STR {int(wanted.termination)}', 'aed.termination')
        rate = device.ask('BDR').split(',')[0].strip()
        if rate != str(wanted.baud_rate):
            raise SerialError(
                f'{port.name}: the device says that it is set to {rate} Bd, aed.baud_rate is '
                f'{wanted.baud_rate}'
            )
        device.order('COF 8', 'docs/hardware.md')
        device.order(f'CSM {int(wanted.checksum)}', 'aed.checksum')
        code = device.ask('ICR')
        if wanted.output_rate != _AS_IT_IS and code.lstrip('0') != str(wanted.output_rate).lstrip(
            '0'
        ):
            device.order(f'ICR {wanted.output_rate}', 'aed.output_rate')
        if wanted.filter != _AS_IT_IS:
            device.order(f'ASF {wanted.filter}', 'aed.filter')
        if wanted.filter_mode != _AS_IT_IS:
            device.order(f'FMD {wanted.filter_mode}', 'aed.filter_mode')
        return identity

    def _begin(self, port: serial.Serial) -> None:
        port.reset_input_buffer()
        AedDialogue(port).send('MSV?0')

    def _end(self, port: serial.Serial) -> None:
        AedDialogue(port).stop()
