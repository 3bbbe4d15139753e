# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permission to run and stop requests of the node reject."""

from checkweigher_core.records import NANOSECONDS, Permission, StopRequest
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros.ports import FRESH_TIME
from checkweigher_driver.line_io.rejector.missed_products import MissedProducts

_PERMISSION_TIME = round(FRESH_TIME * NANOSECONDS)


class RunPermission:
    """Latest permission to run and latest stop request of the node reject.

    A permission expires after `FRESH_TIME`. If the latest permission has expired, the node reject
    has ended or hangs, and may have lost its stop requests.
    """

    def __init__(self, missed: MissedProducts) -> None:
        self._missed = missed
        # Time in ns at which the last permission arrived, and whether the line may run.
        self._permission: tuple[int, bool] | None = None
        self._silent = False  # whether the last permission has expired
        self._asked = ''  # reason and hint of the last stop request for a cause outside the driver

    def permits(self, now: int) -> bool:
        """Return whether a fresh permission allows the line to run at time `now` in ns."""
        came, run = self._permission or (now, False)
        if now - came > _PERMISSION_TIME:
            self._permission, self._silent, run = None, True, False
            self._missed.shown = False
        return run

    def take_permission(self, permission: Permission, now: int) -> None:
        """Record a permission that arrived at time `now` in ns."""
        self._end_silence()
        self._permission = now, permission.run

    def take_request(self, request: StopRequest | None) -> None:
        """Record a stop request of the node reject, or its reset if `request` is None.

        A reset clears the missed products if the stop request has shown the messages on all of
        them.
        """
        self._end_silence()
        if request is None:
            self._asked = ''
            if self._missed.shown:
                self._missed.clear()
        elif request.reason is StopReason.NOT_READY:  # the node reject was restarted
            self._missed.shown = False
        elif request.reason is not StopReason.DRIVER_TROUBLE:
            self._asked = f'{request.reason}: {request.hint}'
        elif self._missed.text in request.hint:
            self._missed.shown = True

    def _end_silence(self) -> None:
        """Add the last stop request before a silence of the node reject to the missed products.

        Otherwise a restart of the node would cancel the stop request before a person has looked for
        the product.
        """
        if self._silent and self._asked:
            self._missed.add(self._asked)
        self._silent = False
