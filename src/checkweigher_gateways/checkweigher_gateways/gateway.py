# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Process that runs a gateway."""

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
from checkweigher_core.parent_process import end_with_parent
from checkweigher_core.ros.graph.policy import enclave_arguments
from checkweigher_core.ros.spinner import Spinner
from checkweigher_gateways import KINDS
from checkweigher_gateways.listening import Intake, Taken
from checkweigher_gateways.settings import GatewaySettings, read_gateways

_POLL_PERIOD = 0.05  # pause in s after each call of `Gateway.turn`


class GatewayError(ValueError):
    """Raised if a gateway cannot start. The message is one line for the user."""


class Gateway:
    """Base class of the gateways.

    The module of each gateway contains a function `make`, which returns a gateway with the given
    settings.

    Attributes
    ----------
    kept : bool
        Whether the gateway also receives verdicts that were published before its subscription.
    intake : Intake
        Subscriptions of the gateway, which exist after `start`.
    """

    kept: ClassVar[bool] = False
    intake: Intake

    async def start(self) -> str:
        """Start the service, and return its address for the user.

        Raises `GatewayError`, or another ValueError with a message for the user, if the service
        cannot start.
        """
        raise NotImplementedError

    async def take(self, taken: Taken) -> None:
        """Update the gateway with a record of a lane, or with diagnostics."""
        raise NotImplementedError

    async def turn(self) -> None:
        """Perform the periodic work, after all waiting records were passed to `take`."""

    def findings(self, now: float) -> Iterable[Finding]:
        """Return the findings on the connection at the time `now` of the monotonic clock in s."""
        return ()

    async def close(self) -> None:
        """Stop the service."""


def serve(kind: str, settings: GatewaySettings, namespace: str | None = None) -> None:
    """Run a gateway until KeyboardInterrupt is raised, or until the ROS context is shut down.

    Parameters
    ----------
    kind : str
        Kind of the gateway, one of `KINDS`.
    settings : GatewaySettings
        Settings of all gateways. A gateway whose section is missing has the default settings.
    namespace : str, optional
        Namespace of the only lane, or None for all lanes.

    Raises
    ------
    ValueError
        If the gateway cannot start, for example as `GatewayError` or `CertificateError`. The
        message is for the user.
    """
    module: Any = import_module(f'checkweigher_gateways.{kind}')
    gateway: Gateway = module.make(settings)
    own = ['--ros-args', *enclave_arguments('', f'gateway_{kind}')]
    rclpy.init(args=own, signal_handler_options=SignalHandlerOptions.NO)
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
    """Run the gateway that the command line names, with the options of the command line.

    If the gateway cannot start, the reason is printed, and the process exits with status 2.
    """
    parser = argparse.ArgumentParser('gateway')
    parser.add_argument('kind', choices=KINDS)
    parser.add_argument('--settings', type=Path)
    parser.add_argument('--namespace')
    given = parser.parse_args(remove_ros_args(sys.argv)[1:])
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    end_with_parent()
    try:
        with suppress(KeyboardInterrupt):
            serve(given.kind, read_gateways(given.settings), given.namespace)
    except ValueError as error:
        print(f'checkweigher: {error}', file=sys.stderr)
        raise SystemExit(2) from None


if __name__ == '__main__':
    main()
