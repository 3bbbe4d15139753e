# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Connection to a Modbus TCP device, with error messages for a technician."""

from collections.abc import Callable, Collection
import logging
from typing import Any

from pymodbus.client import ModbusTcpClient
from pymodbus.exceptions import ModbusException

# Silence pymodbus, because it would log every refused connection in addition to the raised error.
logging.getLogger('pymodbus.logging').setLevel(logging.CRITICAL)


class ModbusLinkError(ValueError):
    """Raised if a connection or a request fails. The message is one line with the reason."""


class ModbusLink:
    """Connection to one device. Only one thread uses it.

    `device_id` is the Modbus unit identifier. `timeout` is the longest wait in s for a connection
    and for each answer. A request without a valid answer raises ModbusLinkError, and closes the
    connection, so that a late answer is not mistaken for the answer to the next request.
    """

    def __init__(self, host: str, port: int, device_id: int, timeout: float) -> None:
        self._name = f'modbus {host}:{port}'
        self._device_id = device_id
        self._timeout = timeout
        self._client = ModbusTcpClient(host, port=port, timeout=timeout, retries=0)

    def connect(self) -> None:
        """Connect to the device, unless it is connected already.

        Raises ModbusLinkError if there is no connection within `timeout`.
        """
        if not self._client.connect():
            raise ModbusLinkError(
                f'{self._name}: no connection within {self._timeout:g} s; check cable, address and '
                'power of the device'
            )

    def read_inputs(self, kind: str, addresses: Collection[int]) -> dict[int, bool]:
        """Return the states of discrete inputs or coils by address, read with one request.

        `kind` is ``discrete`` or ``coil``.
        """
        client, address = self._client, min(addresses)
        count = max(addresses) - address + 1
        read = client.read_discrete_inputs if kind == 'discrete' else client.read_coils
        what = f'{"discrete input" if kind == "discrete" else "coil"} {address}'
        bits = self._ask(read, address, f'{what} cannot be read', count=count).bits
        if len(bits) < count:
            self.close()
            raise ModbusLinkError(
                f'{self._name}: {what}: the answer has {len(bits)} bits, must have {count}'
            )
        return {each: bits[each - address] for each in addresses}

    def write_coil(self, address: int, value: bool) -> None:
        """Write a coil."""
        self._ask(
            self._client.write_coil, address, f'coil {address} cannot be written', value=value
        )

    def write_register(self, address: int, value: int) -> None:
        """Write a holding register."""
        what = f'register {address} cannot be written'
        self._ask(self._client.write_register, address, what, value=value)

    def _ask(
        self, request: Callable[..., Any], address: int, what: str, **arguments: int | bool
    ) -> Any:
        try:
            answer = request(address, device_id=self._device_id, **arguments)
        except (ModbusException, OSError) as error:
            self.close()
            raise ModbusLinkError(
                # The message of pymodbus is left out, because it contains memory addresses.
                f'{self._name}: {what}: no answer within {self._timeout:g} s '
                f'({type(error).__name__})'
            ) from None
        if answer.isError():
            self.close()
            raise ModbusLinkError(
                f'{self._name}: {what}: refused by the device, exception code '
                f'{getattr(answer, "exception_code", "unknown")}; check address and device_id'
            )
        return answer

    def close(self) -> None:
        """Close the connection."""
        self._client.close()
