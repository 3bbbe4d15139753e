# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""What a node asks of a call before it serves it: not too often, and with the key if locked."""

from collections.abc import Sequence
from dataclasses import dataclass
import time
from typing import Any, ClassVar

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.ros.access.call_limit import RATE, CallLimit
from checkweigher_dsp.ros.access.key import KEY_FILE, Lock, own_key
from checkweigher_dsp.ros.access.permissions import PERMISSION, asked_text, changes_text
from checkweigher_dsp.ros.services import SERVICES, SETTER

_LOCKED = {each.name for each in SERVICES if each.locked} | {'change_state'}
# These have their permission with them.
_SETTERS = {'set_parameters', SETTER}
_NO_KEY = 'the line is locked: only the page and nodes with its key change it'
_TOO_OFTEN = f'called too often: more than {RATE:g} times a second'


@dataclass(frozen=True)
class LockParameters(Parameters):
    """Whether a node is locked; each node of the line has this parameter."""

    node: ClassVar[str] = '**'

    locked: bool = parameter(
        False,
        f'whether parameters and services that change the line need its key: the file {KEY_FILE}',
    )


def make_lock(*, locked: bool) -> Lock | None:
    """Return the lock of a node, None for a node that is not locked.

    `ParameterError` if there is no key for it.
    """
    if not locked:
        return None
    key = own_key()
    if key is None:
        raise ParameterError(f'locked: needs the environment variable {KEY_FILE}, a file')
    return Lock(key)


def needs_key(name: str) -> bool:
    """Tell whether a locked node serves the service `name` only with its key."""
    return name.rpartition('/')[2] in _LOCKED | _SETTERS


class Gate:
    """The gate of one service, by its name."""

    def __init__(self, name: str) -> None:
        self._needs_key = name.rpartition('/')[2] in _LOCKED
        self._limit = CallLimit()

    def refusal(self, lock: Lock | None, service: str, request: Any) -> str:
        """Return why a call is not served, empty if it is; `service` is the full name."""
        if not self._limit.take(time.monotonic()):
            return _TOO_OFTEN
        if lock is None or not self._needs_key:
            return ''
        return '' if lock.admits(service, asked_text(request), time.time_ns()) else _NO_KEY


def split(parameters: Sequence[Any]) -> tuple[list[Any], str]:
    """Return the parameters of a request and the permission among them, empty without one."""
    signed = [p.value.string_value for p in parameters if p.name == PERMISSION]
    return [p for p in parameters if p.name != PERMISSION], signed[0] if signed else ''


def refusal_of_changes(lock: Lock | None, setter: str, changes: Sequence[Any], signed: str) -> str:
    """Return why parameters must not be changed, empty if they may.

    Without changes the permission is kept for a call that follows. `setter` is the full name of
    the service by which they are set.
    """
    if lock is None:
        return ''
    if not changes and signed:
        lock.expect(signed, time.time_ns())
        return ''
    opened = lock.opens(signed, setter, changes_text(changes), time.time_ns())
    return '' if opened else _NO_KEY


def turned_away(request: Any, response: Any, why: str) -> Any:
    """Return the answer to a call that is not served."""
    refused = SetParametersResult(successful=False, reason=why)
    if isinstance(response, SetParametersAtomically.Response):
        response.result = refused
    elif isinstance(response, SetParameters.Response):
        response.results = [refused] * len(request.parameters)
    elif hasattr(response, 'message'):
        response.message = why
    return response
