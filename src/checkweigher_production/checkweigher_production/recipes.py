# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes: a YAML file with the masses, limits and parameters of each product.

Masses are net masses of the contents, except `tare` and the mass of the test product, which
includes its packaging. The scale weighs contents and packaging together. Therefore the tare is
added to all mass limits for the reject node.

Examples
--------
::

    products:
      crisps_150g:
        nominal: 0.150            # kg, contents
        tare: 0.004               # kg, of the packaging
        lower_limit: TU1          # kg of contents, or TU1 or TU2 of directive 76/211/EEC
        upper_limit: 0.165        # kg of contents
        length: [0.09, 0.12]      # m, shortest and longest
        speed: [0.5, 1.5]         # m/s, slowest and fastest
        tu1_quota: 0.025          # fraction of the accepted items that may be between TU2 and TU1
        mean_value: true          # the mean of the batch is never below nominal
        filler: {max_correction: 0.004, dead_band: 0.0002, delay: 6}  # feedback to the filler
        test: {mass: 0.1502, limit: 0.0005, every_hours: 8}  # performance test
        reason: true              # a person at the page has to say why something is changed
        parameters:               # of the nodes, as in a parameter file
          identifier:
            estimator: gauss_markov
"""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
import math
from pathlib import Path
from statistics import NormalDist
from typing import Any, ClassVar

from checkweigher_core.parameters import (
    ParameterError,
    Parameters,
    SettingsError,
    check,
    flatten,
    parameter,
)
from checkweigher_core.records import GRAMS, NanEqual, ProductOnLine
from checkweigher_core.settings_files import Settings, read_settings, settings_of
from checkweigher_core.state_files import changing
from checkweigher_core.whole_file import output_error, write_whole
from checkweigher_core.yaml_files import opened, yaml_text
from checkweigher_dsp.denoising.denoiser import DenoiseParameters
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.rejection.parameters import LIMITS, RejectParameters
from checkweigher_production.filler_feedback import FillerParameters
from checkweigher_production.performance import PerformancePlan
from checkweigher_production.prepackages import LARGEST, MAX_SHARE_BELOW_TU1, SMALLEST, limits

# Nodes whose parameters a recipe may set.
NODES: dict[str, type[Parameters]] = {
    'denoise': DenoiseParameters,
    'identifier': IdentifierParameters,
    'reject': RejectParameters,
}
_OWN = (*LIMITS, 'needs_product')  # parameters of the reject node that a recipe must not set
_LARGEST_MASS = 1e4  # largest mass in a recipe, in kg
_LARGEST_ERROR = 0.1  # largest limit of a performance test, relative to the mass

Changes = dict[str, dict[str, object]]


@dataclass(frozen=True)
class Guard(Parameters):
    """Parameters of the guard band.

    The guard band narrows both limits by a multiple of the standard deviation of each mass.
    """

    node: ClassVar[str] = 'guard'

    risk: float = parameter(
        0.02,
        'largest probability that an item outside the limits is accepted',
        minimum=1e-9,
        maximum=0.5,
    )


@dataclass(frozen=True, eq=False)
class Product(NanEqual, Settings):
    """Recipe of one product. Masses are in kg.

    Raises `SettingsError` if a value is invalid or contradicts another value, for example if a
    limit is on the wrong side of the nominal quantity.
    """

    name: str = parameter(text='name by which the operator selects the product')
    nominal: float = parameter(
        text='nominal quantity of the contents (NominalWeight of OPC 40200)',
        unit='kg',
        minimum=0,
        maximum=_LARGEST_MASS,
    )
    tare: float = parameter(
        0.0, 'mass of the packaging', unit='kg', minimum=0, maximum=_LARGEST_MASS
    )
    lower_limit: float = parameter(
        -math.inf,
        'lower limit of the contents (LowerToleranceLimit), or TU1 or TU2 of 76/211/EEC',
        unit='kg',
        minimum=0,
        choices=('TU1', 'TU2'),
    )
    upper_limit: float = parameter(
        math.inf,
        'upper limit of the contents (UpperToleranceLimit)',
        unit='kg',
        maximum=_LARGEST_MASS,
    )
    # Limits TU1 and TU2 in kg. A limit that is missing in the recipe is taken from 76/211/EEC, or
    # is NaN if the directive has no limit for the nominal quantity. A batch record contains the
    # limits at the time at which the product was selected.
    tu1: float = parameter(
        math.nan, 'TU1, if it differs from the value of 76/211/EEC', unit='kg', minimum=0
    )
    tu2: float = parameter(
        math.nan, 'TU2, if it differs from the value of 76/211/EEC', unit='kg', minimum=0
    )
    length: tuple[float, float] = parameter(
        (0.0, math.inf), 'smallest and largest length', unit='m', minimum=0, maximum=1e3
    )
    speed: tuple[float, float] = parameter(
        (0.0, math.inf), 'smallest and largest belt speed', unit='m/s', minimum=0, maximum=1e3
    )
    reason: bool = parameter(False, 'whether a person at the page must give a reason for a change')
    parameters: Mapping[str, Any] = parameter(
        None, 'values of other parameters of the nodes, by node and name'
    )
    tu1_quota: float = parameter(
        math.nan,
        'fraction of the accepted items of a batch that may be below TU1; NaN for no such rule',
        minimum=0,
        maximum=MAX_SHARE_BELOW_TU1,
    )
    mean_value: bool = parameter(False, 'whether the mean of a batch must never be below nominal')
    filler: FillerParameters | None = parameter(None, 'feedback to the filler')
    test: PerformancePlan | None = parameter(None, 'performance test')
    guard: Guard | None = parameter(None, 'guard band at the limits')
    price: float = parameter(
        math.nan, 'price of the contents per kg, in any currency', minimum=0, maximum=1e9
    )
    release_by: int = parameter(
        1, 'number of persons who must have signed when a batch is released', minimum=1, maximum=2
    )

    def __post_init__(self) -> None:
        own = _parameters(self.parameters)
        if self.guard is not None:
            own.setdefault('reject', {})['guard_risk'] = self.guard.risk
        object.__setattr__(self, 'parameters', own)
        if self.nominal == 0:
            raise SettingsError('must be above 0', 'nominal')
        if SMALLEST <= self.nominal <= LARGEST:
            its = limits(self.nominal)
            for name, limit in (('tu1', its.tu1), ('tu2', its.tu2)):
                if math.isnan(getattr(self, name)):
                    object.__setattr__(self, name, limit)
        object.__setattr__(self, 'lower_limit', self._lower_limit())
        self._check_spans()
        if self.filler is not None:
            _check_filler(self.filler, self.nominal)
        if self.test is not None:
            _check_test(self.test, self.nominal + self.tare)

    def _check_spans(self) -> None:
        if self.lower_limit > self.nominal:
            text = f'{self.lower_limit:g} kg is above nominal, {self.nominal:g} kg'
            raise SettingsError(text, 'lower_limit')
        if self.upper_limit < self.nominal:
            text = f'{self.upper_limit:g} kg is below nominal, {self.nominal:g} kg'
            raise SettingsError(text, 'upper_limit')
        for name in ('length', 'speed'):
            smallest, largest = getattr(self, name)
            if not smallest < largest:
                raise SettingsError(
                    f'from {smallest:g} to {largest:g} nothing would be weighed; give the '
                    'smallest, then the largest',
                    name,
                )

    def _lower_limit(self) -> float:
        """Return the lower limit in kg, which may be given in a recipe as TU1 or TU2.

        With a quota, the lower limit is TU2. Raises `SettingsError` if a quota is given together
        with another lower limit, or if TU1 or TU2 is needed and the directive has no limits for the
        nominal quantity.
        """
        given: float | str = self.lower_limit
        if math.isfinite(self.tu1_quota):
            if math.isnan(self.tu1) or math.isnan(self.tu2):
                text = 'needs TU1 and TU2, which 76/211/EEC does not have for this nominal quantity'
                raise SettingsError(text, 'tu1_quota')
            # A batch record contains the value of TU2 in kg instead of the text 'TU2'.
            mass = self.tu2 if given == 'TU2' else given
            if isinstance(mass, str) or not (mass == -math.inf or math.isclose(mass, self.tu2)):
                raise SettingsError(
                    'the quota is for items from TU2 to TU1, so lower_limit must be TU2, not '
                    f'{given}',
                    'tu1_quota',
                )
            return self.tu2
        if not isinstance(given, str):
            return given
        limit = self.tu1 if given == 'TU1' else self.tu2
        if math.isnan(limit):
            raise SettingsError(
                f'76/211/EEC has no {given} for a nominal weight of {self.nominal:g} kg, only for '
                f'{SMALLEST:g}..{LARGEST:g} kg',
                'lower_limit',
            )
        return limit

    def limits(self) -> dict[str, object]:
        """Return the limits of the product by parameter name of the reject node.

        The mass limits apply to contents with packaging, in kg. The limits of length are in m, and
        the limits of speed in m/s. TU1 is 0 if the recipe has no quota.
        """
        quota = math.isfinite(self.tu1_quota)
        return {
            'lower_limit': self.tare + self.lower_limit,
            'upper_limit': self.tare + self.upper_limit,
            'min_length': self.length[0],
            'max_length': self.length[1],
            'min_speed': self.speed[0],
            'max_speed': self.speed[1],
            'nominal': self.tare + self.nominal,
            'tu1': self.tare + self.tu1 if quota else 0.0,
            'tu1_quota': self.tu1_quota if quota else MAX_SHARE_BELOW_TU1,
            'mean_value': self.mean_value,
        }

    def stage_values(self) -> dict[str, object]:
        """Return all parameters and limits of the recipe. The keys have the form ``node.name``."""
        return flatten(self.parameters) | flatten({'reject': self.limits()})

    def unresolved(self, std_dev: float) -> str:
        """Return the reason why a scale cannot resolve the tolerances of the recipe, or ''.

        `std_dev` is the stated standard deviation of a mass in kg. If `std_dev` is NaN, the result
        is ''. Twice `std_dev` may be at most a fifth of the tolerable negative error, as German
        FPackV (Annex 7, 1 b) requires of the error of a scale. Three times `std_dev`, or the guard
        band if it is wider, may be at most the distance of the nearer limit from nominal. If there
        is no tolerable negative error, only the distance of the limits is checked.
        """
        fifth = (self.nominal - self.tu1) / 5
        if 2 * std_dev > fifth:
            return (
                f'twice the stated deviation, {2 * GRAMS * std_dev:.2f} g, is above a fifth of the '
                f'tolerable negative error, {GRAMS * fifth:.2f} g'
            )
        band = std_dev * max(3.0, -NormalDist().inv_cdf(self.guard.risk) if self.guard else 0.0)
        distance = min(self.nominal - self.lower_limit, self.upper_limit - self.nominal)
        if band > distance:
            return (
                f'the stated deviation, {GRAMS * std_dev:.2f} g, is too large for limits '
                f'{GRAMS * distance:.2f} g from nominal'
            )
        return ''

    def on_line(self, batch: str) -> ProductOnLine:
        """Return the product, its limits and its batch as the message for the reject node.

        The stamp of the message is 0.
        """
        limits: dict[str, Any] = self.limits()
        return ProductOnLine(0, self.name, batch, needed=True, **limits)


@dataclass(frozen=True)
class RecipeFile(Settings):
    """Content of a recipe file."""

    products: Mapping[str, Product] = parameter(text='recipes, by product name')


def read_recipes(path: Path) -> dict[str, Product]:
    """Return the products of a recipe file by name.

    Raises `SettingsError` if the file cannot be read or a recipe is not valid.
    """
    return dict(read_settings(path, RecipeFile).products)


def given_recipes(path: Path) -> dict[str, dict[str, Any]]:
    """Return the keys and values of each recipe in a recipe file, by product name.

    Values that a recipe leaves out are not added. Raises `SettingsError` if the file cannot be read
    or a recipe is not valid.
    """
    return {name: dict(keys) for name, keys in _content(path)['products'].items()}


def change_recipe(path: Path, name: str, keys: Mapping[str, Any] | None) -> None:
    """Add a product to a recipe file, replace its recipe, or remove it if `keys` is None.

    Comments in the file are lost. Raises `SettingsError` if a recipe is not valid, or if the
    product to remove does not exist or is the only one, and `OutputError` if the file cannot be
    written. If an exception is raised, the file is unchanged.
    """
    with _locked(path):
        content = _content(path)
        products = content['products']
        if keys is not None:
            settings_of(Product, dict(keys), name)
            products[name] = dict(keys)
        elif name not in products:
            raise SettingsError(f'there is no recipe {name!r}')
        elif len(products) == 1:
            raise SettingsError(f'{name!r} is the only recipe; add another recipe first')
        else:
            del products[name]
        settings_of(RecipeFile, content)
        write_whole(path, yaml_text(content))


def replace_recipes(path: Path, text: str) -> None:
    """Replace the content of a recipe file by a text, which may contain comments.

    Raises `SettingsError` if a recipe is not valid, and `OutputError` if the file cannot be
    written. If an exception is raised, the file is unchanged.
    """
    read_settings(text, RecipeFile)
    with _locked(path):
        write_whole(path, text)


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    try:
        with changing(path):
            yield
    except OSError as error:
        raise output_error(path, error) from None


def _content(path: Path) -> dict[str, Any]:
    with opened(path) as content:
        settings_of(RecipeFile, content)
    return dict(content)


def product_of(values: Mapping[str, Any]) -> Product:
    """Return the product in a line of a batch record.

    `values` contains the values of the line. Raises `SettingsError` if the product is not valid.
    """
    return settings_of(Product, values, values.get('name'), newer=True)


# The checks of the filler and of the test have wide bounds, which only detect masses that were
# given in g instead of kg.
def _check_filler(filler: FillerParameters, nominal: float) -> None:
    if filler.target and not _is_near(filler.target, nominal):
        raise SettingsError(
            f'{filler.target:g} kg differs by more than half from nominal, {nominal:g} kg',
            'filler',
            'target',
        )
    for name in ('dead_band', 'max_step', 'max_correction'):
        if nominal < (value := getattr(filler, name)) < math.inf:
            raise SettingsError(f'{value:g} kg is above nominal, {nominal:g} kg', 'filler', name)


def _check_test(test: PerformancePlan, gross: float) -> None:
    if not _is_near(test.mass, gross):
        raise SettingsError(
            f'{test.mass:g} kg differs by more than half from nominal plus tare, {gross:g} kg',
            'test',
            'mass',
        )
    if test.limit >= test.mass * _LARGEST_ERROR:
        raise SettingsError(
            f'{test.limit:g} kg is not below a tenth of the mass, {test.mass:g} kg', 'test', 'limit'
        )


def _is_near(mass: float, nominal: float) -> bool:
    return abs(mass - nominal) <= nominal / 2


def _parameters(given: Mapping[str, Any] | None) -> Changes:
    """Return the parameters by node and name, with checked values.

    Combinations of values are not checked. Raises `SettingsError` if a recipe must not set a
    parameter, if there is no such node or parameter, or if a value is invalid.
    """
    made: Changes = {}
    for node, section in (given or {}).items():
        if node not in NODES:
            raise SettingsError(
                f'no recipe may set parameters of this node, only of {", ".join(NODES)}',
                'parameters',
                node,
            )
        if not isinstance(section, dict):
            raise SettingsError(
                f'{section!r} is not a mapping; write "name: value" lines', 'parameters', node
            )
        known, made[node] = NODES[node].entries(), {}
        for name, each in flatten(section).items():
            place = 'parameters', node, *name.split('.')
            if node == 'reject' and name in _OWN:
                raise SettingsError(
                    'must not be set here; give limits, length and speed beside nominal', *place
                )
            if name not in known:
                raise SettingsError(f'{node} has no such parameter', *place)
            try:
                made[node][name] = check(name, known[name], each)
            except ParameterError as error:
                raise SettingsError(str(error).partition(': ')[2], *place) from None
    return made
