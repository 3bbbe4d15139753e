# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reading and writing of YAML, and reading of JSON. Errors state the file and the line."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
import json
from pathlib import Path
import re
from typing import Any

import yaml

from checkweigher_core.parameters import SettingsError


@contextmanager
def opened(source: Path | str) -> Iterator[Any]:
    """Yield the content of YAML or JSON. `source` is the path of a file, or the text itself.

    Raises
    ------
    SettingsError
        If the file cannot be read or parsed, or if the body of the ``with`` statement raises a
        ValueError or an OSError. The message states the path, if `source` is a path, and the line,
        if it is known.
    """
    place, text = f'{source}: ' if isinstance(source, Path) else '', ''
    try:
        text = source.read_text(encoding='utf-8') if isinstance(source, Path) else source
        yield _parsed(text)
    except SettingsError as error:
        raise SettingsError(f'{place}line {_line(text, error.path)}: {error}') from None
    except UnicodeDecodeError as error:
        line = error.object.count(b'\n', 0, error.start) + 1
        raise SettingsError(f'{place}line {line}: not UTF-8; save the file as UTF-8') from None
    except RecursionError:
        raise SettingsError(f'{place}lists or tables are nested too deeply') from None
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        line = getattr(mark, 'line', 0) + 1
        raise SettingsError(f'{place}line {line}: bad YAML: {error.problem}') from None
    except (OSError, ValueError, yaml.YAMLError) as error:
        problem = getattr(error, 'strerror', None) or ' '.join(str(error).split())
        raise SettingsError(f'{place}{problem}') from None


def _parsed(text: str) -> Any:
    if text.startswith('{'):
        with suppress(json.JSONDecodeError):  # the text may be YAML in flow style
            return json.loads(text, object_pairs_hook=_table)
    return yaml.load(text, _Loader)


def _table(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        # Leave this error to the YAML loader, which reports a repeated key with its line.
        raise json.JSONDecodeError('', '', 0)
    return table


class _Loader(yaml.SafeLoader):
    """YAML loader that refuses repeated keys, and reads numbers as in YAML 1.2.

    PyYAML implements YAML 1.1, in which 0150 is the number 104 and 1:30 is the number 90. This
    loader returns 0150, 1:30 and dates as strings.
    """

    def fetch_tag(self) -> None:
        """Refuse a tag such as !!int, which would change the type of a value."""
        raise yaml.MarkedYAMLError(
            problem='tags such as !!int are not supported; write the value without a tag',
            problem_mark=self.get_mark(),
        )

    def table(self, node: Any) -> dict[Any, Any]:
        """Return a mapping. Repeated keys are refused, because PyYAML would use the last value."""
        known: set[str] = set()
        for key, _ in node.value:
            if str(key.value) in known:
                problem = f'{key.value} is there twice; remove one of them'
                raise yaml.MarkedYAMLError(problem=problem, problem_mark=key.start_mark)
            known.add(str(key.value))
        return self.construct_mapping(node, deep=True)


_Loader.yaml_implicit_resolvers = {
    first: [(tag, form) for tag, form in forms if not tag.endswith(('int', 'float', 'stamp'))]
    for first, forms in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
_Loader.add_constructor('tag:yaml.org,2002:map', _Loader.table)
_WHOLE = r'[-+]?(0|[1-9][0-9]*)$|0x[0-9a-fA-F]+$|0o[0-7]+$'
_REAL = (
    r'[-+]?((0|[1-9][0-9]*)(\.[0-9]*)?|\.[0-9]+)([eE][-+]?[0-9]+)?$'
    r'|[-+]?\.(inf|Inf|INF)$|\.(nan|NaN|NAN)$'
)
_Loader.add_implicit_resolver('tag:yaml.org,2002:int', re.compile(_WHOLE), [*'-+0123456789'])
_Loader.add_implicit_resolver('tag:yaml.org,2002:float', re.compile(_REAL), [*'-+.0123456789'])


class _Dumper(yaml.SafeDumper):
    """YAML writer that quotes strings that `_Loader` would read as numbers."""


_Dumper.yaml_implicit_resolvers = _Loader.yaml_implicit_resolvers


def yaml_text(content: Any) -> str:
    """Return the text of a YAML file from which `opened` reads the same content."""
    return yaml.dump(content, Dumper=_Dumper, sort_keys=False, allow_unicode=True)


def _line(text: str, path: tuple[Any, ...]) -> int:
    """Return the line number of a field, or of the innermost existing field that encloses it.

    The result is 1 if neither the field nor an enclosing field exists, or if the lines of the text
    are unknown.
    """
    line, node = 1, None
    if '\n' in text.strip():
        with suppress(yaml.YAMLError, RecursionError):  # JSON that is not valid YAML gets line 1
            node = yaml.compose(text, _Loader)
    for step in path:
        if isinstance(node, yaml.MappingNode):
            places = {str(key.value): (key, each) for key, each in node.value}
        elif isinstance(node, yaml.SequenceNode):
            places = {str(number): (each, each) for number, each in enumerate(node.value, 1)}
        else:
            break
        if str(step) not in places:
            break
        key, node = places[str(step)]
        line = key.start_mark.line + 1
    return line
