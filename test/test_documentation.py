"""docs/interfaces.md, README.md and config/line.yaml against the code."""

from dataclasses import fields
import math
import re
from typing import Any

import pytest
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from running import ROOT
import yaml

from checkweigher_bringup.cli import COMMANDS
from checkweigher_bringup.commissioning.dynamic_setting import DynamicSettingParameters
from checkweigher_driver.calibration.session import CalibrationParameters
from checkweigher_driver.devices import (
    EYES,
    NONE,
    SOURCES,
    DriverParameters,
    eyes_class,
    source_class,
)
from checkweigher_driver.line_io.gpio import GpioOutputParameters
from checkweigher_driver.line_io.modbus import ModbusOutputParameters
from checkweigher_driver.line_io.rejector_control import OutputParameters
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.estimators.base import EstimatorParameters
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.nodes.product import ProductParameters
from checkweigher_dsp.parameters import Parameters, describe
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.production import audit_trail
from checkweigher_dsp.production.audit_log import TORN
from checkweigher_dsp.production.recipes import Product, read_recipes
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.ros import ports

INTERFACES = ROOT / 'docs/interfaces.md'

SETS: dict[str, tuple[str, type[Parameters]]] = {
    **{entry.name: ('', entry.type) for entry in fields(LineParameters)},
    'product': ('', ProductParameters),
    'dynamic_setting, commissioning': ('', DynamicSettingParameters),
    'driver': ('', DriverParameters),
    **{f'driver, source {name}': (f'{name}.', source_class(name).parameters) for name in SOURCES},
    **{
        f'driver, photo-eyes {name}': (f'{name}.', eyes_class(name).parameters)
        for name in EYES
        if name != NONE
    },
    **{
        f'driver, {title}': (f'{parameters.node}.', parameters)
        for title, parameters in (
            ('calibration', CalibrationParameters),
            ('rejector', OutputParameters),
            ('outputs modbus', ModbusOutputParameters),
            ('outputs gpio', GpioOutputParameters),
        )
    },
    'identifier, every estimator': ('NAME.', EstimatorParameters),
    **{
        f'identifier, estimator {name}': (f'{name}.', type(getattr(IdentifierParameters(), name)))
        for name in ESTIMATORS
        if name not in ('mean', 'hann')  # which have nothing of their own
    },
}


def own_entries(parameters: type[Parameters]) -> dict[str, Any]:
    """Return the parameters of a set without those of its inner sets and of all estimators."""
    common = set(EstimatorParameters.entries()) if parameters is not EstimatorParameters else set()
    of_estimator = issubclass(parameters, EstimatorParameters)
    return {
        name: entry
        for name, entry in parameters.entries().items()
        if '.' not in name and not (of_estimator and name in common)
    }


def plain(value: object) -> str:
    if isinstance(value, tuple):
        return '[' + ', '.join(map(plain, value)) + ']'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value or "''"
    return f'{value:g}' if isinstance(value, float) else str(value)


def kind(value: object) -> str:
    if isinstance(value, tuple):
        return 'double[]'
    return {bool: 'bool', int: 'int', float: 'double', str: 'string'}[type(value)]


def parameter_rows(prefix: str, parameters: type[Parameters]) -> list[str]:
    """Return the rows that the table of a parameter set must have."""
    rows = []
    for entry in own_entries(parameters).values():
        allowed = describe(entry)
        bounds = f'{allowed.minimum:g}..{allowed.maximum:g}'
        span = ', '.join(allowed.choices) or ('' if bounds == '-inf..inf' else bounds)
        cells = (
            f'`{prefix}{entry.name}`', kind(entry.default), plain(entry.default), allowed.unit,
            span, allowed.text,
        )  # fmt: skip
        rows.append('| ' + ' | '.join(cells) + ' |')
    return rows


def topic_rows() -> list[str]:
    """Return the rows that the table of topics must have, up to their description."""
    rows = []
    for topic in ports.ALL:
        assert topic.qos.reliability == ReliabilityPolicy.RELIABLE
        kept = topic.qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        durability = 'transient local' if kept else 'volatile'
        rows.append(
            f'| `{topic.name}` | {topic.type.__name__} | reliable, {durability}, '
            f'{topic.qos.depth} |'
        )
    return rows


def section(title: str) -> str:
    """Return a section of the document."""
    found = re.search(
        rf'^### {re.escape(title)}\n(.*?)(?=^##|\Z)', INTERFACES.read_text(), re.M | re.S
    )
    assert found, f'{INTERFACES} has no section {title}'
    return found.group(1)


@pytest.mark.parametrize('name', SETS)
def test_every_parameter_is_documented_as_it_is(name: str):
    prefix, parameters = SETS[name]
    rows = [line for line in section(name).splitlines() if line.startswith('| `')]
    assert rows == parameter_rows(prefix, parameters)


@pytest.mark.parametrize('row', topic_rows())
def test_every_topic_is_documented_as_it_is(row: str):
    assert row in INTERFACES.read_text()


def test_every_message_is_documented():
    text = INTERFACES.read_text()
    for path in (ROOT / 'src/checkweigher_msgs/msg').glob('*.msg'):
        assert f'`{path.stem}`' in text, path.stem


def test_every_service_is_documented():
    text = INTERFACES.read_text()
    for path in (ROOT / 'src/checkweigher_msgs/srv').glob('*.srv'):
        assert f'| {path.stem} |' in text, path.stem


def test_every_key_of_a_recipe_and_every_kind_of_audit_entry_is_documented():
    text = INTERFACES.read_text()
    kinds = [value for name, value in vars(audit_trail).items() if name.isupper()]
    for name in (*Product('any', 1.0).as_mapping(), *kinds, TORN):
        assert f'`{name}`' in text, name


def test_the_recipes_to_begin_with_can_be_read():
    products = read_recipes(ROOT / 'src/checkweigher_bringup/config/recipes.yaml')
    assert products['crisps_150g'].lower_limit == pytest.approx(0.14325, rel=1e-12)


@pytest.mark.parametrize('reason', Reason)
def test_every_reason_is_documented_with_its_hint(reason: Reason):
    assert f'| `{reason.value}` | {reason.hint} |' in INTERFACES.read_text()


def test_the_parameter_file_says_the_defaults():
    content = yaml.safe_load((ROOT / 'src/checkweigher_bringup/config/line.yaml').read_text())
    sets = {name: parameters for name, (_, parameters) in SETS.items() if ',' not in name}
    assert set(content) == {f'/**/{name}' for name in sets}
    for name, parameters in sets.items():
        defaults = {
            entry.name: list(entry.default) if isinstance(entry.default, tuple) else entry.default
            for entry in own_entries(parameters).values()
        }
        given = content[f'/**/{name}']['ros__parameters']
        assert given == defaults
        for value in given.values():
            assert not (isinstance(value, float) and math.isnan(value))


@pytest.mark.parametrize('command', [name for name, *_ in COMMANDS])
def test_the_readme_or_the_contributing_guide_shows_every_command(command: str):
    text = (ROOT / 'README.md').read_text() + (ROOT / 'bags/README.md').read_text()
    assert re.search(rf'checkweigher {command}\b|`{command}`', text), command


@pytest.mark.parametrize(
    'path',
    [
        'README.md',
        'CONTRIBUTING.md',
        *(f'docs/{n}.md' for n in ('method', 'accuracy', 'hardware', 'hardware_io')),
    ],
)
def test_files_that_the_docs_name_are_there(path: str):
    base = (ROOT / path).parent
    for target in re.findall(r'\]\(([^)#:]+)\)', (ROOT / path).read_text()):
        assert (base / target).exists(), f'{path} links to {target}'
