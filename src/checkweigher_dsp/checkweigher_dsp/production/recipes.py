# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Recipes: masses, limits and parameters of each product, in one YAML file.

    products:
      crisps_150g:
        nominal: 0.150            # kg, contents
        tare: 0.004               # kg, of the packaging
        lower_limit: TU1          # kg of contents, or TU1 or TU2 of directive 76/211/EEC
        upper_limit: 0.165        # kg of contents
        length: [0.09, 0.12]      # m, shortest and longest
        speed: [0.5, 1.5]         # m/s, slowest and fastest
        tu1_quota: 0.025          # share of the batch that may be between TU2 and TU1
        mean_value: true          # the mean of the batch is never below nominal
        filler: {max_correction: 0.004, dead_band: 0.0002, delay: 6}  # feedback to the filler
        test: {mass: 0.1502, limit: 0.0005, every_hours: 8}  # performance test
        reason: true              # a person at the page has to say why something is changed
        parameters:               # of the nodes, as in a parameter file
          identifier:
            estimator: gauss_markov

All masses of a product are those of its contents. The scale weighs contents and packaging, so the
limits that the reject node gets are tare + limit.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
import math
from pathlib import Path
from typing import Any, TypeVar, cast

from checkweigher_dsp.denoising.denoiser import DenoiseParameters
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.parameters import ParameterError, Parameters, check, flatten
from checkweigher_dsp.printable import one_line
from checkweigher_dsp.production.filler_feedback import FillerParameters
from checkweigher_dsp.production.performance_test import PerformancePlan
from checkweigher_dsp.production.prepackages import LARGEST, MAX_SHARE_BELOW_TU1, SMALLEST, limits
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.yaml_files import read_yaml_as

# Nodes whose parameters may change while the line runs.
NODES: dict[str, type[Parameters]] = {
    'denoise': DenoiseParameters,
    'identifier': IdentifierParameters,
    'reject': RejectParameters,
}
_READ_ONLY = ('segmenter', 'driver')
_LIMITS = ('lower_limit', 'upper_limit')
_RANGES = ('min_length', 'max_length', 'min_speed', 'max_speed')
_RULES = ('nominal', 'tu1', 'tu1_quota', 'mean_value', 'batch', 'batch_counts')
# Of reject, not for `parameters`.
_OWN = (*_LIMITS, *_RANGES, *_RULES, 'product', 'needs_product', 'performance_test')
_KEYS = (
    'nominal', 'tare', *_LIMITS, 'length', 'speed', 'tu1_quota', 'mean_value', 'filler',
    'test', 'reason', 'parameters',
)  # fmt: skip
_LARGEST_MASS = 1e4  # kg
_NO_MORE = 1e3  # m and m/s
_LARGEST_ERROR = 0.1  # share of the mass of a test product

Changes = dict[str, dict[str, object]]
_Inner = TypeVar('_Inner', bound=Parameters)


class RecipeError(ValueError):
    """A recipe that cannot be used; one line that names product, key, value and what is allowed."""


@dataclass(frozen=True)
class Product:
    """Recipe of one product; masses are of the contents."""

    name: str  # by which the operator selects it
    nominal: float  # kg, NominalWeight of OPC 40200
    tare: float = 0.0  # kg, of the packaging
    lower_limit: float = -math.inf  # kg, LowerToleranceLimit
    upper_limit: float = math.inf  # kg, UpperToleranceLimit
    tu1: float = math.nan  # kg, of 76/211/EEC; NaN where it has none for this nominal weight
    tu2: float = math.nan
    length: tuple[float, float] = (0.0, math.inf)  # m, smallest and largest
    speed: tuple[float, float] = (0.0, math.inf)  # m/s, smallest and largest
    reason: bool = False  # a person at the page has to say why something is changed
    parameters: Changes = field(default_factory=dict)  # further ones
    tu1_quota: float = math.nan  # share of a batch that may be below TU1; NaN for no such rule
    mean_value: bool = False  # whether the mean of a batch must never be below nominal
    filler: FillerParameters | None = None
    test: PerformancePlan | None = None

    def changes(self) -> Changes:
        """Return the parameters that the product sets, by node and name."""
        made = {node: dict(values) for node, values in self.parameters.items()}
        made.setdefault('reject', {}).update(
            lower_limit=self.tare + self.lower_limit,
            upper_limit=self.tare + self.upper_limit,
            min_length=self.length[0],
            max_length=self.length[1],
            min_speed=self.speed[0],
            max_speed=self.speed[1],
            nominal=self.tare + self.nominal,
            mean_value=self.mean_value,
            product=self.name,
            performance_test=False,
        )
        quota = math.isfinite(self.tu1_quota)
        made['reject'].update(
            tu1=self.tare + self.tu1 if quota else 0.0,
            tu1_quota=self.tu1_quota if quota else MAX_SHARE_BELOW_TU1,
        )
        return made

    def as_mapping(self) -> dict[str, object]:
        """Return the recipe as it would stand in the file, limits as masses."""
        made = {name: getattr(self, name) for name in _KEYS}
        inner = {'filler': self.filler, 'test': self.test}
        return made | {key: asdict(each) if each else None for key, each in inner.items()}


def read_recipes(path: Path) -> dict[str, Product]:
    """Read all products of a recipe file; `RecipeError` if a part of it cannot be used."""
    content = read_yaml_as(path, RecipeError, 'a recipe file')
    if not isinstance(content, dict) or list(content) != ['products']:
        raise RecipeError(f'{path}: not a recipe file: it must have the one section "products:"')
    products = content['products']
    if not isinstance(products, dict) or not products:
        raise RecipeError(f'{path}: products: names no product')
    try:
        return {name: make_product(name, values) for name, values in products.items()}
    except RecipeError as error:
        raise RecipeError(f'{path}: {error}') from None


def product_of(values: Mapping[str, Any]) -> Product:
    """Return the product whose fields are in a mapping, as `asdict` and JSON made it."""
    unknown = {n for n, value in values.items() if isinstance(value, float) and math.isnan(value)}
    own = {**values, **dict.fromkeys(unknown, math.nan)}  # one NaN: products are compared
    filler, test = own.pop('filler'), own.pop('test', None)  # records of before have no test
    return Product(
        length=tuple(own.pop('length')), speed=tuple(own.pop('speed')),
        parameters=_parameters('parameters', own.pop('parameters')),
        filler=filler and FillerParameters.from_mapping(filler),
        test=test and PerformancePlan.from_mapping(test), **own,
    )  # fmt: skip


def make_product(name: object, values: object) -> Product:
    """Return the product of a recipe; `RecipeError` names the first bad key."""
    if not isinstance(name, str) or not name.strip() or not name.isprintable():
        raise RecipeError(f'{one_line(ascii(name))} is no name of a product; put it in quotes')
    if not isinstance(values, dict):
        raise RecipeError(f'{name}: has no recipe')
    for key in values:
        if key not in _KEYS:
            raise RecipeError(f'{name}.{key}: no such key; a recipe has {", ".join(_KEYS)}')
    if 'nominal' not in values:
        raise RecipeError(f'{name}.nominal: is missing')
    nominal = _number(f'{name}.nominal', values['nominal'], 0, _LARGEST_MASS, 'kg')
    if nominal == 0:
        raise RecipeError(f'{name}.nominal: must be above 0')
    tu1 = tu2 = math.nan
    if SMALLEST <= nominal <= LARGEST:
        its = limits(nominal)
        tu1, tu2 = its.tu1, its.tu2
    lower, upper = values.get('lower_limit'), values.get('upper_limit')
    quota = _quota(name, values.get('tu1_quota'), lower, tu1)
    if math.isfinite(quota) and lower is None:
        lower = 'TU2'
    if upper is not None:
        upper = _number(f'{name}.upper_limit', upper, nominal, _LARGEST_MASS, 'kg')
    tare = _number(f'{name}.tare', values.get('tare', 0.0), 0, _LARGEST_MASS, 'kg')
    filler = _inner(f'{name}.filler', FillerParameters, values.get('filler'))
    if filler is not None:
        _check_filler(f'{name}.filler', filler, nominal)
    test = _inner(f'{name}.test', PerformancePlan, values.get('test'))
    if test is not None:
        _check_test(f'{name}.test', test, nominal + tare)
    return Product(
        name=name,
        nominal=nominal,
        tare=tare,
        lower_limit=_lower_limit(f'{name}.lower_limit', lower, nominal, tu1, tu2),
        upper_limit=math.inf if upper is None else upper,
        tu1=tu1,
        tu2=tu2,
        length=_range(f'{name}.length', values.get('length'), 'm'),
        speed=_range(f'{name}.speed', values.get('speed'), 'm/s'),
        reason=_truth(f'{name}.reason', values.get('reason', False)),
        parameters=_parameters(f'{name}.parameters', values.get('parameters')),
        tu1_quota=quota,
        mean_value=_truth(f'{name}.mean_value', values.get('mean_value', False)),
        filler=filler,
        test=test,
    )


# A mass in grams, where kg belong, is a thousand times too large: these bounds find it, and are far
# beyond what a product could need.
def _check_filler(key: str, filler: FillerParameters, nominal: float) -> None:
    if filler.target and not _is_near(filler.target, nominal):
        raise RecipeError(
            f'{key}.target: {filler.target:g} kg is more than half off nominal, {nominal:g} kg'
        )
    for name in ('dead_band', 'max_step', 'max_correction'):
        if nominal < (value := getattr(filler, name)) < math.inf:
            raise RecipeError(f'{key}.{name}: {value:g} kg is above nominal, {nominal:g} kg')


def _check_test(key: str, test: PerformancePlan, gross: float) -> None:
    if not _is_near(test.mass, gross):
        raise RecipeError(
            f'{key}.mass: {test.mass:g} kg is more than half off nominal and tare, {gross:g} kg'
        )
    if test.limit >= test.mass * _LARGEST_ERROR:
        raise RecipeError(
            f'{key}.limit: {test.limit:g} kg is not below a tenth of the mass, {test.mass:g} kg'
        )


def _is_near(mass: float, nominal: float) -> bool:
    return abs(mass - nominal) <= nominal / 2


def _quota(name: str, value: object, lower: object, tu1: float) -> float:
    """Return the share of a batch that may be below TU1, NaN for no such rule."""
    if value is None:
        return math.nan
    if math.isnan(tu1):
        raise RecipeError(f'{name}.tu1_quota: 76/211/EEC has no TU1 for this nominal weight')
    if lower not in (None, 'TU2'):
        why = 'items from TU2 to TU1 are what it is about, so lower_limit must be TU2'
        raise RecipeError(f'{name}.tu1_quota: {why}, not {lower}')
    return _number(f'{name}.tu1_quota', value, 0, MAX_SHARE_BELOW_TU1, 'of the batch')


def _truth(key: str, value: object) -> bool:
    if not isinstance(value, bool):
        raise RecipeError(f'{key}: {value!r} is not true or false')
    return value


def _inner(key: str, kind: type[_Inner], value: object) -> _Inner | None:
    """Return a set of parameters inside a recipe, None without one."""
    if value is None:
        return None
    if not isinstance(value, dict):
        raise RecipeError(f'{key}: {value!r} is not "name: value"')
    try:
        return kind.from_mapping(value)
    except ParameterError as error:
        raise RecipeError(f'{key.rpartition(".")[0]}.{error}') from None


def _lower_limit(key: str, value: object, nominal: float, tu1: float, tu2: float) -> float:
    if value is None:
        return -math.inf
    if value not in ('TU1', 'TU2'):
        return _number(key, value, 0, nominal, 'kg (or TU1 or TU2 of 76/211/EEC)')
    if math.isnan(tu1):
        why = f'76/211/EEC has no {value} for a nominal weight of {nominal:g} kg'
        raise RecipeError(f'{key}: {why}, only for {SMALLEST:g}..{LARGEST:g} kg')
    return tu1 if value == 'TU1' else tu2


def _number(key: str, value: object, minimum: float, maximum: float, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise RecipeError(f'{key}: {value!r} is not a number')
    if not minimum <= value <= maximum:  # NaN is not
        raise RecipeError(f'{key}: {value} is not in {minimum:g}..{maximum:g} {unit}')
    return float(value)


def _range(key: str, value: object, unit: str) -> tuple[float, float]:
    if value is None:
        return (0.0, math.inf)
    if not isinstance(value, list) or len(value) != 2:
        raise RecipeError(f'{key}: {value!r} is not [smallest, largest] in {unit}')
    smallest = _number(key, value[0], 0, _NO_MORE, unit)
    largest = _number(key, value[1], smallest, _NO_MORE, unit)
    if smallest == largest:
        text = f'from {smallest:g} to {largest:g} {unit} nothing would be weighed'
        raise RecipeError(f'{key}: {text}')
    return (smallest, largest)


def _parameters(key: str, value: object) -> Changes:
    """Return the parameters by node; only the nodes can check them together."""
    if value is None:
        return {}
    if not isinstance(value, dict):
        raise RecipeError(f'{key}: {value!r} is not "node: name: value"')
    made: Changes = {}
    for node, section in value.items():
        if node in _READ_ONLY:
            raise RecipeError(f'{key}.{node}: its parameters cannot be changed while it runs')
        if node not in NODES:
            raise RecipeError(f'{key}.{node}: no such node; a recipe may set {", ".join(NODES)}')
        if not isinstance(section, dict):
            raise RecipeError(f'{key}.{node}: {section!r} is not "name: value"')
        known = NODES[node].entries()
        made[node] = {}
        for name, each in flatten(cast(Mapping[str, object], section)).items():
            if node == 'reject' and name in _OWN:
                why = 'no recipe sets it here; limits, length and speed stand beside nominal'
                raise RecipeError(f'{key}.reject.{name}: {why}')
            if name not in known:
                raise RecipeError(f'{key}.{node}.{name}: {node} has no such parameter')
            try:
                made[node][name] = check(f'{key}.{node}.{name}', known[name], each)
            except ParameterError as error:
                raise RecipeError(str(error)) from None
    return made
