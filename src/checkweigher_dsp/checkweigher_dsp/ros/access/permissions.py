# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Permissions of a locked line on the way to a node: as one more parameter of its services.

A change of parameters carries its own permission. What has no room for one, such as a Trigger, is
permitted by a call of ``set_parameters_atomically`` of the same node before it.
"""

from collections.abc import Sequence
import time
from typing import Any

from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.serialization import deserialize_message, serialize_message

from checkweigher_dsp.ros.access.key import Key

PERMISSION = 'permission'  # name of the parameter, which no node declares


def asked_text(request: Any) -> str:
    """Return what a request asks, as both ends of the network see it."""
    kind = type(request)
    if kind is SetParametersAtomically.Request:
        return changes_text(request.parameters)
    return repr(deserialize_message(serialize_message(request), kind))


def changes_text(parameters: Sequence[Any]) -> str:
    """Return what parameters, messages of ROS, are to become."""
    values = {each.name: parameter_value_to_python(each.value) for each in parameters}
    values.pop(PERMISSION, None)
    lists = {n: list(v) if hasattr(v, 'tolist') else v for n, v in values.items()}
    return repr(sorted(lists.items()))


def signed_parameter(key: Key, setter: str, changes: Sequence[Parameter]) -> Parameter:
    """Return the parameter that permits changes by the service `setter`, a full name."""
    asked = changes_text([each.to_parameter_msg() for each in changes])
    return Parameter(PERMISSION, value=key.sign(setter, asked, time.time_ns()))


def announcement(key: Key, service: str, request: Any) -> Any:
    """Return the request to set parameters that permits a call of another service of the node.

    A request to set parameters is returned with its permission.
    """
    signed = Parameter(PERMISSION, value=key.sign(service, asked_text(request), time.time_ns()))
    changes = request.parameters if isinstance(request, SetParametersAtomically.Request) else ()
    return SetParametersAtomically.Request(parameters=[*changes, signed.to_parameter_msg()])
