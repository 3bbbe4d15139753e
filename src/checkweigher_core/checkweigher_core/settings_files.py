# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and state files as dataclasses: one reader, of YAML and JSON, and one writer, of JSON.

A file is a subclass of `Settings`. It may have fields of the types of parameters, and of texts,
lists and tables of them, further `Settings`, `Parameters`, enumerations by name, and arrays.
"""

from collections.abc import Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from enum import Enum
import json
import os
from pathlib import Path
import reprlib
from types import UnionType
from typing import Any, ClassVar, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from checkweigher_core.parameters import (
    ParameterError,
    Parameters,
    SettingsError,
    convert,
    describe,
)
from checkweigher_core.state_files import replace_file
from checkweigher_core.yaml_files import opened

_NOTHING = None, ''
_EMPTY: tuple[object, ...] = (*_NOTHING, [], {})
_Kind = TypeVar('_Kind', bound='Settings')


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Base of a file, or of a table in one; `__post_init__` may raise `SettingsError`.

    Its fields are declared by `parameter`; `name` is its key in the table around it. `format` is
    the number of the format, 1 for a file without one.
    """

    format: ClassVar[int] = 1
    unknown: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return a table in the present format; overrides translate older formats."""
        return content


def read_settings(source: Path | str, kind: type[_Kind]) -> _Kind:
    """Return the settings of a file or a text; `SettingsError` if they cannot be used."""
    with opened(source) as content:
        return settings_of(kind, content)


def write_settings(path: Path, settings: Settings, mode: int = 0o644) -> None:
    """Replace a file as a whole by settings; an OSError leaves the old file."""
    text = json.dumps({'format': settings.format, **plain(settings)})
    replace_file(Path(os.path.realpath(path)), [f'{text}\n'.encode()], mode)


def plain(value: Any) -> Any:
    """Return settings, or values of them, for JSON; unknown values stay."""
    if isinstance(value, Settings):
        names = {key: each.name for key, each in _fields(type(value)).items() if key != 'name'}
        return {key: plain(getattr(value, name)) for key, name in names.items()} | dict(
            value.unknown
        )
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    if isinstance(value, Parameters):
        return asdict(value)
    if isinstance(value, Enum):
        return value.name.lower()
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


def _fields(kind: type[Settings]) -> 'dict[str, Field[Any]]':
    """Return the fields by their keys: `class_` has the key class."""
    return {each.name.rstrip('_'): each for each in fields(kind) if each.metadata}


def settings_of(kind: type[_Kind], content: Any, *path: Any, newer: bool = False) -> _Kind:
    """Return the settings of a table of plain values; `SettingsError` if they cannot be used.

    `path` is the place of the table in its file. Absent and empty values are the default of their
    field. Unknown keys of a `newer` format are kept; others are probably typing errors, and
    refused.
    """
    content = kind.prepared(content)
    if not isinstance(content, dict):
        raise SettingsError(f'{reprlib.repr(content)} is no table with {_names(kind)}', *path)
    newer = newer or _format_of(content, path) > kind.format
    values: dict[str, Any] = {'unknown': _unknown(kind, content, path, newer)}
    for key, entry in _fields(kind).items():
        value = path[-1] if key == 'name' else content.get(key)
        if entry.default is MISSING and value in _EMPTY:
            raise SettingsError('is missing; add it', *path, key)
        if value not in _NOTHING and not _is_default(entry, value):
            hint = _type_of(kind, entry)
            values[entry.name] = _value(hint, entry, value, (*path, key), newer)
    try:
        return kind(**values)
    except SettingsError as error:
        raise SettingsError(error.text, *path, *error.path) from None


def _names(kind: type[Settings]) -> str:
    return ', '.join(key for key in _fields(kind) if key != 'name')


def _format_of(content: Mapping[str, Any], path: tuple[Any, ...]) -> int:
    number = content.get('format', 1)
    if type(number) is not int:
        raise SettingsError(f'{number!r} is not the number of a format', *path, 'format')
    return number


def _unknown(
    kind: type[Settings], content: Mapping[str, Any], path: tuple[Any, ...], newer: bool
) -> dict[str, Any]:
    """Return the unknown values of a newer format; `SettingsError` for those of another."""
    known = {*_fields(kind)} - {'name'}
    unknown = {key: value for key, value in content.items() if key not in known}
    if newer:
        return unknown
    if not path:
        unknown.pop('format', None)
    for key in unknown:
        raise SettingsError(f'no such key; it may have {_names(kind)}', *path, key)
    return {}


def _is_default(entry: 'Field[Any]', value: Any) -> bool:
    """Return whether a value is that of the default, such as NaN."""
    return json.dumps(value, default=str) == json.dumps(entry.default, default=str)


def _type_of(kind: type[Settings], entry: 'Field[Any]') -> Any:
    hint = get_type_hints(kind)[entry.name]
    return get_args(hint)[0] if isinstance(hint, UnionType) else hint  # of `... | None`


def _value(hint: Any, entry: Any, value: Any, path: tuple[Any, ...], newer: bool) -> Any:
    """Return a plain value as the type of its field."""
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return value
    if issubclass(kind, Settings):
        return settings_of(kind, value, *path, newer=newer)
    if kind is Mapping and isinstance(value, dict):
        return {k: _value(inner[1], entry, v, (*path, k), newer) for k, v in value.items()}
    if kind is tuple and float not in inner and isinstance(value, list):
        numbered = enumerate(value, 1)
        return tuple(_value(inner[0], entry, v, (*path, n), newer) for n, v in numbered)
    return _leaf(kind, inner, entry, value, path, newer)


def _leaf(
    kind: Any, inner: tuple[Any, ...], entry: Any, value: Any, path: tuple[Any, ...], newer: bool
) -> Any:
    """Return a plain value without further settings in it as the type of its field."""
    try:
        if issubclass(kind, Mapping | Parameters):
            return _parameters(kind, value, newer)
        if issubclass(kind, tuple | np.ndarray):
            return _numbers(kind, inner, entry, value)
        return _word(kind, entry, value)
    except ParameterError as error:  # of an inner set
        name, _, text = str(error).partition(': ')
        raise SettingsError(text, *path, *name.split('.')[1:]) from None
    except ValueError as error:
        raise SettingsError(str(error), *path) from None


def _parameters(kind: Any, value: Any, newer: bool) -> Parameters:
    """Return a set of parameters; unknown ones of a newer format are dropped."""
    if not isinstance(value, dict):
        raise ValueError(f'{value!r} is not a table of "name: value" lines')
    known = {str(k): v for k, v in value.items() if not newer or k in kind.entries()}
    made: Parameters = kind.from_mapping(known)
    return made


def _numbers(kind: type, inner: tuple[Any, ...], entry: Any, value: Any) -> Any:
    """Return a list of numbers as a tuple or an array."""
    if not isinstance(value, list) or (kind is tuple and ... not in inner and len(value) != 2):
        raise ValueError(f'{value!r} is not a list like [a, b]')
    made = convert(tuple, describe(entry), value)
    return np.array(made) if kind is np.ndarray else made


def _word(kind: Any, entry: Any, value: Any) -> Any:
    """Return a single text, number, or member of an enumeration."""
    allowed = describe(entry)
    if issubclass(kind, Enum):
        return kind[str(convert(str, allowed, value)).upper()]
    if kind is str and not (isinstance(value, str) and value.isprintable()):
        raise ValueError(f'{value!r} is not one line of text; put it in quotes')
    return value if value in allowed.choices else convert(kind, allowed, value)
