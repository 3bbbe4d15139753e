"""Rejector, stop and photo-eyes on real lines: one registry of the outputs.

The photo-eyes are in the registry of `checkweigher_driver.sources`.
"""

from collections.abc import Callable
from importlib import import_module
from typing import Any

from checkweigher_driver.line_io.outputs import MachineOutputs, OutputParameters
from checkweigher_dsp.parameters import ParameterError, Parameters

# Name and class. A class is imported when it is asked for, so that a machine needs only what its
# own outputs need.
OUTPUTS = {
    'none': '',
    'modbus': 'checkweigher_driver.line_io.modbus:ModbusOutputs',
    'gpio': 'checkweigher_driver.line_io.gpio:GpioOutputs',
}


def output_class(name: str) -> Any:
    """Return the class of an output port.

    Parameters
    ----------
    name : str
        One of `OUTPUTS`, but not none.

    Raises
    ------
    ParameterError
        If there is no such output.
    """
    if not OUTPUTS.get(name):
        raise ParameterError(f'outputs: {name!r} is not one of {", ".join(OUTPUTS)}')
    module, found = OUTPUTS[name].split(':')
    return getattr(import_module(module), found)


def prepare_outputs(
    name: str, read: Callable[[type[Parameters]], Parameters]
) -> Callable[[], MachineOutputs] | None:
    """Read the parameters of a machine's outputs, and return what opens them; None without any.

    What is opened is safe until it is activated.

    Parameters
    ----------
    name : str
        One of `OUTPUTS`.
    read : callable
        Gives the values of a parameter set.

    Raises
    ------
    ParameterError
        If a value cannot be used. A device that is not there is waited for.
    """
    if name == 'none':
        return None
    kind = output_class(name)
    port = read(kind.parameters)
    common = read(OutputParameters)
    assert isinstance(common, OutputParameters)
    return lambda: MachineOutputs(kind(port), common)
