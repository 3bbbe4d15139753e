# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Digital load cells of the AED family (HBM/HBK AED, FIT and AD) on RS-485 or RS-232."""

from dataclasses import dataclass
from functools import partial
import time
from typing import ClassVar

import serial

from checkweigher_core.parameters import ParameterError, parameter
from checkweigher_driver.serial.decoder import Decoder
from checkweigher_driver.serial.frame_decoder import TRAILERS, FrameDecoder
from checkweigher_driver.serial.port import SerialError
from checkweigher_driver.serial.source import SerialParameters, SerialSource

_AS_IT_IS = -1
_QUIET = 0.03  # time in s without a byte after which no more bytes are expected
_STOP_PAUSE = 0.01  # time in s that the device needs to stop; the device sends no reply
_ATTEMPTS = 3
_PATIENCE = 0.5  # longest wait for a reply in s
_RESET_TIME = 3.0  # time in s that the device needs to restart; the device sends no reply
_LONGEST_REPLY = 256  # bytes
_setting = partial(parameter, _AS_IT_IS, minimum=_AS_IT_IS, maximum=99)


@dataclass(frozen=True)
class AedParameters(SerialParameters):
    """Parameters of the serial port and of the set-up of the device."""

    node: ClassVar[str] = 'aed'

    address: int = _setting('bus address of the device (S); -1 for the only device', maximum=31)
    trailer: str = parameter(
        'auto', 'end of a frame: CR LF, or none; auto: detected from the data', choices=TRAILERS
    )
    checksum: bool = parameter(
        True, 'whether frames have a checksum (CSM 1); false: transmission errors go unnoticed'
    )
    termination: bool = parameter(True, 'whether the device terminates the bus (STR)')
    filter: int = _setting('number of the filter (ASF); -1: unchanged')
    filter_mode: int = parameter(
        1, 'number of the filter mode (FMD); -1: unchanged', minimum=-1, maximum=99
    )
    output_rate: int = _setting('code of the output rate (ICR); -1: unchanged')
    reset: bool = parameter(False, 'whether the device is restarted first (RES), which takes 3 s')

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.checksum and self.trailer == 'none':
            raise ParameterError(
                "aed.trailer: 'none' needs aed.checksum: true; otherwise no frame could be found"
            )


class AedSource(SerialSource):
    """Load cell that streams binary frames: a 3-byte reading and a check or status byte (COF 8)."""

    parameters = AedParameters

    def __init__(self, parameters: AedParameters) -> None:
        self._aed = parameters
        super().__init__(parameters, 4 if parameters.trailer == 'none' else 6)

    def _make_decoder(self) -> Decoder:
        return FrameDecoder(checksum=self._aed.checksum, trailer=self._aed.trailer)

    def _start_up(self, port: serial.Serial) -> tuple[str, str]:
        wanted, device = self._aed, AedDialogue(port)
        device.stop()
        device.select(wanted.address)
        if wanted.reset:
            device.reset()
            device.select(wanted.address)
        identity = device.identify()
        device.order(f'STR {int(wanted.termination)}', 'aed.termination')
        rate = device.ask('BDR').split(',')[0].strip()
        if rate != str(wanted.baud_rate):
            raise SerialError(
                f'{port.name}: the device is set to {rate} Bd, but aed.baud_rate is '
                f'{wanted.baud_rate}'
            )
        device.order('COF 8', 'docs/hardware.md')
        device.order(f'CSM {int(wanted.checksum)}', 'aed.checksum')
        code = device.ask('ICR').lstrip('0')
        if wanted.output_rate != _AS_IT_IS and code != str(wanted.output_rate).lstrip('0'):
            device.order(f'ICR {wanted.output_rate}', 'aed.output_rate')
        for command, name in (('ASF', 'filter'), ('FMD', 'filter_mode')):
            if (value := getattr(wanted, name)) != _AS_IT_IS:
                device.order(f'{command} {value}', f'aed.{name}')
        return identity

    def _begin(self, port: serial.Serial) -> None:
        port.reset_input_buffer()
        AedDialogue(port).send('MSV?0')

    def _end(self, port: serial.Serial) -> None:
        AedDialogue(port).stop()


class AedDialogue:
    """Commands to a device of the AED family on an open port, and its replies."""

    def __init__(self, port: serial.Serial) -> None:
        self._port = port

    def send(self, command: str) -> None:
        """Send a command without waiting for a reply."""
        self._port.write(f'{command};'.encode())

    def stop(self) -> None:
        """Stop the stream of readings, and discard its remaining bytes."""
        self.send('STP')
        self._port.flush()
        time.sleep(_STOP_PAUSE)
        self._drain()

    def _drain(self) -> None:
        """Discard bytes until none has arrived for 30 ms, but for at most 0.5 s.

        The method has to wait because adapters deliver bytes late.
        """
        begin = last = time.monotonic()
        while (now := time.monotonic()) - last < _QUIET and now - begin < _PATIENCE:
            if self._port.in_waiting:
                self._port.read(self._port.in_waiting)
                last = now
            else:
                time.sleep(_QUIET / 10)

    def select(self, address: int) -> None:
        """Select one device of a bus by its address. With -1, nothing is sent."""
        if address >= 0:
            self.send(f'S{address:02d}')
            self._port.flush()
            self._drain()

    def reset(self) -> None:
        """Restart the device, and wait until it replies.

        Raises `SerialError` if no reply comes within 6 s.
        """
        self.send('RES')
        begin = time.monotonic()
        while time.monotonic() - begin < 2 * _RESET_TIME:
            self._drain()
            self.send('IDN?')
            if self._line():
                self._drain()
                return
        raise SerialError(f'{self._port.name}: the device does not reply after RES')

    def ask(self, query: str) -> str:
        """Return the reply to a query. Raises `SerialError` if there is no valid reply."""
        self.send(f'{query}?')
        reply = self._line()
        if reply == '?':
            raise SerialError(f'{self._port.name}: the device does not know {query}?')
        if not reply:
            raise SerialError(
                f'{self._port.name}: no reply to {query}? within {_PATIENCE:g} s; check the '
                f'supply, the wires, baud_rate ({self._port.baudrate} Bd) and address'
            )
        return reply

    def order(self, command: str, parameter: str) -> None:
        """Send a command, and check that the device confirms it.

        Raises `SerialError` if the device does not confirm the command. The message contains
        `parameter`, the name of a parameter or of a page that explains the command.
        """
        self.send(command)
        reply = self._line()
        if reply != '0':
            said = f'replies {reply!r}' if reply else 'does not reply'
            raise SerialError(f'{self._port.name}: the device {said} to {command}; see {parameter}')

    def identify(self) -> tuple[str, str]:
        """Return model and serial number of the device.

        The stream of the device is stopped, and the device is asked up to three times. Raises
        `SerialError` if the device does not reply, or is not of the AED family.
        """
        for attempt in range(_ATTEMPTS):
            self.stop()
            try:
                reply = self.ask('IDN')
            except SerialError:
                if attempt == _ATTEMPTS - 1:
                    raise
                continue
            fields = [field.strip(' "') for field in reply.split(',')]
            if len(fields) >= 3 and all(fields[:3]) and ''.join(fields[:3]).isprintable():
                while attempt and self._line():
                    attempt -= 1  # discard a late reply to an earlier attempt
                return ' '.join(fields[:2]), fields[2]
        raise SerialError(
            f'{self._port.name}: the reply {reply!r} to IDN? is not that of a load cell of the AED '
            'family; check baud_rate and the connected device'
        )

    def _line(self) -> str:
        """Return a reply without its line end, or an empty string without a reply.

        If the line end does not arrive within 0.5 s or `_LONGEST_REPLY` bytes, the characters that
        have arrived are returned.
        """
        line = b''
        end = time.monotonic() + _PATIENCE
        while not line.endswith(b'\n') and len(line) < _LONGEST_REPLY and time.monotonic() < end:
            line += self._port.read(max(1, self._port.in_waiting))
        return line.decode('ascii', 'replace').strip()
