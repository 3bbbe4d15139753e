# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of the docs, and the parameter file line.yaml: `make docs`.

A table stands between `<!-- make docs: NAME -->` and `<!-- end -->`. In line.yaml the lines with
parameters are written; comment lines of their own stay before the parameter that they precede.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import Field, fields
from pathlib import Path
import re
import textwrap
from typing import Any

import yaml

from checkweigher_bringup.commissioning.dynamic_setting import DynamicSettingParameters
from checkweigher_bringup.commissioning.verifier import VerifierParameters
from checkweigher_core.parameters import Description, Parameters, describe
from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_core.ros import ports
from checkweigher_core.ros.services import ACTIONS, SERVICES, Service
from checkweigher_driver.calibration.session import CalibrationParameters
from checkweigher_driver.devices import (
    EYES,
    NONE,
    SOURCES,
    DriverParameters,
    eyes_class,
    source_class,
)
from checkweigher_driver.line_io.gpio import GpioInputParameters, GpioOutputParameters
from checkweigher_driver.line_io.modbus import ModbusInputParameters, ModbusOutputParameters
from checkweigher_driver.line_io.rejector_control import OutputParameters
from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.estimation.estimators.base import EstimatorParameters
from checkweigher_dsp.estimation.learning.learner import LearningParameters
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_production.nodes.product import ProductParameters
from checkweigher_recording.simulation.operation import OperationParameters

ROOT = Path(__file__).resolve().parent.parent
MESSAGES = ROOT / 'src/checkweigher_msgs/msg'
PAGES = tuple(ROOT / f'docs/{name}.md' for name in ('topics', 'services', 'reasons', 'parameters'))
PARAMETER_FILE = ROOT / 'src/checkweigher_bringup/config/line.yaml'
COMMENT_COLUMN = 32  # of line.yaml
LINE_LENGTH = 100

# The nodes of the parameter file.
NODES: dict[str, type[Parameters]] = {
    'driver': DriverParameters,
    **{entry.name: entry.type for entry in fields(LineParameters)},
    'product': ProductParameters,
}
# The parameter sets by the title of their section, each with what its names begin with.
SETS: dict[str, tuple[str, type[Parameters]]] = {
    **{node: ('', parameters) for node, parameters in NODES.items()},
    'dynamic_setting, commissioning': ('', DynamicSettingParameters),
    'verifier, commissioning': ('', VerifierParameters),
    **{f'driver, source {name}': (f'{name}.', source_class(name).parameters) for name in SOURCES},
    'driver, simulator while it runs': ('simulator.now.', OperationParameters),
    **{
        f'driver, photo-eyes {name}': (f'{name}.', eyes_class(name).parameters)
        for name in EYES
        if name != NONE
    },
    'driver, calibration': ('calibration.', CalibrationParameters),
    'driver, rejector': ('rejector.', OutputParameters),
    'driver, outputs modbus': ('modbus_outputs.', ModbusOutputParameters),
    'driver, outputs gpio': ('gpio_outputs.', GpioOutputParameters),
    'driver, inputs modbus': ('modbus_inputs.', ModbusInputParameters),
    'driver, inputs gpio': ('gpio_inputs.', GpioInputParameters),
    'identifier, learning': ('learning.', LearningParameters),
    'identifier, every estimator': ('NAME.', EstimatorParameters),
}


def own_entries(parameters: type[Parameters]) -> list['Field[Any]']:
    """Return the parameters of a set without those of its inner sets and of all estimators."""
    common = set(EstimatorParameters.entries()) if parameters is not EstimatorParameters else set()
    of_estimator = issubclass(parameters, EstimatorParameters)
    return [
        entry
        for name, entry in parameters.entries().items()
        if '.' not in name and not (of_estimator and name in common)
    ]


def table(header: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table of Markdown."""
    lines = [f'| {" | ".join(cells)} |' for cells in (header, *rows)]
    lines.insert(1, '|' + '---|' * len(tuple(header)))
    return '\n'.join(re.sub(' {2,}\\|$', ' |', line) for line in lines) + '\n'


def topics() -> str:
    """Return the table of topics with what they are for."""
    header = ('topic', 'type', 'QoS: reliability, durability, depth', 'from, to and what for')
    return table(
        header,
        (
            (
                f'`{port.name}`', port.message_type.rpartition('/')[2], ', '.join(qos(port)),
                f'{port.maker} -> {", ".join(port.takers)}. {port.text}',
            )
            for port in ports.ALL
        ),
    )  # fmt: skip


def qos(port: ports.Port) -> tuple[str, str, str]:
    """Return reliability, durability and depth of a port's publisher."""
    durability = 'transient local' if port.history.latched else 'volatile'
    if port.holds:
        deadline = 1e-9 * port.qos.deadline.nanoseconds
        durability += f', deadline {deadline:.2f} s, lifespan {port.holds:g} s'
        durability += f', liveliness automatic {deadline:.2f} s'
    return 'reliable', durability, str(port.history.depth)


def services() -> str:
    """Return the table of services."""
    return table(('service', 'type', 'of', ''), map(service_row, SERVICES))


def actions() -> str:
    """Return the table of actions."""
    rows = ((f'`{a.name}`', a.kind.rpartition('/')[2], a.server, a.text) for a in ACTIONS)
    return table(('action', 'type', 'of', ''), rows)


def service_row(service: Service) -> tuple[str, str, str, str]:
    """Return the cells of a service."""
    package, _, kind = service.kind.partition('/srv/')
    kind = kind if package == 'checkweigher_msgs' else service.kind
    where = f'{service.server}, with {service.condition}' if service.condition else service.server
    return f'`{service.name}`', kind, where, service.text


def messages() -> str:
    """Return the table of messages with the first sentence of each definition."""
    return table(('message', ''), ((f'`{p.stem}`', purpose(p)) for p in sorted(MESSAGES.iterdir())))


def purpose(definition: Path) -> str:
    """Return the first sentence of the comment that a definition begins with."""
    paragraphs = definition.read_text(encoding='utf-8').split('\n\n')
    comment = next(part for part in paragraphs if 'SPDX' not in part)
    text = ' '.join(line.strip('# ') for line in comment.splitlines() if line.startswith('#'))
    return re.split(r'(?<=\.) ', text)[0].rstrip('.')


def reasons(kind: Iterable[Reason | StopReason]) -> str:
    """Return the table of the reasons of a fault, or of a stop request."""
    return table(('reason', 'what to look at'), ((f'`{each}`', each.hint) for each in kind))


def parameter_table(prefix: str, parameters: type[Parameters]) -> str:
    """Return the table of a parameter set."""
    return table(
        ('parameter', 'type', 'default', 'unit', 'allowed', ''),
        (
            (
                f'`{prefix}{entry.name}`', kind(entry.default), plain(entry.default),
                describe(entry).unit, allowed(describe(entry)), describe(entry).text,
            )
            for entry in own_entries(parameters)
        ),
    )  # fmt: skip


def estimators() -> str:
    """Return a section for each estimator that has parameters of its own."""
    return '\n'.join(
        f'## identifier, estimator {name}\n\n{parameter_table(f"{name}.", type(each.parameters))}'
        for name, each in ESTIMATORS.items()
        if own_entries(type(each.parameters))
    )


def kind(value: object) -> str:
    """Return the type of a parameter as ROS names it."""
    if isinstance(value, tuple):
        return 'double[]'
    return {bool: 'bool', int: 'int', float: 'double', str: 'string'}[type(value)]


def plain(value: object) -> str:
    """Return a value for a reader."""
    if isinstance(value, tuple):
        return '[' + ', '.join(map(plain, value)) + ']'
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return value or "''"
    return f'{value:g}' if isinstance(value, float) else str(value)


def allowed(description: Description) -> str:
    """Return the choices or the range of a parameter, empty for any value."""
    span = f'{description.minimum:g}..{description.maximum:g}'
    return ', '.join(description.choices) or ('' if span == '-inf..inf' else span)


TABLES: dict[str, Callable[[], str]] = {
    'topics': topics,
    'actions': actions,
    'services': services,
    'messages': messages,
    'reasons': lambda: reasons(Reason),
    'stop reasons': lambda: reasons(StopReason),
    'estimators': estimators,
    **{
        f'parameters of {title}': lambda each=each: parameter_table(*each)
        for title, each in SETS.items()
    },
}


def with_tables(text: str) -> str:
    """Return a page with its tables as they should be."""
    return re.sub(
        '(<!-- make docs: (.*?) -->\n).*?(<!-- end -->)',
        lambda found: found[1] + TABLES[found[2]]() + found[3],
        text,
        flags=re.DOTALL,
    )


def parameter_file(text: str) -> str:
    """Return the parameter file as it should be, with the comment lines of `text`."""
    comments = kept_comments(text)
    lines = comments.pop('', [])
    for node, parameters in NODES.items():
        lines += ['', *comments.pop(node, []), f'/**/{node}:', '  ros__parameters:']
        for entry in own_entries(parameters):
            lines += comments.pop(f'{node}.{entry.name}', [])
            lines += parameter_lines(entry)
        lines += comments.pop(f'{node}.', [])
    assert not comments, f'{PARAMETER_FILE}: comments before parameters that are gone: {comments}'
    return '\n'.join(lines).lstrip('\n') + '\n'


def kept_comments(text: str) -> dict[str, list[str]]:
    """Return the comment lines before each parameter, by node and name.

    Those before a node have its name alone, those behind its parameters a dot, those that the file
    begins with an empty name. Lines further in than the parameters belong to generated comments.
    """
    found: dict[str, list[str]] = {}
    node, waiting = '', list[str]()
    for line in text.splitlines():
        if re.match(r' {0,4}#', line):
            waiting.append(line)
        elif not line.strip() and waiting:
            found[f'{node}.' if node else ''] = waiting
            waiting = []
        elif match := re.match(r'/\*\*/(\w+):', line):
            node = match[1]
            found[node], waiting = waiting, []
        elif match := re.match(r' {4}(\w+):', line):
            found[f'{node}.{match[1]}'], waiting = waiting, []
    if waiting:
        found[f'{node}.'] = waiting
    return {name: lines for name, lines in found.items() if lines}


def parameter_lines(entry: 'Field[Any]') -> Iterator[str]:
    """Yield a parameter with its default, and what it means."""
    description = describe(entry)
    span = allowed(description)
    limits = ', '.join(each for each in (description.unit, span) if each)
    comment = f'{limits}: {description.text}' if limits else description.text
    value = list(entry.default) if isinstance(entry.default, tuple) else entry.default
    begin = f'    {entry.name}: {scalar(value)} '.ljust(COMMENT_COLUMN)
    wrapped = textwrap.wrap(
        comment, LINE_LENGTH - COMMENT_COLUMN - 2, break_on_hyphens=False, break_long_words=False
    )
    if len(begin) > COMMENT_COLUMN:
        yield begin.rstrip()
        begin = ' ' * COMMENT_COLUMN
    for part in wrapped:
        yield f'{begin}# {part}'
        begin = ' ' * COMMENT_COLUMN


def scalar(value: object) -> str:
    """Return a value as YAML in one line."""
    text: str = yaml.safe_dump(value, default_flow_style=True, width=1000)
    return text.removesuffix('...\n').strip()


def generated() -> Mapping[Path, str]:
    """Return the content that each file should have."""
    found = {path: with_tables(path.read_text(encoding='utf-8')) for path in PAGES}
    found[PARAMETER_FILE] = parameter_file(PARAMETER_FILE.read_text(encoding='utf-8'))
    return found


def main() -> None:
    """Write the files that are not as they should be."""
    for path, content in generated().items():
        if path.read_text(encoding='utf-8') != content:
            path.write_text(content, encoding='utf-8')
            print(f'written: {path.relative_to(ROOT)}')


if __name__ == '__main__':
    main()
