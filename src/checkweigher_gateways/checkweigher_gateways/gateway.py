# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The process of a gateway."""

import argparse
import asyncio
from collections.abc import Iterable
from contextlib import ExitStack, suppress
from importlib import import_module
from pathlib import Path
import signal
import sys
from typing import Any, ClassVar

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from checkweigher_core.health.findings import Finding
from checkweigher_core.ros.spinner import Spinner
from checkweigher_gateways import KINDS
from checkweigher_gateways.listening import Intake, Taken
from checkweigher_gateways.settings import GatewaySettings, read_gateways

_POLL_PERIOD = 0.05  # s


class GatewayError(ValueError):
    """Error of a gateway that cannot start; one line for the user."""


class Gateway:
    """Base of the gateways, which a module of this package implements as `Gateway`.

    A gateway is made from the settings of its section.

    Attributes
    ----------
    kept : bool
        Whether it takes the messages that the publishers keep.
    intake : Intake
        Subscriptions of the gateway.
    """

    kept: ClassVar[bool] = False
    intake: Intake

    async def start(self) -> str:
        """Begin to serve; return the address for the user."""
        raise NotImplementedError

    async def take(self, taken: Taken) -> None:
        """Process a record."""
        raise NotImplementedError

    async def turn(self) -> None:
        """Do the periodic work, after the records."""

    def findings(self, now: float) -> Iterable[Finding]:
        """Return what is wrong with the connection, at `now` in s of the monotonic clock."""
        return ()

    async def close(self) -> None:
        """End."""


def serve(kind: str, settings: GatewaySettings, namespace: str | None = None) -> None:
    """Run a gateway until a KeyboardInterrupt.

    Parameters
    ----------
    kind : str
        One of `KINDS`.
    settings : GatewaySettings
        A missing section has its defaults.
    namespace : str, optional
        The only lane; None for all lanes.

    Raises
    ------
    GatewayError, SettingsError
        If it cannot start.
    """
    module: Any = import_module(f'checkweigher_gateways.{kind}')
    gateway: Gateway = module.make(settings)
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    with ExitStack() as stack:
        stack.callback(rclpy.try_shutdown)
        spinner = Spinner()
        stack.callback(spinner.stop)
        asyncio.run(_run(kind, gateway, spinner, namespace))


async def _run(kind: str, gateway: Gateway, spinner: Spinner, namespace: str | None) -> None:
    address = await gateway.start()
    try:
        name, findings = f'gateway_{kind}', gateway.findings
        gateway.intake = Intake(name, spinner, findings, namespace, kept=gateway.kept)
        print(f'gateway {kind}: {address}', file=sys.stderr, flush=True)
        while spinner.alive:
            for taken in gateway.intake.drain():
                await gateway.take(taken)
            await gateway.turn()
            await asyncio.sleep(_POLL_PERIOD)
    finally:
        await gateway.close()


def main() -> None:
    """Run a gateway as the launch file starts it."""
    parser = argparse.ArgumentParser('gateway')
    parser.add_argument('kind', choices=KINDS)
    parser.add_argument('--settings', type=Path)
    parser.add_argument('--namespace')
    given = parser.parse_args(remove_ros_args(sys.argv)[1:])
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        with suppress(KeyboardInterrupt):
            serve(given.kind, read_gateways(given.settings), given.namespace)
    except ValueError as error:
        print(f'checkweigher: {error}', file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == '__main__':
    main()
