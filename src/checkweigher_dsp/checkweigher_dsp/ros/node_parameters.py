"""Parameter sets of the stages as parameters of a node."""

from dataclasses import Field
import math
from typing import Any, TypeVar

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node

from checkweigher_dsp.parameters import ParameterError, Parameters, describe

_LARGEST_INTEGER = 2**63 - 1

P = TypeVar('P', bound=Parameters)


def descriptor(entry: 'Field[Any]', *, read_only: bool) -> ParameterDescriptor:
    """Return the ROS descriptor of a field made by `checkweigher_dsp.parameters.parameter`."""
    allowed = describe(entry)
    text = allowed.text + (f' [{allowed.unit}]' if allowed.unit else '')
    result = ParameterDescriptor(
        description=text,
        additional_constraints='one of ' + ', '.join(allowed.choices) if allowed.choices else '',
        read_only=read_only,
    )
    bounded = math.isfinite(allowed.minimum) or math.isfinite(allowed.maximum)
    if isinstance(entry.default, float) and bounded:
        result.floating_point_range = [
            FloatingPointRange(
                from_value=float(allowed.minimum), to_value=float(allowed.maximum), step=0.0
            )
        ]
    elif isinstance(entry.default, int) and not isinstance(entry.default, bool) and bounded:
        result.integer_range = [
            IntegerRange(
                from_value=int(max(allowed.minimum, -_LARGEST_INTEGER)),
                to_value=int(min(allowed.maximum, _LARGEST_INTEGER)),
                step=0,
            )
        ]
    return result


def declare(node: Node, parameters: type[P], prefix: str = '', *, read_only: bool) -> P:
    """Declare a parameter set to ROS and return it with the values that the node was given.

    Raises
    ------
    ParameterError
        If a value cannot be used.
    """
    values = {}
    for own_name, entry in parameters.entries().items():
        default = list(entry.default) if isinstance(entry.default, tuple) else entry.default
        name = prefix + own_name
        try:
            declared = node.declare_parameter(name, default, descriptor(entry, read_only=read_only))
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f'{node.get_name()}.{name}: {error}') from None
        values[own_name] = declared.value
    return parameters.from_mapping(values)
