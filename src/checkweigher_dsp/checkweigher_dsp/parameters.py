"""Parameters of the stages: declared once, with unit, range and meaning, for nodes, files and docs.

A stage's parameters are a frozen dataclass whose fields are made by `parameter`. The node declares
them to ROS from the same fields, the offline path reads them from the same YAML.
"""

from collections.abc import Iterable, Mapping
from dataclasses import Field, dataclass, field, fields
import math
from pathlib import Path
from typing import Any, ClassVar, Self, cast


class ParameterError(ValueError):
    """A parameter that cannot be used; the message names it, its value and what is allowed."""


@dataclass(frozen=True, slots=True)
class Description:
    """What a parameter means and which values it takes."""

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

    Parameters
    ----------
    default : bool, int, float, str or tuple of float
        Its type is the parameter's type.
    text : str
        Meaning, for the ROS descriptor and the docs.
    unit : str
        SI unit, empty for a pure number.
    minimum, maximum : float
        Inclusive range; for a tuple, of each element.
    choices : tuple of str
        Allowed values of a string, empty for any.
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
            value = getattr(self, entry.name)
            if not isinstance(entry.default, Parameters):
                value = check(f'{self.node}.{entry.name}', entry, value)
            object.__setattr__(self, entry.name, value)

    @classmethod
    def entries(cls) -> 'dict[str, Field[Any]]':
        """Return all parameters by their name, those of inner sets with a dot."""
        found: dict[str, Field[Any]] = {}
        for entry in fields(cls):
            if isinstance(entry.default, Parameters):
                inner = type(entry.default).entries()
                found.update({f'{entry.name}.{name}': field_ for name, field_ in inner.items()})
            else:
                found[entry.name] = entry
        return found

    @classmethod
    def from_mapping(cls, values: Mapping[str, object]) -> Self:
        """Make a set from names and values; names that are absent keep their defaults."""
        inner = {e.name: e.default for e in fields(cls) if isinstance(e.default, Parameters)}
        known = cls.entries()
        own: dict[str, object] = {}
        inner_values: dict[str, dict[str, object]] = {name: {} for name in inner}
        for name, value in values.items():
            if name not in known:
                raise ParameterError(
                    f'{cls.node}.{name}: no such parameter; {cls.node} has '
                    f'{", ".join(_names_like(name, sorted(known)))}'
                )
            outer, _, rest = name.partition('.')
            if outer in inner:
                inner_values[outer][rest] = value
            else:
                own[name] = value
        for name, default in inner.items():
            own[name] = type(default).from_mapping(inner_values[name])
        return cls(**cast(dict[str, Any], own))

    def as_mapping(self) -> dict[str, object]:
        """Return names and values of all parameters, the reverse of `from_mapping`."""
        values: dict[str, object] = {}
        for entry in fields(self):
            value = getattr(self, entry.name)
            if isinstance(value, Parameters):
                inner = value.as_mapping()
                values.update({f'{entry.name}.{name}': each for name, each in inner.items()})
            else:
                values[entry.name] = value
        return values


def _names_like(name: str, known: list[str]) -> list[str]:
    """Return the names of the inner set that `name` means, or else all, inner ones summed up."""
    prefix, dot, _ = name.rpartition('.')
    inner = [other for other in known if dot and other.startswith(prefix + dot)]
    return inner or sorted({f'{n.partition(".")[0]}.*' if '.' in n else n for n in known})


def check(name: str, entry: 'Field[Any]', value: object) -> object:
    """Return `value` in the field's type, or raise `ParameterError`."""
    default, allowed = entry.default, describe(entry)
    if isinstance(default, bool):
        if not isinstance(value, bool):
            raise ParameterError(f'{name}: {value!r} is not true or false')
        return value
    if isinstance(default, str):
        if not isinstance(value, str):
            raise ParameterError(f'{name}: {value!r} is not a string')
        if allowed.choices and value not in allowed.choices:
            raise ParameterError(f'{name}: {value!r} is not one of {", ".join(allowed.choices)}')
        return value
    if isinstance(default, tuple):
        if isinstance(value, str) or not hasattr(value, '__iter__'):
            raise ParameterError(f'{name}: {value!r} is not a list of numbers')
        return tuple(_check_number(name, 0.0, allowed, element) for element in value)
    return _check_number(name, default, allowed, value)


def _check_number(name: str, default: object, allowed: Description, value: object) -> float:
    whole = isinstance(default, int)
    if isinstance(value, bool) or not isinstance(value, int if whole else (int, float)):
        raise ParameterError(f'{name}: {value!r} is not a {"whole number" if whole else "number"}')
    try:
        number = value if whole else float(value)
    except OverflowError:
        number = math.nan  # a whole number that no float can hold
    if not allowed.minimum <= number <= allowed.maximum:  # NaN is not
        raise ParameterError(
            f'{name}: {value} is not in {allowed.minimum:g}..{allowed.maximum:g}'
            + (f' {allowed.unit}' if allowed.unit else '')
        )
    return number


# Parameters that every ROS node has.
_COMMON = frozenset({'use_sim_time', 'executor', 'transport'})


def read_parameter_file(
    path: Path,
    sets: Mapping[str, type[Parameters]],
    other_nodes: tuple[str, ...] = (),
    lane: str | None = None,
) -> dict[str, dict[str, object]]:
    """Read a ROS parameter file into names and values for each node.

    Parameters
    ----------
    path : Path
        YAML as ``ros2 run --params-file`` takes it. A section ``/**`` addresses all nodes that
        know the name, ``/**/segmenter`` or ``/lane1/segmenter`` one of them.
    sets : dict of str to Parameters class
        By name of the node.
    other_nodes : tuple of str
        Nodes that the file may address as well; what it says of them is passed over.
    lane : str, optional
        Namespace of which nodes are meant, where the file addresses several.

    Returns
    -------
    dict of str to dict
        By name of the node; its own section wins over ``/**``.

    Raises
    ------
    ParameterError
        If the file is not there, is no parameter file, addresses a node or under ``/**`` a
        parameter that does not exist, or nodes of several lanes and none of them is asked for.
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
    result = {}
    for node, parameters in sets.items():
        known = parameters.entries()
        result[node] = {name: value for name, value in shared.items() if name in known}
        result[node].update((k, v) for k, v in own[node].items() if k not in _COMMON)
    everywhere = {name for parameters in sets.values() for name in parameters.entries()}
    for name in shared:
        if name not in everywhere | _COMMON:
            raise ParameterError(f'{path}: none of {", ".join(sets)} has a parameter {name}')
    return result


def _of_other_lanes(path: Path, addresses: Iterable[str], lane: str | None) -> set[str]:
    """Return the addresses that name another namespace than that of the lane."""
    named = {each: each.rpartition('/')[0].strip('/') for each in addresses}
    named = {each: namespace for each, namespace in named.items() if namespace.strip('*/')}
    lanes = sorted(set(named.values()))
    if lane is None and len(lanes) > 1:
        raise ParameterError(
            f'{path}: addresses several lanes, {", ".join(lanes)}; name one of them'
        )
    return {each for each in named if lane is not None and named[each] != lane.strip('/')}


def _load_yaml(path: Path) -> dict[object, object]:
    import yaml  # takes as long as a tenth of all other imports, and is for a file alone

    try:
        content = yaml.safe_load(path.read_text(encoding='utf-8'))
    except OSError as error:
        raise ParameterError(f'{path}: {error.strerror or error}') from None
    except (yaml.YAMLError, ValueError) as error:  # the latter for a text or a date that is none
        raise ParameterError(f'{path}: not a YAML file: {" ".join(str(error).split())}') from None
    if not isinstance(content, dict):
        raise ParameterError(f'{path}: not a parameter file: no "node: ros__parameters:" section')
    return content


def flatten(values: Mapping[str, object], prefix: str = '') -> dict[str, object]:
    """Join nested names by dots, as ROS does."""
    flat: dict[str, object] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            flat.update(flatten(value, f'{prefix}{name}.'))
        else:
            flat[f'{prefix}{name}'] = value
    return flat
