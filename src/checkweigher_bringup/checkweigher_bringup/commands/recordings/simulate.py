# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write a bag of simulated products with known masses.

Examples
--------
checkweigher simulate --speed 60 --mass 134.5 --count 20 --output /tmp/line
"""

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import NEW_BAG, RECIPES, REQUIRED
from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_core.recording import Event

# Options that are not in SI units: the name of the parameter, the unit of the option, and the
# number of these units in one SI unit.
_CONVERTED = {
    'speed': ('speed', 'm/min', 60.0),
    'mass': ('masses', 'g', 1000.0),
    'zero-drift': ('zero_drift', 'g/h', 3.6e6),
    'filler-drift': ('filler_drift', 'g in 1000 products', 1e6),
    'filler-spread': ('filler_spread', 'g', 1000.0),
}
_PROFILES = (
    'machine and its disturbances: paper (default), roller, soft, floor, quiet, or machine:SEED, a '
    'randomly drawn machine with its own sample rate, sensitivity and lengths'
)
OPTIONS = (
    ('--speed M_PER_MIN', float, 'belt speed in m/min', REQUIRED),
    ('--mass G', [float], 'masses of the products in g, used cyclically', REQUIRED),
    ('--count N', int, 'number of products; default 25', 25),
    ('--profile NAME', str, _PROFILES, 'paper'),
    ('--seed S', int, 'seed of the random numbers; default 1', 1),
    ('--start-time S', int, 'stamp of the first sample in s since 1970'),
    NEW_BAG,
    ('--spacing M', float, 'distance between the leading edges of successive products in m'),
    ('--product-length M', float, 'length of the products in m'),
    ('--weigh-length M', float, 'distance between the photo-eyes in m'),
    ('--zero-drift G_PER_H', float, 'drift of the zero in g/h'),
    ('--lead-in S', float, 'duration of the empty belt before the first product in s'),
    ('--run-out S', float, 'duration of the empty belt after the last product in s'),
    'filler before the scale',
    ('--filler-drift G', float, 'drift of the filled mass in g over 1000 products'),
    ('--filler-spread G', float, 'standard deviation of the filled mass in g'),
    ('--filler-delay N', int, 'number of products between filler and scale'),
    RECIPES,
    ('--product NAME', str, 'product in the recipe file, whose feedback corrects the filler'),
)


def run(arguments: argparse.Namespace) -> int:
    """Simulate a line, and write its samples, its edges and the true masses to a bag."""
    from checkweigher_bringup.settings import recipe_of
    from checkweigher_recording.bags.writing import write_bag
    from checkweigher_recording.progress import with_progress
    from checkweigher_recording.simulation.closed_loop import with_feedback
    from checkweigher_recording.simulation.simulator import (
        Simulation,
        SimulationParameters,
        check_profile,
        own_values,
    )

    names = SimulationParameters.entries()
    check_profile(arguments.profile)
    given = {n: value for n, value in vars(arguments).items() if n in names and value is not None}
    if arguments.count == 0:
        raise UserError('--count 0: would be an endless line; give the number of products')
    given['masses'] = tuple(_to_si('mass', mass) for mass in arguments.mass)
    for option, (name, *_) in _CONVERTED.items():
        if option != 'mass' and name in given:
            given[name] = _to_si(option, given[name])
    parameters = SimulationParameters.from_mapping(own_values(arguments.profile) | given)
    product = recipe_of(arguments)
    simulation = Simulation(parameters)
    events: Iterable[Event] = simulation
    if product is not None:
        if product.filler is None:
            raise UserError(f'--product {product.name}: its recipe has no feedback to a filler')
        events = with_feedback(simulation, product)
    write_bag(arguments.output, simulation.load_cell, with_progress(events, 'simulating'))
    print(
        f'{arguments.output}: {parameters.count} products at {arguments.speed:g} m/min, '
        f'profile {parameters.profile}, seed {parameters.seed}'
    )
    return 0


def _to_si(option: str, value: float) -> float:
    """Return the value of an option in SI units, or raise `UserError` if it is out of range."""
    from checkweigher_core.parameters import describe
    from checkweigher_recording.simulation.simulator import SimulationParameters

    name, unit, per_si = _CONVERTED[option]
    allowed = describe(SimulationParameters.entries()[name])
    converted = value / per_si
    if not allowed.minimum <= converted <= allowed.maximum:  # NaN is out of range, too.
        raise UserError(
            f'--{option} {value:g}: must be between {per_si * allowed.minimum:g} and '
            f'{per_si * allowed.maximum:g} {unit}'
        )
    return converted
