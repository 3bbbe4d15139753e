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
_Kind = TypeVar('_Kind', bound='Settings')


@dataclass(frozen=True, kw_only=True)
class Settings:
    """A file, or a table of one; `__post_init__` may raise `SettingsError`.

    Its fields are made by `parameter`, and `name` is its key in the table around it. `format` is
    the number of the format; a file without one has 1.
    """

    format: ClassVar[int] = 1
    unknown: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return a table as the fields have it; an override translates older formats."""
        return content


def read_settings(source: Path | str, kind: type[_Kind]) -> _Kind:
    """Return the settings of a file or a text; `SettingsError` if they cannot be used."""
    with opened(source) as content:
        return settings_of(kind, content)


def write_settings(path: Path, settings: Settings, mode: int = 0o644) -> None:
    """Write settings in place of those of a file, whole; OSError leaves the old ones."""
    text = json.dumps({'format': settings.format, **plain(settings)})
    replace_file(Path(os.path.realpath(path)), [f'{text}\n'.encode()], mode)


def plain(value: Any) -> Any:
    """Return settings, or values of them, as JSON has them; what was unknown stays."""
    if isinstance(value, Settings):
        own = {key: plain(getattr(value, each.name)) for key, each in _fields(type(value)).items()}
        return {key: each for key, each in own.items() if key != 'name'} | dict(value.unknown)
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
    """Return the settings that plain values at a path are; `SettingsError` if they are none.

    Absent and empty values are the default of their field. Unknown keys of a newer format are kept;
    others are refused, because they are probably typing errors.
    """
    content, own = kind.prepared(content), _fields(kind)
    names = ', '.join(key for key in own if key != 'name')
    if not isinstance(content, dict):
        raise SettingsError(f'{reprlib.repr(content)} is no table with {names}', *path)
    number = content.get('format', 1)
    if type(number) is not int:
        raise SettingsError(f'{number!r} is not the number of a format', *path, 'format')
    newer = newer or number > kind.format
    unknown = {key: each for key, each in content.items() if key not in {*own} - {'name'}}
    if not newer and (key := next((each for each in unknown if path or each != 'format'), '')):
        raise SettingsError(f'no such key; it may have {names}', *path, key)
    values: dict[str, Any] = {'unknown': unknown if newer else {}}
    for key, entry in own.items():
        value = path[-1] if key == 'name' else content.get(key)
        if value in _NOTHING or (value in ([], {}) and entry.default is MISSING):
            if entry.default is MISSING:
                raise SettingsError('is missing; add it', *path, key)
        elif json.dumps(value, default=str) != json.dumps(entry.default, default=str):
            hint = get_type_hints(kind)[entry.name]
            values[entry.name] = _value(hint, entry, value, (*path, key), newer)
    try:
        return kind(**values)
    except SettingsError as error:
        raise SettingsError(error.text, *path, *error.path) from None


def _value(hint: Any, entry: Any, value: Any, path: tuple[Any, ...], newer: bool) -> Any:
    hint = get_args(hint)[0] if isinstance(hint, UnionType) else hint  # of `... | None`
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
    try:
        return _checked(kind, inner, entry, value, newer)
    except ParameterError as error:  # of an inner set
        name, _, text = str(error).partition(': ')
        raise SettingsError(text, *path, *name.split('.')[1:]) from None
    except ValueError as error:
        raise SettingsError(str(error), *path) from None


def _checked(kind: Any, inner: tuple[Any, ...], entry: Any, value: Any, newer: bool) -> Any:
    description = describe(entry)
    if issubclass(kind, Parameters) and isinstance(value, dict):
        known = {str(k): v for k, v in value.items() if not newer or k in kind.entries()}
        return kind.from_mapping(known)
    if issubclass(kind, Enum):
        return kind[str(convert(str, description, value)).upper()]
    if issubclass(kind, Mapping | Parameters):
        raise ValueError(f'{value!r} is not a table of "name: value" lines')
    if kind is str and not (isinstance(value, str) and value.isprintable()):
        raise ValueError(f'{value!r} is not one line of text; put it in quotes')
    if value in description.choices:
        return value
    if kind not in (tuple, np.ndarray):
        return convert(kind, description, value)
    if not isinstance(value, list) or (kind is tuple and ... not in inner and len(value) != 2):
        raise ValueError(f'{value!r} is not a list like [a, b]')
    made = convert(tuple, description, value)
    return np.array(made) if kind is np.ndarray else made
