# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of reject: its permission to run and its stop requests."""

from checkweigher_core.records import NANOSECONDS, Permission, StopRequest
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros.ports import FRESH_TIME
from checkweigher_driver.line_io.rejector.missed_products import LatchEvent, MissedProducts

_PERMISSION_TIME = round(FRESH_TIME * NANOSECONDS)


class RejectWord:
    """The permission to run and the stop requests of reject, for a machine that may miss products.

    A permission is fresh for `FRESH_TIME`. Without a fresh one, reject has ended or hangs, and may
    have lost its stop requests.
    """

    def __init__(self, missed: MissedProducts) -> None:
        self._missed = missed
        self._permission: tuple[int, bool] | None = None  # time of the last one, whether to run
        self._silent = False  # after the last permission has expired, until reject is back
        self._asked = ''  # reason of a stop request, which only reject knows

    def permits(self, now: int) -> bool:
        """Return whether a fresh permission lets the line run."""
        came, run = self._permission or (now, False)
        if now - came > _PERMISSION_TIME:
            self._permission, self._silent, run = None, True, False
            self._missed.take(LatchEvent.FORGET)
        return run

    def take_permission(self, permission: Permission, now: int) -> None:
        """Process a permission that arrived at `now`."""
        self._end_silence()
        self._permission = now, permission.run

    def take_request(self, request: StopRequest | None) -> None:
        """Process a stop request, None if it is taken back."""
        self._end_silence()
        if request is None:
            self._asked = ''
            self._missed.take(LatchEvent.RUN)
        elif request.reason is StopReason.NOT_READY:  # a reject node that was started again
            self._missed.take(LatchEvent.FORGET)
        elif request.reason is not StopReason.DRIVER_TROUBLE:
            self._asked = f'{request.reason}: {request.hint}'
        elif self._missed.text in request.hint:
            self._missed.take(LatchEvent.SHOW)

    def _end_silence(self) -> None:
        """Latch the request from before a silence, because a restarted reject has forgotten it."""
        if self._silent and self._asked:
            self._missed.add(self._asked)
        self._silent = False
