# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Registries of the devices of a machine, and the parameters that select the devices."""

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any, ClassVar, cast

from checkweigher_core.parameters import ParameterError, Parameters, package_missing, parameter
from checkweigher_driver.line_io.machine_inputs import MachineInputs
from checkweigher_driver.line_io.outputs import MachineOutputs
from checkweigher_driver.line_io.rejector_control import OutputParameters
from checkweigher_driver.sources import EdgeSource, Source
from checkweigher_driver.sources.machine import MachineSource

# Classes of the sources by name. A class is imported on request, so that a machine needs only the
# packages of its own devices. package.xml names only packages that apt provides, because bloom
# could otherwise not release this package.
SOURCES = {
    'simulator': 'checkweigher_driver.sources.simulator:SimulatorSource',
    'bag': 'checkweigher_driver.sources.bag:BagSource',
    'aed': 'checkweigher_driver.serial.aed:AedSource',
    'ascii': 'checkweigher_driver.serial.ascii:AsciiSource',
}
NONE = 'none'
EYES = {
    NONE: '',
    'replayed': 'checkweigher_driver.sources.bag:ReplayedEyes',
    'modbus': 'checkweigher_driver.line_io.modbus:ModbusEyes',
    'gpio': 'checkweigher_driver.line_io.gpio:GpioEyes',
}
OUTPUTS = {
    NONE: '',
    'modbus': 'checkweigher_driver.line_io.modbus:ModbusOutputs',
    'gpio': 'checkweigher_driver.line_io.gpio:GpioOutputs',
}
INPUTS = {
    NONE: '',
    'modbus': 'checkweigher_driver.line_io.modbus:ModbusInputs',
    'gpio': 'checkweigher_driver.line_io.gpio:GpioInputs',
}

# Function that returns an instance of a parameter class, with the values that the node was given.
ReadParameters = Callable[[type[Parameters]], Any]


@dataclass(frozen=True)
class DriverParameters(Parameters):
    """Parameters of the driver, such as devices and the pace of a recorded or simulated source."""

    node: ClassVar[str] = 'driver'

    source: str = parameter('simulator', 'source of samples and edges', choices=tuple(SOURCES))
    eyes: str = parameter(
        NONE,
        'photo-eyes that are connected separately; none if the source has its own',
        choices=tuple(EYES),
    )
    rate: float = parameter(
        1.0,
        'speed of a recorded or simulated source relative to real time; 0: as fast as possible',
        minimum=0,
        maximum=1e6,
    )
    lossless: bool = parameter(
        True,
        'whether a recorded or simulated source waits for the segmenter and for the verdicts, so '
        'that no data is lost',
    )
    listeners: int = parameter(
        0,
        'number of other subscribers of load_cell/samples, such as recorders, for which a '
        'lossless source waits before it begins',
        minimum=0,
        maximum=1000,
    )
    block_time: float = parameter(
        0.1,
        'duration up to which blocks of a recorded or simulated source are joined, which saves '
        'CPU time; edges are not delayed; 0: no blocks are joined',
        unit='s',
        minimum=0,
        maximum=1,
    )
    publish_clock: bool = parameter(
        False,
        'whether the stamps of the samples are published on /clock, for nodes with use_sim_time',
    )
    outputs: str = parameter(
        NONE, 'device to which rejector and stop are connected', choices=tuple(OUTPUTS)
    )
    inputs: str = parameter(
        NONE,
        'device to which guards, air, bins and inspection devices are connected',
        choices=tuple(INPUTS),
    )
    autostart: bool = parameter(
        True, 'whether the node activates itself; false leaves this to a lifecycle manager'
    )


def source_class(name: str) -> type[Source]:
    """Return a class of `SOURCES` by its name.

    Raises `ParameterError` if the name is unknown, or if a package that the class needs is not
    installed.
    """
    return cast(type[Source], _find('source', name, SOURCES))


def eyes_class(name: str) -> type[EdgeSource]:
    """Return a class of `EYES` by its name.

    Raises `ParameterError` if the name is unknown or `NONE`, or if a package that the class needs
    is not installed.
    """
    return cast(type[EdgeSource], _find('eyes', name, EYES))


def _find(parameter_name: str, name: str, registry: dict[str, str]) -> Any:
    if not registry.get(name):
        known = ', '.join(each for each in registry if each != NONE)
        raise ParameterError(f'{parameter_name}: {name!r} is not one of {known}')
    module, found = registry[name].split(':')
    try:
        return getattr(import_module(module), found)
    except ModuleNotFoundError as error:
        raise package_missing(parameter_name, name, str(error.name)) from None


def source_maker(name: str, eyes: str, read: ReadParameters) -> Callable[[], Source]:
    """Return a function that opens a source of samples together with its photo-eyes.

    `name` is a key of `SOURCES`, and `eyes` is a key of `EYES`. If `eyes` is `NONE`, no separate
    photo-eyes are opened. The returned function raises ValueError if a device cannot be opened; the
    message is one line for a technician. `source_maker` itself raises ParameterError if a name is
    unknown, if a package that a device needs is not installed, if a parameter is invalid, or if
    `eyes` is not `NONE` for a source with its own photo-eyes.
    """
    make_source = source_class(name)
    parameters = read(make_source.parameters)
    if eyes == NONE:
        return lambda: make_source(parameters)
    make_eyes = eyes_class(eyes)
    if make_source.paced:
        raise ParameterError(
            f'eyes: {eyes!r}, but the source {name!r} has its own eyes; must be {NONE!r}'
        )
    eye_parameters = read(make_eyes.parameters)

    def make() -> Source:
        edges = make_eyes(eye_parameters)
        try:
            return MachineSource(make_source(parameters), edges)
        except BaseException:
            edges.close()
            raise

    return make


def make_outputs(name: str, read: ReadParameters) -> MachineOutputs:
    """Return the outputs of a machine, without a device if `name` is `NONE`.

    Raises `ParameterError` if the name is unknown, if a package that the device needs is not
    installed, or if a parameter is invalid.
    """
    if name == NONE:
        return MachineOutputs(None, OutputParameters())
    kind = _find('outputs', name, OUTPUTS)
    return MachineOutputs(kind(read(kind.parameters)), read(OutputParameters))


def make_inputs(name: str, read: ReadParameters) -> MachineInputs:
    """Return the inputs of a machine, without a device if `name` is `NONE`.

    Raises `ParameterError` if the name is unknown, if a package that the device needs is not
    installed, or if a parameter is invalid.
    """
    if name == NONE:
        return MachineInputs(None)
    kind = _find('inputs', name, INPUTS)
    parameters = read(kind.parameters)
    return MachineInputs(kind(parameters), parameters.bin_time)
