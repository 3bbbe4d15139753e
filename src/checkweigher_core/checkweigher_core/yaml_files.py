# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Files of plain values, YAML or JSON; errors in them have the file and the line."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
import json
from pathlib import Path
from typing import Any

import yaml

from checkweigher_core.parameters import SettingsError


@contextmanager
def opened(source: Path | str) -> Iterator[Any]:
    """Yield the values of a file or a text; a `SettingsError` inside gets file and line."""
    begin, content = f'{source}: ' if isinstance(source, Path) else '', None
    try:
        text = source.read_text(encoding='utf-8') if isinstance(source, Path) else source
        content = _parsed(text)
        yield content
    except SettingsError as error:
        raise SettingsError(f'{begin}line {_line(content, error.path)}: {error}') from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f'line {mark.line + 1}: ' if mark else ''
        raise SettingsError(f'{begin}{place}bad YAML: {error.problem}') from None
    except (OSError, ValueError, RecursionError, yaml.YAMLError) as error:
        problem = getattr(error, 'strerror', None) or ' '.join(str(error).split())
        raise SettingsError(f'{begin}{problem}') from None


def _parsed(text: str) -> Any:
    if text.startswith('{'):
        with suppress(json.JSONDecodeError):  # YAML in flow style begins so too
            return json.loads(text)
    return yaml.load(text, _Loader)


class _Table(dict[Any, Any]):
    """Table of a YAML file with the line of each key."""

    lines: Mapping[str, int]


class _Loader(yaml.SafeLoader):
    """Loader of tables with their lines; a date is a text."""

    def text(self, node: Any) -> str:
        """Return a value as it is written."""
        return str(node.value)

    def table(self, node: Any) -> _Table:
        """Return a table; refuse a repeated key, of which YAML would use the last value."""
        lines: dict[str, int] = {}
        for key, _ in node.value:
            if str(key.value) in lines:
                problem = f'{key.value} is there twice; remove one of them'
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            lines[str(key.value)] = key.start_mark.line + 1
        made = _Table(self.construct_mapping(node, deep=True))
        made.lines = lines
        return made


_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.table)
_Loader.add_constructor('tag:yaml.org,2002:timestamp', _Loader.text)


def _line(content: Any, path: tuple[Any, ...]) -> int:
    """Return the line of a field, or of the table in which it should be."""
    line = 1
    for step in path:
        line = getattr(content, 'lines', {}).get(str(step), line)
        if isinstance(content, list):
            content = dict(enumerate(content, 1))
        content = content.get(step) if isinstance(content, dict) else None
    return line
