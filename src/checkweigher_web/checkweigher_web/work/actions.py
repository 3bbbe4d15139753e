# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Actions of operators and technicians on a lane, and readers of its settings.

An action returns a text for the user on its outcome, and raises `ActionRefusedError` if a node
refuses it, does not run or does not answer.
"""

import asyncio
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from lifecycle_msgs.msg import State, Transition

from checkweigher_core.parameters import ParameterError, flatten
from checkweigher_core.records import ProductOnLine
from checkweigher_core.ros import ports
from checkweigher_core.ros.line_parameters import python_value
from checkweigher_core.ros.node_parameters import ros_parameters
from checkweigher_core.ros.services import SETTER
from checkweigher_core.whole_file import OutputError
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.rejection.parameters import limits_of
from checkweigher_production.recipes import Product, read_recipes
from checkweigher_recording.simulation.operation import OPERATION, OperationParameters
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.languages.wording import in_grams, in_words
from checkweigher_web.work.services import ActionRefusedError, LaneServices

_MANAGED = 'reject', 'driver'  # life-cycle nodes in the order in which they are activated
_STEPS = {
    State.PRIMARY_STATE_UNCONFIGURED: Transition.TRANSITION_CONFIGURE,
    State.PRIMARY_STATE_INACTIVE: Transition.TRANSITION_ACTIVATE,
}


@dataclass(frozen=True)
class MassLimits:
    """Limits of the reject node in kg. An infinite value means no limit."""

    lower: float
    upper: float

    @property
    def text(self) -> Text:
        """Text with both limits."""
        return Text('{lower} and {upper}', lower=Mass(self.lower), upper=Mass(self.upper))


async def products(services: LaneServices) -> dict[str, Product]:
    """Return the products of the recipe file of a lane, by name.

    Raises `ActionRefusedError` if the lane has no recipe file, or if the file is not valid or not
    on this machine.
    """
    try:
        return read_recipes(await recipe_file(services))
    except ParameterError as error:
        raise ActionRefusedError(str(error)) from None


async def recipe_file(services: LaneServices) -> Path:
    """Return the path of the recipe file of a lane, or raise `ActionRefusedError` without one."""
    missing = Text('the node product has no recipe file: set its parameter recipes')
    return await _path(services, 'recipes', missing)


async def change_file(change: Callable[[], None], said: Text) -> Text:
    """Call `change`, which changes a file, in a thread, and return the text `said`.

    Raises `ActionRefusedError` if `change` raises `ParameterError` or `OutputError`.
    """
    try:
        await asyncio.to_thread(change)
    except (ParameterError, OutputError) as error:
        raise ActionRefusedError(in_grams(str(error))) from None
    return said


async def select_product(services: LaneServices, name: str) -> str:
    """Select the product `name` of the recipe file, and return a text for the user."""
    await services.call('select_product', product=name)
    return Text('product {name} is selected', name=name)


async def new_batch(services: LaneServices, name: str) -> str:
    """Begin a new batch, which ends the present batch, and return a text for the user."""
    answer = await services.call('new_batch', batch=name)
    return Text(
        'batch {name} has begun; items of the batch before: {count}',
        name=name,
        count=answer.finished.items,
    )


async def zero(services: LaneServices) -> str:
    """Set the zero when the belt is empty and at rest, and return a text for the user."""
    try:
        return in_words(await services.message(ports.ZERO)) or Text('the zero is set')
    except ActionRefusedError as error:
        raise ActionRefusedError(in_grams(str(error))) from None


async def reset_stop(services: LaneServices) -> str:
    """Reset the stop request of a lane, and return a text for the user."""
    return await services.message(ports.RESET_STOP_REQUEST) or Text(
        'the stop request is taken back'
    )


async def acknowledge_alarms(services: LaneServices) -> str:
    """Acknowledge all alarms of a lane, and return the message of the node for the user."""
    return await services.message(ports.ACKNOWLEDGE_ALARMS)


async def stop(services: LaneServices) -> str:
    """Stop weighing by deactivating the driver, and return a text for the user."""
    await _change(services, 'driver', Transition.TRANSITION_DEACTIVATE)
    return Text('weighing has stopped')


async def start(services: LaneServices) -> str:
    """Start weighing, and return a text for the user.

    The nodes `reject` and `driver` are configured and activated, unless they already are.
    """
    for node in _MANAGED:
        for _ in _STEPS:
            state = (await services.call(f'{node}/get_state')).current_state.id
            if state in _STEPS:
                await _change(services, node, _STEPS[state])
    return Text('weighing has started')


async def _change(services: LaneServices, node: str, step: int) -> None:
    await services.call(f'{node}/change_state', transition=Transition(id=step))


def limits(services: LaneServices) -> MassLimits:
    """Return the present limits of a lane, or raise `ActionRefusedError` if they are unknown."""
    in_use = _in_use(services)
    return MassLimits(in_use.lower_limit, in_use.upper_limit)


def _in_use(services: LaneServices) -> ProductOnLine:
    if services.product is None:
        raise ActionRefusedError(Text('the node reject has not said its limits yet'))
    return services.product


async def set_limits(services: LaneServices, wanted: MassLimits) -> str:
    """Set both limits of the node `reject`, and return a text for the user.

    Raises `ActionRefusedError`, and changes neither limit, if the node refuses the limits, or if
    the line has recipes but no product is selected. A product that is selected later would replace
    the new limits by its own limits.
    """
    now = services.product
    if now is not None and now.lacks_product:
        text = Text('no limits are set, because nothing is accepted: select a product first')
        raise ActionRefusedError(text)
    # The node would also refuse these limits, but the message of the node has masses in kg.
    if wanted.lower > wanted.upper:
        text = Text(
            'the lower limit, {lower}, is above the upper one, {upper}',
            lower=Mass(wanted.lower),
            upper=Mass(wanted.upper),
        )
        raise ActionRefusedError(text)
    await _set(services, 'reject', {'lower_limit': wanted.lower, 'upper_limit': wanted.upper})
    return Text('the limits are {limits}', limits=wanted.text)


async def operation(services: LaneServices) -> OperationParameters:
    """Return the settings of a simulated machine.

    Raises `ActionRefusedError` if the machine of the lane is not simulated.
    """
    names = list(OperationParameters.entries())
    values = await _parameters(services, 'driver', *(OPERATION + name for name in names))
    if len(values) != len(names) or None in values:
        raise ActionRefusedError(Text('the machine of this lane is not simulated'))
    return OperationParameters.from_mapping(dict(zip(names, values, strict=True)))


async def operate(services: LaneServices, wanted: Mapping[str, object]) -> str:
    """Change settings of a simulated machine, and return '', because the user needs no text.

    `wanted` contains the new values by the names of `OperationParameters`.
    """
    await _set(services, 'driver', {OPERATION + name: each for name, each in wanted.items()})
    return ''


async def line_parameters(services: LaneServices) -> LineParameters:
    """Return the present parameters of the stages of a lane, with the present limits.

    Raises `ActionRefusedError` if a node lacks parameters, if the limits are not known yet, or if
    the parameters are not valid.
    """
    defaults, found = LineParameters(), dict[str, object]()
    for node in ports.STAGES:
        names = list(getattr(defaults, node).as_mapping())
        values = await _parameters(services, node, *names)
        if len(values) != len(names):
            text = Text('the node {node} is of another version: it lacks parameters', node=node)
            raise ActionRefusedError(text)
        found |= {f'{node}.{name}': each for name, each in zip(names, values, strict=True)}
    found |= flatten({'reject': limits_of(_in_use(services))})
    try:
        return defaults.with_values(found)
    except ParameterError as error:
        raise ActionRefusedError(str(error)) from None


async def batch_folder(services: LaneServices) -> Path:
    """Return the folder of the batch records, or raise `ActionRefusedError` if there is none."""
    missing = Text('the node product keeps no records: set its parameter batch_folder')
    return await _path(services, 'batch_folder', missing)


async def audit_log(services: LaneServices) -> Path:
    """Return the path of a lane's audit log, or raise `ActionRefusedError` if there is none."""
    missing = Text(
        'the node product writes no audit log: set its parameter audit_log, or run the line with '
        '--folder'
    )
    return (await _path(services, 'audit_log', missing)).absolute()


async def _path(services: LaneServices, name: str, missing: Text) -> Path:
    """Return the path in a parameter of `product`, or raise `ActionRefusedError` if it is empty."""
    (path,) = await _parameters(services, 'product', name)
    if not path:
        raise ActionRefusedError(missing)
    return Path(str(path))


async def _set(services: LaneServices, node: str, values: Mapping[str, object]) -> None:
    given = [each.to_parameter_msg() for each in ros_parameters(values)]
    result = (await services.call(f'{node}/{SETTER}', parameters=given)).result
    if not result.successful:
        raise ActionRefusedError(result.reason)


async def _parameters(services: LaneServices, node: str, *names: str) -> list[object]:
    answer = await services.call(f'{node}/get_parameters', names=list(names))
    return [python_value(value) for value in answer.values]
