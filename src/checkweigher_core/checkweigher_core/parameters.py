# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the processing stages, each with its unit, range and description.

The parameters of a stage are the fields of a frozen dataclass, declared by `parameter`. A node
declares the parameters to ROS, a command reads them from a ROS parameter file, and `make docs`
writes docs/parameters.md and config/line.yaml from them.
"""

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
import math
import reprlib
from typing import Any, ClassVar, Self, cast

from checkweigher_core.printable import one_line

_MAX_VALUES = 100_000  # largest number of values in a list
_MAX_COST = 0.05  # longest computing time per item in s
_ALL = '**'  # section of a parameter file that addresses all nodes


class ParameterError(ValueError):
    """Raised if a parameter is invalid, or if a node cannot start for another reason."""


def package_missing(name: str, value: str, module: str) -> ParameterError:
    """Return the error for a parameter whose value needs a module that cannot be imported."""
    package = module.partition('.')[0]
    return ParameterError(
        f'{name}: {value!r} needs the Python package {package}, which is missing or too old; '
        'see docs/own_line.md'
    )


class SettingsError(ParameterError):
    """Raised if a settings file or parameter file cannot be read, or if its content is invalid.

    `path` contains the keys that lead to the invalid field in the file. `yaml_files.opened` adds
    the file name and the line to the message.
    """

    def __init__(self, text: str, *path: object) -> None:
        super().__init__(f'{one_line(".".join(map(str, path)))}: {text}' if path else text)
        self.text, self.path = text, path


@dataclass(frozen=True, slots=True)
class Description:
    """Description of a parameter, with its unit and its valid values."""

    text: str
    unit: str
    minimum: float
    maximum: float
    choices: tuple[str, ...]


def parameter(
    default: Any = MISSING,
    text: str = '',
    *,
    unit: str = '',
    minimum: float = -math.inf,
    maximum: float = math.inf,
    choices: tuple[str, ...] = (),
) -> Any:
    """Declare a field of a `Parameters` class.

    The type of `default` (bool, int, float, str or tuple of float) is the type of the parameter.
    ROS and the docs show `text` and `unit` (SI, empty for a dimensionless number). The range from
    `minimum` to `maximum` is inclusive, and applies to each element of a tuple. A string must be
    one of the `choices`. If `choices` is empty, any string is valid. This function also declares
    the fields of a `settings_files.Settings` class. A field of a `Settings` class may have another
    type, and is required if it has no default.
    """
    return field(
        default=default,
        metadata={'description': Description(text, unit, minimum, maximum, choices)},
    )


def describe(entry: 'Field[Any]') -> Description:
    """Return the description that `parameter` gave to a dataclass field."""
    return cast(Description, entry.metadata['description'])


@dataclass(frozen=True)
class Parameters:
    """Base class of all parameter sets, which checks types and ranges.

    A field may be a parameter set itself. The names of the parameters in the inner set then begin
    with the name of the field and a dot, as in ``tvlpf.gain``.

    Raises
    ------
    ParameterError
        If a value has the wrong type, is NaN, is out of range, is not one of the choices, or is a
        list of more than 100,000 numbers.
    """

    # Name of the node that declares the parameters.
    node: ClassVar[str] = ''

    def __post_init__(self) -> None:
        for entry in fields(self):
            if not isinstance(entry.default, Parameters):
                value = check(f'{self.node}.{entry.name}', entry, getattr(self, entry.name))
                object.__setattr__(self, entry.name, value)

    @classmethod
    def entries(cls) -> 'dict[str, Field[Any]]':
        """Return the dataclass field of each parameter by the name of the parameter."""
        return flatten(
            {
                e.name: e.default.entries() if isinstance(e.default, Parameters) else e
                for e in fields(cls)
            }
        )

    @classmethod
    def from_mapping(cls, values: Mapping[str, object]) -> Self:
        """Return a parameter set with the given values, and defaults for all other parameters.

        Raises `ParameterError` if a name is unknown or a value is invalid.
        """
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
        """Return the values of all parameters by name, the inverse of `from_mapping`."""
        return flatten(asdict(self))


def _names_like(name: str, known: list[str]) -> list[str]:
    """Return the parameter names to propose for an unknown name.

    The proposals are the `known` names with the same prefix up to the last dot. If no name has this
    prefix, all `known` names are returned, but names that begin with the same word and a dot are
    combined to one name such as ``tvlpf.*``.
    """
    prefix, dot, _ = name.rpartition('.')
    inner = [other for other in known if dot and other.startswith(prefix + dot)]
    return inner or sorted({f'{n.partition(".")[0]}.*' if '.' in n else n for n in known})


def check(name: str, entry: 'Field[Any]', value: object) -> object:
    """Return a value converted to the type of a field.

    Raises `ParameterError` with the parameter `name` if the value is invalid.
    """
    try:
        return convert(type(entry.default), describe(entry), value)
    except ValueError as error:
        raise ParameterError(f'{name}: {error}') from None


def convert(kind: type, description: Description, value: object) -> object:
    """Return a value converted to the type `kind`.

    Raises ValueError if the value is invalid. The message states which values are valid.
    """
    if issubclass(kind, (bool, str)):
        return _word(kind, description, value)
    if not issubclass(kind, tuple):
        return _number(kind, description, value)
    if isinstance(value, str) or not isinstance(value, Collection):
        raise ValueError(f'{reprlib.repr(value)} is not a list of numbers')
    if len(value) > _MAX_VALUES:
        raise ValueError(f'{len(value)} values, but at most {_MAX_VALUES} are allowed')
    return tuple(_number(float, description, element) for element in value)


def _word(kind: type, description: Description, value: object) -> object:
    if not isinstance(value, kind):
        expected = 'a string' if kind is str else 'true or false'
        raise ValueError(f'{reprlib.repr(value)} is not {expected}')
    if description.choices and value not in description.choices:
        raise ValueError(f'{reprlib.repr(value)} is not one of {", ".join(description.choices)}')
    return value


def _number(kind: type, description: Description, value: object) -> float:
    whole = kind is int
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        like = ('; write it like 150' if whole else '; write it like 0.15') * isinstance(value, str)
        name = 'whole number' if whole else 'number'
        raise ValueError(f'{reprlib.repr(value)} is not a {name}{like}')
    try:
        number = value if whole else float(value)
    except OverflowError:
        number = math.nan  # the integer exceeds the range of float
    if not description.minimum <= number <= description.maximum:  # also refuses NaN
        span = f'{description.minimum:g}..{description.maximum:g} {description.unit}'.rstrip()
        raise ValueError(f'{value} is not in {span}')
    return number


def check_cost(parameters: Parameters, cost: Callable[..., float], *names: str) -> None:
    """Raise ParameterError if the computation for one item would take more than 0.05 s.

    `cost` estimates the duration in s from the parameters `names`. The message names the parameter
    whose default value would shorten the computation most.
    """
    values = {name: getattr(parameters, name) for name in names}
    if (seconds := cost(**values)) <= _MAX_COST:
        return
    defaults = {entry.name: entry.default for entry in fields(parameters)}
    dearest = min(names, key=lambda name: cost(**{**values, name: defaults[name]}))
    others = ', '.join(f'{name} {value}' for name, value in values.items() if name != dearest)
    raise ParameterError(
        f'{parameters.node}.{dearest}: {values[dearest]} with {others} would take about '
        f'{seconds:.2g} s per item, but at most {_MAX_COST:g} s is allowed; lower it'
    )


def by_node(
    sections: object,
    sets: Mapping[str, type[Parameters]],
    other_nodes: tuple[str, ...] = (),
    lane: str | None = None,
) -> dict[str, dict[str, object]]:
    """Return the parameter values of each node from the sections of a ROS parameter file.

    A section ``/**`` addresses all nodes. A section such as ``/**/segmenter`` or
    ``/lane1/segmenter`` addresses one node, and overrides the section ``/**``. `sets` maps
    each node to its parameter class. `lane` is the namespace of the nodes; it is required if the
    file addresses several lanes. Sections of `other_nodes`, and of nodes in other lanes than
    `lane`, are ignored.

    Raises
    ------
    SettingsError
        If the sections do not have the form of a parameter file, address an unknown node or, under
        ``/**``, an unknown parameter, or address several lanes without `lane`.
    """
    found = check_sections(sections)
    given: dict[str, dict[str, object]] = {node: {} for node in (*sets, *other_nodes, _ALL)}
    ignored = _of_other_lanes(map(str, found), lane)
    known = {node: parameters.entries() for node, parameters in sets.items()}
    for address, values in found.items():
        node = str(address).rsplit('/', 1)[-1]
        if node not in given:
            raise SettingsError(f'addresses none of {", ".join([*sets, *other_nodes])}', address)
        if str(address) in ignored:
            continue
        given[node] |= _own_values(values, address, known if node == _ALL else {})
    return {
        node: {name: value for name, value in given[_ALL].items() if name in names} | given[node]
        for node, names in known.items()
    }


def _own_values(
    values: Mapping[str, Any], address: object, known: Mapping[str, Collection[str]]
) -> dict[str, Any]:
    """Return the values of a section of a parameter file by the full names of the parameters.

    The parameters that rclpy declares for each node are omitted. `known` contains the names of the
    parameters of each node, or is empty. Raises `SettingsError` if `known` is not empty, and the
    section contains a parameter that none of these nodes has.
    """
    found = {}
    for name, value in flatten(values).items():
        if name == 'use_sim_time' or name.startswith('qos_overrides.'):
            continue
        if known and not any(name in names for names in known.values()):
            why = f'none of {", ".join(known)} has a parameter {name}'
            raise SettingsError(why, address, 'ros__parameters', *name.split('.'))
        found[name] = value
    return found


def check_sections(sections: object) -> dict[Any, dict[str, Any]]:
    """Return the values of each section of a ROS parameter file.

    Raises `SettingsError` if `sections` does not have the form of a parameter file.
    """
    if not isinstance(sections, dict):
        raise SettingsError('not a parameter file: no "node: ros__parameters:" section')
    found = {}
    for address, section in sections.items():
        values = section.get('ros__parameters') if isinstance(section, dict) else None
        if not isinstance(values, dict):
            raise SettingsError('has no ros__parameters; add it', address)
        found[address] = values
    return found


def in_section(error: ParameterError, sections: Mapping[Any, Any]) -> SettingsError:
    """Return a copy of an error that also contains the path of its parameter in `sections`.

    The path is empty if no section contains the parameter. If several sections contain the
    parameter, the path leads to the last of them.
    """
    made, (name, _, _) = SettingsError(str(error)), str(error).partition(': ')
    node, _, own = name.partition('.')
    for address, section in sections.items():
        if str(address).rsplit('/', 1)[-1] in (_ALL, node):
            values = section['ros__parameters']
            if own in flatten(values):
                steps = [own] if own in values else own.split('.')
                made.path = address, 'ros__parameters', *steps
    return made


def _of_other_lanes(addresses: Iterable[str], lane: str | None) -> set[str]:
    """Return the addresses of nodes in the namespaces of other lanes than `lane`.

    If `lane` is None, the result is empty. Raises `SettingsError` if `lane` is None and the
    addresses contain several lanes.
    """
    spaces = ((each, each.rpartition('/')[0].strip('/')) for each in addresses)
    named = {each: namespace for each, namespace in spaces if namespace.strip('*/')}
    lanes = sorted(set(named.values()))
    if lane is None and len(lanes) > 1:
        raise SettingsError(f'the file addresses several lanes: {", ".join(lanes)}; choose one')
    return {each for each in named if lane is not None and named[each] != lane.strip('/')}


def flatten(values: Mapping[str, Any], prefix: str = '') -> dict[str, Any]:
    """Return nested values by full name, in which the nested names are joined by dots."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        own = f'{prefix}{name}'
        flat |= flatten(value, f'{own}.') if isinstance(value, dict) else {own: value}
    return flat
