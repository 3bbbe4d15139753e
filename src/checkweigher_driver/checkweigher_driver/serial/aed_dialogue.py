"""Commands and replies of digital load cells of the AED family."""

import time

import serial

from checkweigher_driver.serial.port import SerialError

_QUIET = 0.03  # s without a byte after which nothing more is on its way
_STOP_PAUSE = 0.01  # s that the device takes to stop; it does not reply
_ATTEMPTS = 3
_RESET_TIME = 3.0  # s that the device takes to come back; it does not reply
_LONGEST_REPLY = 256  # bytes


class AedDialogue:
    """Ask and order, one command at a time.

    Parameters
    ----------
    port : serial.Serial
        Open.
    patience : float
        s, for a reply.
    """

    def __init__(self, port: serial.Serial, patience: float = 0.5) -> None:
        self._port = port
        self._patience = patience

    def send(self, command: str) -> None:
        """Send a command that has no reply."""
        self._port.write(f'{command};'.encode())

    def stop(self) -> None:
        """Stop a stream, whether there is one or not, and drop what has come of it."""
        self.send('STP')
        self._port.flush()
        time.sleep(_STOP_PAUSE)
        self._drain()

    def _drain(self) -> None:
        """Read until nothing comes: adapters deliver late what was sent long before."""
        begin = last = time.monotonic()
        while (now := time.monotonic()) - last < _QUIET and now - begin < self._patience:
            if self._port.in_waiting:
                self._port.read(self._port.in_waiting)
                last = now
            else:
                time.sleep(_QUIET / 10)

    def select(self, address: int) -> None:
        """Address one device of a bus; the others are silent from then on."""
        self.send(f'S{address:02d}')
        self._port.flush()
        self._drain()

    def reset(self) -> None:
        """Restart the device and wait until it replies again.

        Raises
        ------
        SerialError
            If it does not come back.
        """
        self.send('RES')
        begin = time.monotonic()
        while time.monotonic() - begin < 2 * _RESET_TIME:
            self._drain()
            self.send('IDN?')
            if self._line():
                self._drain()
                return
        raise SerialError(f'{self._port.name}: the device did not come back after RES')

    def ask(self, query: str) -> str:
        """Send a query and return the reply.

        Raises
        ------
        SerialError
            If there is none, or the device refuses.
        """
        self.send(f'{query}?')
        reply = self._line()
        if reply == '?':
            raise SerialError(f'{self._port.name}: the device does not know {query}?')
        if not reply:
            raise SerialError(
                f'{self._port.name}: no reply to {query}? within {self._patience:g} s; check the '
                f'supply, the wires, baud_rate ({self._port.baudrate} Bd) and address'
            )
        return reply

    def order(self, command: str, parameter: str) -> None:
        """Send a command and see that it is done.

        Parameters
        ----------
        command : str
            With its argument.
        parameter : str
            The driver's parameter that it comes from, for the message.

        Raises
        ------
        SerialError
            If the device refuses or does not reply.
        """
        self.send(command)
        reply = self._line()
        if reply != '0':
            said = f'replies {reply!r}' if reply else 'does not reply'
            raise SerialError(f'{self._port.name}: the device {said} to {command}; see {parameter}')

    def identify(self) -> tuple[str, str]:
        """Return model and serial number.

        Raises
        ------
        SerialError
            If nothing replies, or something that is no such device.
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
            if len(fields) >= 3 and all(field.isprintable() and field for field in fields[:3]):
                self._drop_late(attempt)
                return ' '.join(fields[:2]), fields[2]
        raise SerialError(
            f'{self._port.name}: replied {reply!r} to IDN?, which is no load cell of the AED '
            'family; check baud_rate and what is connected'
        )

    def _drop_late(self, count: int) -> None:
        """Drop the replies to queries that were given up, or they pass for those to the next."""
        while count and self._line():
            count -= 1

    def _line(self) -> str:
        """Return a reply without its end, empty if none comes in time."""
        line = b''
        end = time.monotonic() + self._patience
        while time.monotonic() < end and len(line) < _LONGEST_REPLY:
            line += self._port.read(max(1, self._port.in_waiting))
            if line.endswith(b'\n'):
                return line.decode('ascii', 'replace').strip()
        return line.decode('ascii', 'replace').strip()
