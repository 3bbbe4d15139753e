# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Summary of a verification plan in words: duration, steps, and reasons why it cannot pass."""

from collections.abc import Callable, Iterable, Iterator
from functools import reduce
import math
from typing import NamedTuple

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import LoadCell
from checkweigher_validation.verification.evaluation import plan_departures
from checkweigher_validation.verification.expectation import (
    Expected,
    expected_duration,
    expected_uncertainties,
)
from checkweigher_validation.verification.plan import MINUTE, read_plan
from checkweigher_validation.verification.steps import Step, steps_of
from checkweigher_web.commissioning.plan_form import not_given
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.languages.wording import from_node, in_words

# Assumed distance in m from one product to the next if no passes were recorded.
_SPACING = 1.0


def _unknown(_mass: float) -> float:
    """Return 0, because no standard deviation is known."""
    return 0.0


class LineFacts(NamedTuple):
    """Facts about a line from which the result of a plan is predicted.

    Attributes
    ----------
    load_cell : LoadCell or None
        Load cell, or None if it is not known.
    std_dev : callable
        Function that returns the standard deviation in kg of one pass of a mass in kg, or 0 if it
        is not known.
    zero_std_dev : float
        Standard deviation in kg of a zero that an operator sets, or 0 if it is not known.
    spacing : float
        Recorded distance in m from one product to the next, or NaN if it is not known.
    """

    load_cell: LoadCell | None = None
    std_dev: Callable[[float], float] = _unknown
    zero_std_dev: float = 0.0
    spacing: float = math.nan


def summary(text: str, known: LineFacts) -> tuple[Text, list[tuple[Text, str]], list[Text]]:
    """Return a summary of a plan, its steps as rows, and lines on its shortcomings.

    The lines name the fields that the user still has to fill in, the reasons why the plan cannot
    pass, and the steps that cannot be decided because the uncertainty will be too large. If the
    plan is not valid, the summary is the error, and there are no rows or lines.
    """
    try:
        plan = read_plan(text)
    except ParameterError as error:
        return Text('The plan is not complete: {error}', error=str(error)), [], []
    steps = steps_of(plan)
    rows = [(step_words(step.name), _to_do(step)) for step in steps]
    is_known = math.isfinite(known.spacing)
    spacing = known.spacing if is_known else _SPACING
    line = Text(
        'Steps: {steps}, passes: {passes}, duration: at least {minutes} min, with {spacing} cm '
        'from one product to the next ({source}), and without the time to place loads and to set '
        'the belt speed',
        steps=len(steps),
        passes=sum(step.count for step in steps),
        minutes=math.ceil(expected_duration(plan, spacing) / MINUTE),
        spacing=round(100 * spacing),
        source=Text('as recorded') if is_known else Text('assumed'),
    )
    departures = (
        Text('This plan cannot pass: {why}', why=departure_words(each))
        for each in plan_departures(plan, known.load_cell)
    )
    expected = expected_uncertainties(plan, known.std_dev, known.zero_std_dev)
    return line, rows, [*_to_fill_in(text), *departures, *_doubts(expected)]


def to_do_of(text: str) -> dict[str, str]:
    """Return what to do in each step of a plan, by the name of the step, or {} for a wrong plan."""
    try:
        return {step.name: _to_do(step) for step in steps_of(read_plan(text))}
    except ParameterError:
        return {}


def _to_fill_in(text: str) -> Iterator[Text]:
    if fields := not_given(text):
        yield Text('Not filled in yet, or as in the example plan: {fields}', fields=_listed(fields))


def _to_do(step: Step) -> str:
    to_do = from_node(step.to_do)
    if not step.count:
        return to_do
    return Text('{count} passes: {to_do}', count=step.count, to_do=to_do)


def _doubts(expected: Iterable[Expected]) -> Iterator[Text]:
    """Yield a line for each reason why steps cannot be decided, with the names of the steps."""
    names: dict[Text, list[Text]] = {}
    for each in expected:
        if not each.is_decidable:
            why = Text(
                'the error will be known to {uncertainty} (k = 2), and its limit is {limit}',
                uncertainty=_three_digits(each.uncertainty),
                limit=_three_digits(each.limit),
            )
            names.setdefault(why, []).append(step_words(each.step.name))
    for why, steps in names.items():
        yield Text(
            'Cannot be decided reliably, because {why}: {steps}. A larger e would help, and for a '
            'mass more passes or a smaller uncertainty.',
            why=why,
            steps=_listed(steps),
        )


def _listed(texts: Iterable[Text]) -> Text:
    return reduce(lambda listed, text: Text('{steps}, {step}', steps=listed, step=text), texts)


def _three_digits(mass: float) -> Mass:
    return Mass(float(f'{mass:.3g}'))


def departure_words(text: str) -> str:
    """Return a line on a verification in words, with the step in plain text if it names one."""
    found = in_words(text)
    if isinstance(found, Text) and found.template.startswith('Step {name} '):
        return Text(
            found.template, **{**found.values, 'name': step_words(str(found.values['name']))}
        )
    return found


def step_words(name: str) -> Text:
    """Return the name of a verification step as plain text. An unknown name is not changed."""
    kind, _, rest = name.partition('_')
    first, _, last = rest.partition('_')
    match kind, first:
        case 'static', 'up' | 'down':
            if first == 'up':
                return Text('{load} at rest, loading', load=last)
            return Text('{load} at rest, unloading', load=last)
        case 'passes', _:
            return Text('{load} at {speed} m/min', load=last, speed=first)
        case 'warm', _:
            *zero, minutes = last.split('_')
            if zero:
                return Text('warm-up, zero after {minutes} min', minutes=minutes)
            return Text('warm-up, passes after {minutes} min', minutes=minutes)
        case 'zero', 'after':
            return Text('zero after the loads')
        case 'zero', _:
            return Text('zero, reading {number}', number=rest)
        case 'outside', _:
            return Text('outside the range of speeds, {number}', number=rest)
        case 'eccentricity', _:
            return Text('beside the middle: {place}', place=rest)
    return Text('repeatability') if name == 'repeatability' else Text('{name}', name=name)
