# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Settings and state files as dataclasses, read from YAML or JSON and written as JSON.

Each file format is a subclass of `Settings`. The type of a field is bool, a number, text, an
enumeration, an array, a `Parameters` or `Settings` class, or a list or mapping of these types. A
file contains the name of an enumeration member in lower case.
"""

from collections.abc import Iterable, Mapping
from dataclasses import MISSING, Field, asdict, dataclass, field, fields
from enum import Enum
from functools import cache
import json
import os
from pathlib import Path
import reprlib
from types import UnionType
from typing import Any, ClassVar, TypeVar, cast, get_args, get_origin, get_type_hints

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

_Kind = TypeVar('_Kind', bound='Settings')


@dataclass(frozen=True, kw_only=True)
class Settings:
    """Base class of the content of a file, or of a mapping in a file.

    The fields are declared by `parameter`. A field named `name` contains the key of the mapping in
    the enclosing mapping. `format` is the version of the file format. A file without a version has
    version 1. `unknown` contains the values of unknown keys by key. `unknown` is empty unless the
    file has a newer format, because otherwise an unknown key is refused.
    """

    format: ClassVar[int] = 1
    unknown: Mapping[str, Any] = field(default_factory=dict, repr=False, compare=False)

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return `content` converted to the present format.

        The base class returns `content` unchanged. A subclass whose format has changed overrides
        this method to convert older formats.
        """
        return content


def read_settings(source: Path | str, kind: type[_Kind]) -> _Kind:
    """Return the settings in a file, if `source` is its path, or in the text `source`.

    Raises `SettingsError` if the file cannot be read, or if the settings are invalid.
    """
    with opened(source) as content:
        return settings_of(kind, content)


def write_settings(path: Path, settings: Settings, mode: int = 0o644) -> None:
    """Write settings to a file as JSON. An existing file is replaced.

    If `path` is a link, its target is replaced. `mode` contains the permissions of the file. If the
    file cannot be written, OSError is raised, and an existing file is left unchanged.
    """
    text = json.dumps({'format': settings.format, **plain(settings)})
    replace_file(Path(os.path.realpath(path)), [f'{text}\n'.encode()], mode)


def plain(value: Any) -> Any:
    """Convert settings, or a value in them, to JSON types, including the values of unknown keys.

    The field `name` of settings is omitted, because it is the key of their mapping in a file.
    """
    if isinstance(value, Settings):
        entries = _fields(cast(Any, type(value))).items()
        own = {key: getattr(value, each.name) for key, (each, _) in entries if key != 'name'}
        return plain(own | {**value.unknown})
    if isinstance(value, Mapping):
        return {key: plain(each) for key, each in value.items()}
    if isinstance(value, tuple | list):
        return [plain(each) for each in value]
    if isinstance(value, Parameters):
        return asdict(value)
    if isinstance(value, Enum):
        return value.name.lower()
    return value.tolist() if isinstance(value, np.ndarray | np.generic) else value


@cache
def _fields(kind: Any) -> dict[str, tuple['Field[Any]', Any]]:
    """Return the field and the type of each key of a `Settings` class.

    The key of a field whose name ends with an underscore, such as `class_`, is the name without the
    underscore. For a field of type ``T | None``, the type T is returned.
    """
    types = {
        name: get_args(hint)[0] if isinstance(hint, UnionType) else hint
        for name, hint in get_type_hints(kind).items()
    }
    return {e.name.rstrip('_'): (e, types[e.name]) for e in fields(kind) if e.metadata}


def settings_of(kind: type[_Kind], content: Any, *path: Any, newer: bool = False) -> _Kind:
    """Return the settings in a mapping. Raises `SettingsError` if the settings are invalid.

    `path` contains the keys that lead to the mapping in its file. If a value is absent, null or an
    empty string, the field gets its default. For a field without a default, an absent value, null,
    an empty string, an empty list and an empty mapping are invalid. An unknown key is invalid,
    because it is probably a typing error. However, unknown keys are kept in `unknown` if the file
    has a newer format. `newer` is true if an enclosing mapping has stated a newer format.
    """
    content, known = kind.prepared(content), _fields(cast(Any, kind))
    if not isinstance(content, dict):
        raise SettingsError(f'{reprlib.repr(content)} is not a table with {_names(known)}', *path)
    if type(number := content.get('format', 1)) is not int:
        raise SettingsError(f'{number!r} is not a format number', *path, 'format')
    newer = newer or number > kind.format
    values: dict[str, Any] = {'unknown': _unknown(known, content, path, newer)}
    for key, (entry, hint) in known.items():
        value = path[-1] if key == 'name' else content.get(key)
        if _is_given(entry, value, (*path, key)):
            values[entry.name] = _value(hint, entry, value, (*path, key), newer)
    try:
        return kind(**values)
    except SettingsError as error:
        raise SettingsError(error.text, *path, *error.path) from None


def _names(known: Iterable[str]) -> str:
    return ', '.join(key for key in known if key != 'name')


def _unknown(
    known: Iterable[str], content: Mapping[str, Any], path: tuple[Any, ...], newer: bool
) -> dict[str, Any]:
    """Return the values of unknown keys by key if the format is newer, otherwise {}.

    For a newer format, the result also contains the key ``format`` if it is stated, so that a file
    written from the settings keeps the number of its format.

    Raises `SettingsError` if there is an unknown key, and the format is not newer.
    """
    unknown = {key: each for key, each in content.items() if key == 'name' or key not in known}
    if newer:
        return unknown
    if not path:
        unknown.pop('format', None)
    for key in unknown:
        raise SettingsError(f'no such key; valid keys are {_names(known)}', *path, key)
    return {}


def _is_given(entry: Any, value: Any, path: tuple[Any, ...]) -> bool:
    """Return whether a value is neither None nor '', and differs from the default of its field.

    Raises `SettingsError` if the field has no default, and the value is None, '', [] or {}.
    """
    if entry.default is MISSING and value in (None, '', [], {}):
        raise SettingsError('is missing; add it', *path)
    return value not in (None, '') and repr(value) != repr(plain(entry.default))


def _value(hint: Any, entry: Any, value: Any, path: tuple[Any, ...], newer: bool) -> Any:
    kind, inner = get_origin(hint) or hint, get_args(hint)
    if kind is Any:
        return value
    if issubclass(kind, Settings):
        return settings_of(kind, value, *path, newer=newer)
    try:
        if kind is Mapping:
            table = _checked(value, dict, 'a table of "name: value" lines').items()
            return {
                _value(inner[0], entry, k, (*path, k), newer): (
                    _value(inner[1], entry, v, (*path, k), newer)
                )
                for k, v in table
            }
        if kind is tuple and float not in inner:
            listed = enumerate(_checked(value, list, 'a list like [a, b]'), 1)
            return tuple(_value(inner[0], entry, v, (*path, n), newer) for n, v in listed)
        return _leaf(kind, inner, entry, value, newer)
    except ValueError as error:
        raise _placed(error, path) from None


def _placed(error: ValueError, path: tuple[Any, ...]) -> SettingsError:
    """Return an error that contains the path of its value in the file."""
    if isinstance(error, SettingsError):
        return error
    if isinstance(error, ParameterError):
        name, _, text = str(error).partition(': ')
        return SettingsError(text, *path, *name.split('.')[1:])
    return SettingsError(str(error), *path)


def _leaf(kind: Any, inner: tuple[Any, ...], entry: Any, value: Any, newer: bool) -> Any:
    """Convert a value that contains no `Settings` to the type of its field.

    Raises ValueError if the value is invalid.
    """
    allowed = describe(entry)
    if issubclass(kind, Parameters):  # unknown parameters of a newer format are ignored
        table = _checked(value, dict, 'a table of "name: value" lines').items()
        return kind.from_mapping({str(k): v for k, v in table if not newer or k in kind.entries()})
    if issubclass(kind, tuple | np.ndarray):
        return _numbers(kind, inner, entry, value)
    if issubclass(kind, Enum):
        return kind[str(convert(str, allowed, value)).upper()]
    if kind is str and not (isinstance(value, str) and value.isprintable()):
        raise ValueError(f'{value!r} is not one line of text; put it in quotes')
    return value if value in allowed.choices else convert(kind, allowed, value)


def _numbers(kind: Any, inner: tuple[Any, ...], entry: Any, value: Any) -> Any:
    count = 2 if inner == (float, float) else None
    made = convert(tuple, describe(entry), _checked(value, list, 'a list like [a, b]', count))
    return np.array(made) if kind is np.ndarray else made


def _checked(value: Any, kind: type[Any], what: str, count: int | None = None) -> Any:
    """Return a value unchanged.

    Raises ValueError if the value is not of the type `kind`, or if `count` is given and the value
    does not have `count` entries.
    """
    if not isinstance(value, kind) or (count is not None and len(value) != count):
        raise ValueError(f'{reprlib.repr(value)} is not {what}')
    return value
