# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Declaration of parameter sets as ROS parameters of a node."""

from collections.abc import Mapping
from dataclasses import Field
import math
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

from checkweigher_core.parameters import ParameterError, Parameters, describe

_LARGEST_INTEGER = 2**63 - 1

P = TypeVar('P', bound=Parameters)


def ros_parameters(values: Mapping[str, object]) -> list[Parameter]:
    """Return the ROS parameters with the names and values of a mapping."""
    return [
        Parameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
    ]


def descriptor(entry: 'Field[Any]', *, read_only: bool) -> ParameterDescriptor:
    """Return the ROS descriptor of a field made by `checkweigher_core.parameters.parameter`."""
    allowed = describe(entry)
    result = ParameterDescriptor(
        description=allowed.text + (f' [{allowed.unit}]' if allowed.unit else ''),
        additional_constraints='one of ' + ', '.join(allowed.choices) if allowed.choices else '',
        read_only=read_only,
        # Let the type be dynamic if the default is an empty list. Otherwise rclpy would treat
        # the default as a list of bytes, and refuse a list of numbers.
        dynamic_typing=entry.default == (),
    )
    bounded = math.isfinite(allowed.minimum) or math.isfinite(allowed.maximum)
    if isinstance(entry.default, float) and bounded:
        result.floating_point_range = [
            FloatingPointRange(from_value=float(allowed.minimum), to_value=float(allowed.maximum))
        ]
    elif isinstance(entry.default, int) and not isinstance(entry.default, bool) and bounded:
        result.integer_range = [
            IntegerRange(
                from_value=int(max(allowed.minimum, -_LARGEST_INTEGER)),
                to_value=int(min(allowed.maximum, _LARGEST_INTEGER)),
            )
        ]
    return result


def declare(node: Node, parameters: type[P], prefix: str = '', *, read_only: bool) -> P:
    """Declare a parameter set to ROS, and return it with the values given to the node.

    The ROS names begin with `prefix`, followed by the names in the set. Raises `ParameterError` if
    a value is invalid.
    """
    values = {}
    for own_name, entry in parameters.entries().items():
        name = prefix + own_name
        try:
            if isinstance(entry.default, tuple):
                _declare_list(node, name, entry, list(entry.default), read_only=read_only)
            else:
                described = descriptor(entry, read_only=read_only)
                node.declare_parameter(name, entry.default, described)
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f'{node.get_name()}.{name}: {error}') from None
        values[own_name] = node.get_parameter(name).value
    return parameters.from_mapping(values)


def _declare_list(
    node: Node, name: str, entry: 'Field[Any]', default: list[float], *, read_only: bool
) -> None:
    """Declare a parameter that is a list of numbers, even if the list is empty.

    An empty list is set explicitly, because rcl reads an empty list in a parameter file as a
    parameter without a value.
    """
    writable, final = (descriptor(entry, read_only=each) for each in (False, read_only))
    value = node.declare_parameter(name, default, writable).value
    if value is None or value == []:
        node.set_parameters([Parameter(name, Parameter.Type.DOUBLE_ARRAY, [])])
    final.type = Parameter.Type.DOUBLE_ARRAY.value
    node.set_descriptor(name, final)


def as_declared(declared: Parameter, change: Parameter) -> Parameter:
    """Return a change whose value has the type of the declared parameter, if it can be converted.

    `ros2 param load` and `ros2 param set` guess the type from the text: they read inf and 1e-05 as
    strings, 1 as an integer, and an empty list as a list of bool. The value is therefore converted
    if the declared parameter is a float or a list of floats. If the value is a bool or cannot be
    converted, or the declared parameter has another type, the change is returned unchanged.
    """
    kind, value = declared.type_, change.value
    if change.type_ in (kind, Parameter.Type.BOOL):
        return change
    try:
        if kind == Parameter.Type.DOUBLE:
            return Parameter(change.name, kind, float(value))
        if kind == Parameter.Type.DOUBLE_ARRAY:
            words = value.strip('[]').split(',') if isinstance(value, str) else value
            return Parameter(change.name, kind, [float(word) for word in words])
    except (TypeError, ValueError):
        return change
    return change
