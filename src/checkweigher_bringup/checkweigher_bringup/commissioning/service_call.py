# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of services from another thread than that of the node."""

import time
from typing import Any

from rcl_interfaces.srv import SetParametersAtomically

from checkweigher_bringup.errors import UserError
from checkweigher_dsp.ros.access.key import own_key
from checkweigher_dsp.ros.access.permissions import announcement
from checkweigher_dsp.ros.services import SETTER

_POLL_PERIOD = 0.01  # s


def call(node: Any, kind: Any, name: str, patience: float, request: Any = None) -> Any:
    """Call a service, with an empty request by default, and return the answer.

    `patience` is how long the service is looked for, and then its answer, s. A `UserError` says
    that one of them did not come.
    """
    client = node.create_client(kind, name)
    try:
        if not client.wait_for_service(patience):
            raise UserError(f'no answer of the service {client.srv_name}; is the line running?')
        asked = kind.Request() if request is None else request
        return answer_of(client.call_async(asked), client.srv_name, patience)
    finally:
        node.destroy_client(client)


def ask(node: Any, kind: Any, name: str, server: str, patience: float, request: Any = None) -> str:
    """Call a service of the node `server` that changes the line, and return its message.

    A locked line serves it by the key. A `UserError` says that it was refused, or as of `call`.
    """
    request = kind.Request() if request is None else request
    if (key := own_key()) is not None:
        signed = announcement(key, node.resolve_service_name(name), request)
        call(node, SetParametersAtomically, f'{server}/{SETTER}', patience, signed)
    answer = call(node, kind, name, patience, request)
    if not answer.success:
        raise UserError(answer.message)
    return str(answer.message)


def answer_of(future: Any, name: str, patience: float) -> Any:
    """Return the answer of `name` that a future will have; `UserError` if it does not come."""
    end = time.monotonic() + patience
    while not future.done():
        if time.monotonic() > end:
            raise UserError(f'no answer of {name} within {patience:g} s')
        time.sleep(_POLL_PERIOD)
    return future.result()
