# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the stages: declared once, with unit, range and meaning, for nodes, files and docs.

The parameters of a stage are a frozen dataclass whose fields are made by `parameter`. The node
declares them to ROS from these fields, a command reads them from the same YAML, and `make docs`
writes the tables of docs/interfaces.md and config/line.yaml from them.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import Field, asdict, dataclass, field, fields
import math
from pathlib import Path
import reprlib
from typing import Any, ClassVar, Self, cast

_MAX_LENGTH = 100_000  # values of a list, characters of a text
_MAX_COST = 0.05  # s, of an item


class ParameterError(ValueError):
    """A parameter that cannot be used; the message names it, its value and what is allowed."""


@dataclass(frozen=True, slots=True)
class Description:
    """Meaning of a parameter and the values that it takes."""

    text: str
    unit: str
    minimum: float
    maximum: float
    choices: tuple[str, ...]


def parameter(
    default: Any,
    text: str,
    *,
    unit: str = '',
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a field of a `Parameters` class.

    The type of `default` (bool, int, float, str or tuple of float) is the parameter's type. `text`
    and `unit` (SI, empty for a pure number) are for the ROS descriptor and the docs. The range is
    inclusive; that of a tuple holds for each element. A string may be any if it has no `choices`.
    """
    description = Description(text, unit, minimum, maximum, choices)
    return field(default=default, metadata={'description': description})


def describe(entry: 'Field[Any]') -> Description:
    """Return the description that `parameter` gave to a dataclass field."""
    return cast(Description, entry.metadata['description'])


@dataclass(frozen=True)
class Parameters:
    """Base of all parameter sets: checks types and ranges, all or nothing.

    A field may be a set of its own, whose parameters are then named with a dot, as in
    ``tvlpf.gain``.

    Raises
    ------
    ParameterError
        On the first field that is of a wrong type, NaN or out of range.
    """

    # The node that declares the set, as it is named in parameter files.
    node: ClassVar[str] = ''

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not isinstance(entry.default, Parameters):
                value = check(f'{self.node}.{entry.name}', entry, getattr(self, entry.name))
                object.__setattr__(self, entry.name, value)

    @classmethod
    def entries(cls) -> 'dict[str, Field[Any]]':
        """Return all parameters by their name, those of inner sets with a dot."""
        own = {entry.name: entry for entry in fields(cls)}
        sets = {name: e.default for name, e in own.items() if isinstance(e.default, Parameters)}
        return flatten(own | {name: each.entries() for name, each in sets.items()})

    @classmethod
    def from_mapping(cls, values: Mapping[str, object]) -> Self:
        """Make a set from names and values; names that are absent keep their defaults."""
        known = cls.entries()
        for name in values:
            if name not in known:
                has = f'{cls.node} has {", ".join(_names_like(name, sorted(known)))}'
                raise ParameterError(f'{cls.node}.{name}: no such parameter; {has}')
        own: dict[str, Any] = {name: value for name, value in values.items() if '.' not in name}
        for entry in fields(cls):
            if isinstance(entry.default, Parameters):
                begin = f'{entry.name}.'
                inner = {n[len(begin) :]: v for n, v in values.items() if n.startswith(begin)}
                own[entry.name] = type(entry.default).from_mapping(inner)
        return cls(**own)

    def as_mapping(self) -> dict[str, object]:
        """Return names and values of all parameters, the reverse of `from_mapping`."""
        return flatten(asdict(self))


def _names_like(name: str, known: list[str]) -> list[str]:
    """Return the names of the inner set that `name` means, or else all, inner ones summed up."""
    prefix, dot, _ = name.rpartition('.')
    inner = [other for other in known if dot and other.startswith(prefix + dot)]
    return inner or sorted({f'{n.partition(".")[0]}.*' if '.' in n else n for n in known})


def check(name: str, entry: 'Field[Any]', value: object) -> object:
    """Return `value` in the field's type, or raise `ParameterError`."""
    default, description = entry.default, describe(entry)
    if isinstance(default, (bool, str)):
        text = isinstance(default, str)
        if not isinstance(value, str if text else bool):
            kind = 'a string' if text else 'true or false'
            raise ParameterError(f'{name}: {reprlib.repr(value)} is not {kind}')
        if description.choices and value not in description.choices:
            choices = ', '.join(description.choices)
            raise ParameterError(f'{name}: {reprlib.repr(value)} is not one of {choices}')
        if isinstance(value, str) and len(value) > _MAX_LENGTH:
            raise ParameterError(f'{name}: {len(value)} characters, at most {_MAX_LENGTH}')
        return value
    if isinstance(default, tuple):
        if isinstance(value, str) or not isinstance(value, Collection):
            raise ParameterError(f'{name}: {reprlib.repr(value)} is not a list of numbers')
        if len(value) > _MAX_LENGTH:
            raise ParameterError(f'{name}: {len(value)} values, at most {_MAX_LENGTH}')
        return tuple(_check_number(name, 0.0, description, element) for element in value)
    return _check_number(name, default, description, value)


def _check_number(name: str, default: object, description: Description, value: object) -> float:
    whole = isinstance(default, int)
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        kind = 'whole number' if whole else 'number'
        raise ParameterError(f'{name}: {reprlib.repr(value)} is not a {kind}')
    try:
        number = value if whole else float(value)
    except OverflowError:
        number = math.nan  # a whole number that no float can hold
    if not description.minimum <= number <= description.maximum:  # NaN is not
        span = f'{description.minimum:g}..{description.maximum:g} {description.unit}'.rstrip()
        raise ParameterError(f'{name}: {value} is not in {span}')
    return number


def check_cost(parameters: Parameters, cost: Callable[..., float], *names: str) -> None:
    """Raise ParameterError if a window would take too long.

    `cost` returns an estimate in s from the parameters `names`; the one that raises it most above
    what it is by default is to be lowered.
    """
    values = {name: getattr(parameters, name) for name in names}
    if (seconds := cost(**values)) <= _MAX_COST:
        return
    defaults = {entry.name: entry.default for entry in fields(parameters)}
    dearest = min(names, key=lambda name: cost(**{**values, name: defaults[name]}))
    others = ', '.join(f'{name} {value}' for name, value in values.items() if name != dearest)
    raise ParameterError(
        f'{parameters.node}.{dearest}: {values[dearest]} with {others} would take about '
        f'{seconds:.2g} s for each item, at most {_MAX_COST:g} s: lower it'
    )


def _is_common(name: str) -> bool:
    """Return whether any ROS node may have a parameter of this name."""
    return name in ('use_sim_time', 'allowed_publishers', 'locked') or name.startswith(
        'qos_overrides.'
    )


def read_parameter_file(
    path: Path,
    sets: Mapping[str, type[Parameters]],
    other_nodes: tuple[str, ...] = (),
    lane: str | None = None,
) -> dict[str, dict[str, object]]:
    """Read a ROS parameter file into names and values for each node.

    The file is YAML as ``ros2 run --params-file`` takes it. A section ``/**`` addresses all nodes
    that know the name, ``/**/segmenter`` or ``/lane1/segmenter`` one of them, and wins over it.
    `sets` has the classes of parameters by name of the node; sections of `other_nodes` are passed
    over. `lane` is the namespace of the nodes, where the file addresses several lanes.

    Raises
    ------
    ParameterError
        If the file is not there, is no parameter file, addresses a node or under ``/**`` a
        parameter that does not exist, or several lanes without `lane`.
    """
    own: dict[str, dict[str, object]] = {node: {} for node in (*sets, *other_nodes)}
    shared: dict[str, object] = {}
    sections = _load_yaml(path)
    passed_over = _of_other_lanes(path, map(str, sections), lane)
    for address, section in sections.items():
        values = section.get('ros__parameters') if isinstance(section, dict) else None
        if not isinstance(values, dict):
            raise ParameterError(f'{path}: section {address!r} has no ros__parameters')
        node = str(address).rsplit('/', 1)[-1]
        if node != '**' and node not in own:
            raise ParameterError(f'{path}: section {address!r} addresses none of {", ".join(own)}')
        if str(address) not in passed_over:
            (shared if node == '**' else own[node]).update(flatten(values))
    known = {node: parameters.entries() for node, parameters in sets.items()}
    for name in shared:
        if not _is_common(name) and name not in set().union(*known.values()):
            raise ParameterError(f'{path}: none of {", ".join(sets)} has a parameter {name}')
    return {
        node: {name: value for name, value in shared.items() if name in names}
        | {name: value for name, value in own[node].items() if not _is_common(name)}
        for node, names in known.items()
    }


def _of_other_lanes(path: Path, addresses: Iterable[str], lane: str | None) -> set[str]:
    """Return the addresses that name another namespace than that of the lane."""
    named = {each: each.rpartition('/')[0].strip('/') for each in addresses}
    named = {each: namespace for each, namespace in named.items() if namespace.strip('*/')}
    lanes = sorted(set(named.values()))
    if lane is None and len(lanes) > 1:
        names = ', '.join(lanes)
        raise ParameterError(f'{path}: addresses several lanes, {names}; name one of them')
    return {each for each in named if lane is not None and named[each] != lane.strip('/')}


def _load_yaml(path: Path) -> dict[object, object]:
    # Its import takes as long as a tenth of all others, and is for a file alone.
    from checkweigher_dsp.yaml_files import read_yaml_as

    content = read_yaml_as(path, ParameterError)
    if not isinstance(content, dict):
        raise ParameterError(f'{path}: not a parameter file: no "node: ros__parameters:" section')
    return content


def flatten(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Join nested names by dots, as ROS does."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat |= flatten(value, f'{prefix}{name}.')
        else:
            flat[f'{prefix}{name}'] = value
    return flat
