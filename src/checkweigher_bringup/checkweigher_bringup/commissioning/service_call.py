# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of services from another thread than that of the node."""

import time
from typing import Any

from checkweigher_bringup.errors import UserError

_POLL_PERIOD = 0.01  # s


def ask(node: Any, kind: Any, name: str, patience: float, request: Any = None) -> str:
    """Call a service that changes the line, with an empty request by default; return its message.

    `patience` is how long the service is looked for, and then its answer, s. A `UserError` says
    that one of them did not come, or that the call was refused.
    """
    client = node.create_client(kind, name)
    try:
        if not client.wait_for_service(patience):
            raise UserError(f'no answer of the service {client.srv_name}; is the line running?')
        future = client.call_async(kind.Request() if request is None else request)
        answer = answer_of(future, client.srv_name, patience)
    finally:
        node.destroy_client(client)
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
