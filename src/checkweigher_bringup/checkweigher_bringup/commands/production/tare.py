# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Control the tare of a product by a sample of empty packages.

checkweigher tare recipes.yaml --product crisps_150g --masses 3.98 4.02 4.01 --who anna
"""

import argparse
from pathlib import Path

from checkweigher_bringup.commands import NAMESPACE, REQUIRED
from checkweigher_bringup.errors import UserError

OPTIONS = (
    ('recipes RECIPES', Path, 'recipe file'),
    ('--product NAME', str, 'product of it', REQUIRED),
    ('--masses G', [float], 'mass of each empty package, g; at least 25', REQUIRED),
    ('--who NAME', str, 'who weighed them; goes into the audit log', REQUIRED),
    ('--accept', bool, 'write the mean into the recipe as the tare'),
    ('--log LOG', Path, 'audit log; default audit.log beside the recipe file'),
    NAMESPACE,
)


def run(arguments: argparse.Namespace) -> int:
    """Print and record the sample, and write its mean into the recipe if it is accepted.

    Returns 1 if the mean may not be the tare, otherwise 0.
    """
    from checkweigher_bringup.commands.production import write_claim
    from checkweigher_core.changes import TARE
    from checkweigher_core.records import GRAMS
    from checkweigher_production.audit_chain import LOG_FILE
    from checkweigher_production.prepackages import TareControl
    from checkweigher_production.recipes import read_recipes

    path, name = arguments.recipes, arguments.product
    if (product := read_recipes(path).get(name)) is None:
        raise UserError(f'{path}: has no product {name}')
    if not all(0 < mass < 1e7 for mass in arguments.masses):
        raise UserError('--masses: must be above 0, in g')
    control = TareControl(tuple(mass / GRAMS for mass in arguments.masses), product.nominal)
    accepts = arguments.accept and not control.refusal
    text = _with_tare(path, name, control.mean) if accepts else ''
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
        _write(path, text)
    print(
        f'NOT the tare: {control.refusal}'
        if control.refusal
        else 'the mean is the tare from the next selection of the product on'
        if accepts
        else 'the mean may be the tare; --accept writes it'
    )
    return int(bool(control.refusal))


def _with_tare(path: Path, name: str, tare: float) -> str:
    """Return the text of a recipe file in which a product has another tare, rounded to 1 mg.

    Raises `UserError` if this would also change another recipe, as with an anchor of YAML.
    """
    from dataclasses import replace

    from checkweigher_core.settings_files import plain, read_settings
    from checkweigher_core.yaml_files import with_value
    from checkweigher_production.recipes import RecipeFile, read_recipes

    old, tare = read_recipes(path), round(tare, 6)
    text = with_value(path.read_text(encoding='utf-8'), ('products', name), 'tare', f'{tare:.6f}')
    wanted = old | {name: replace(old[name], tare=tare)}
    found = read_settings(text, RecipeFile).products
    if repr(plain(found)) != repr(plain(wanted)):
        raise UserError(f'{path}: the tare of {name} cannot be written alone; change it by hand')
    return text


def _write(path: Path, text: str) -> None:
    import os

    from checkweigher_core.state_files import replace_file

    replace_file(Path(os.path.realpath(path)), [text.encode()], path.stat().st_mode & 0o777)
