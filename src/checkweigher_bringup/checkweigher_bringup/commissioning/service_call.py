# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Calls of services that answer with a message, from threads without an executor."""

from collections.abc import Iterator
from contextlib import contextmanager
import json
import threading
from typing import Any

from checkweigher_msgs.srv import RecordChange
import rclpy
from rclpy.node import Node

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.spinning import spinning
from checkweigher_core.ros import ports
from checkweigher_core.ros.services import VERIFIER, VERIFY

_PATIENCE = 5.0  # maximum time in s to wait for the service that writes to the audit log


def call(node: Any, kind: Any, name: str, patience: float, request: Any = None) -> str:
    """Call a service with a request, by default an empty one, and return the message of its answer.

    `patience` is the maximum time in s to wait for the service, and then for the answer. Raises
    `UserError` if there is no service or no answer in time, or if the service refuses the call.
    """
    client = node.create_client(kind, name)
    try:
        if not client.wait_for_service(patience):
            raise UserError(f'there is no service {client.srv_name}; is the line running?')
        future = client.call_async(kind.Request() if request is None else request)
        answer = answer_of(future, client.srv_name, patience)
    finally:
        node.destroy_client(client)
    if not answer.success:
        raise UserError(answer.message)
    return str(answer.message)


@contextmanager
def node_that_verifies(namespace: str) -> Iterator[Node]:
    """Yield a node in a lane, which runs until the context ends.

    With ROS security, the node has the right to write to the audit log.
    """
    with spinning(namespace, VERIFIER) as spinner:
        node = rclpy.create_node(VERIFY)
        spinner.add(node)
        yield node


def write_to_log(node: Node, kind: str, subject: str, value: object, who: str) -> None:
    """Write an entry to the audit log of the running line. Raises `UserError` as `call` does."""
    text = json.dumps(value)
    request = RecordChange.Request(kind=kind, subject=subject, new_value=text, who=who)
    call(node, RecordChange, ports.RECORD_CHANGE, _PATIENCE, request)


def answer_of(future: Any, name: str, patience: float) -> Any:
    """Return the result of a future, or raise `UserError` if it has none after `patience` s."""
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    if not done.wait(patience):
        raise UserError(f'no answer from {name} within {patience:g} s')
    return future.result()
