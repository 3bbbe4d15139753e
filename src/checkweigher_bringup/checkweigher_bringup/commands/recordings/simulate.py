# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Write a bag of simulated products."""

import argparse
from collections.abc import Iterable
from typing import TYPE_CHECKING

from checkweigher_bringup.commands import add_new_bag, add_recipe
from checkweigher_bringup.errors import UserError

if TYPE_CHECKING:
    from checkweigher_core.recording import Event

# Options in the units of the trade: the parameter, which is in SI, and how many of the unit make
# one of SI.
_CONVERTED = {
    'speed': ('speed', 'm/min', 60.0),
    'mass': ('masses', 'g', 1000.0),
    'zero-drift': ('zero_drift', 'g/h', 3.6e6),
    'filler-drift': ('filler_drift', 'g in 1000 products', 1e6),
    'filler-spread': ('filler_spread', 'g', 1000.0),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of `simulate`; the defaults are those of SimulationParameters."""
    add = parser.add_argument
    add('--speed', type=float, required=True, metavar='M_PER_MIN', help='belt speed, m/min')
    add('--mass', type=float, nargs='+', action='extend', required=True, metavar='G',
        help='mass of the products, g; several take turns')  # fmt: skip
    add('--count', type=int, default=25, metavar='N', help='number of products')
    add('--profile', metavar='NAME', default='paper',
        help='machine and what shakes it: paper (default), roller, soft, floor, quiet, or '
        'machine:SEED, one of a family, with its own sample rate, sensitivity and lengths',
    )  # fmt: skip
    add('--seed', type=int, default=1, metavar='S', help='of all that is random')
    add('--start-time', type=int, metavar='S', help='stamp of the first sample, s since 1970')
    add_new_bag(parser)
    for name, unit, text in (
        ('spacing', 'M', 'between leading edges of successive products'),
        ('product-length', 'M', 'length of the products'),
        ('weigh-length', 'M', 'between the two eyes'),
        ('zero-drift', 'G_PER_H', 'drift of the empty belt'),
        ('lead-in', 'S', 'empty belt before the first product'),
        ('run-out', 'S', 'empty belt after the last product'),
    ):
        add(f'--{name}', type=float, metavar=unit, help=text)

    filler = parser.add_argument_group('the filler before the scale').add_argument
    filler('--filler-drift', type=float, metavar='G', help='drift in 1000 products, g')
    filler('--filler-spread', type=float, metavar='G',
           help='standard deviation from product to product, g')  # fmt: skip
    filler('--filler-delay', type=int, metavar='N', help='products between filler and scale')
    add_recipe(filler, 'its filler follows the feedback of this recipe')


def run(arguments: argparse.Namespace) -> int:
    """Simulate the line and write the bag."""
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
        raise UserError('--count 0 is an endless line, which fits in no bag')
    given['speed'] = _to_si('speed', arguments.speed)
    given['masses'] = tuple(_to_si('mass', mass) for mass in arguments.mass)
    for option in ('zero-drift', 'filler-drift', 'filler-spread'):
        name = _CONVERTED[option][0]
        if name in given:
            given[name] = _to_si(option, given[name])
    parameters = SimulationParameters.from_mapping(own_values(arguments.profile) | given)
    product = recipe_of(arguments)
    simulation = Simulation(parameters)
    events: Iterable[Event] = simulation
    if product is not None:
        if product.filler is None:
            raise UserError(f'--product {product.name}: its recipe has no filler, so no feedback')
        events = with_feedback(simulation, product)
    write_bag(arguments.output, simulation.load_cell, with_progress(events, 'simulating'))
    print(
        f'{arguments.output}: {parameters.count} products at {arguments.speed:g} m/min, '
        f'profile {parameters.profile}, seed {parameters.seed}'
    )
    return 0


def _to_si(option: str, value: float) -> float:
    """Return the value of an option in SI; a refusal is in the unit of the option."""
    from checkweigher_core.parameters import describe
    from checkweigher_recording.simulation.simulator import SimulationParameters

    name, unit, per_si = _CONVERTED[option]
    allowed = describe(SimulationParameters.entries()[name])
    converted = value / per_si
    if not allowed.minimum <= converted <= allowed.maximum:  # NaN is not
        raise UserError(
            f'--{option} {value:g}: must be between {per_si * allowed.minimum:g} and '
            f'{per_si * allowed.maximum:g} {unit}'
        )
    return converted
