# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Check the tare of a product with a sample of empty packages.

Examples
--------
checkweigher tare recipes.yaml --product crisps_150g --masses 3.98 4.02 4.01 --who anna
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NAMESPACE, REQUIRED
from checkweigher_bringup.errors import UserError

_LARGEST = 1e7  # upper bound of the mass of a package in g

OPTIONS = (
    ('recipes RECIPES', Path, 'recipe file'),
    ('--product NAME', str, 'product in the recipe file', REQUIRED),
    ('--masses G', [float], 'mass in g of each empty package, at least 25 of them', REQUIRED),
    ('--who NAME', str, 'name of the person who weighed them, for the audit log', REQUIRED),
    ('--accept', bool, 'write the mean into the recipe as the tare'),
    ('--log LOG', Path, 'audit log; default: audit.log in the folder of the recipe file'),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Print the statistics of the sample of packages, and write the sample to the audit log.

    With `--accept`, the mean of the sample is written into the recipe as the tare, unless
    `TareControl` refuses the mean. Returns 1 if `TareControl` refuses the mean as the tare,
    otherwise 0.
    """
    from checkweigher_bringup.commands.production import write_claim
    from checkweigher_core.changes import TARE
    from checkweigher_core.records import GRAMS
    from checkweigher_production.audit_chain import LOG_FILE
    from checkweigher_production.prepackages import TareControl
    from checkweigher_production.recipes import change_recipe, given_recipes, read_recipes

    path, name = arguments.recipes, arguments.product
    if (product := read_recipes(path).get(name)) is None:
        raise UserError(f'{path}: has no product {name}')
    for mass in arguments.masses:
        if not 0 < mass < _LARGEST:
            raise UserError(f'--masses {mass:g}: must be above 0 g and below {_LARGEST:g} g')
    control = TareControl(tuple(mass / GRAMS for mass in arguments.masses), product.nominal)
    accepts = arguments.accept and not control.refusal
    value = {
        'masses': control.masses,
        'mean': control.mean,
        'std_dev': control.std_dev,
        'refusal': control.refusal,
        'accepted': accepts,
        'before': product.tare,
    }
    log = arguments.log or path.resolve().with_name(LOG_FILE)
    write_claim(log, arguments.namespace, TARE, name, value, arguments.who)
    print(
        f'{len(control.masses)} empty packages: mean {GRAMS * control.mean:.3f} g, standard '
        f'deviation {GRAMS * control.std_dev:.3f} g; the tare was {GRAMS * product.tare:.3f} g'
    )
    if accepts:
        change_recipe(path, name, given_recipes(path)[name] | {'tare': round(control.mean, 6)})
    print(
        f'NOT the tare: {control.refusal}'
        if control.refusal
        else 'the mean is the tare from the next selection of the product on'
        if accepts
        else 'the mean may be the tare; --accept writes it'
    )
    return int(bool(control.refusal))
