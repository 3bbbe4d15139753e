# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""YAML files of plain values, within bounds: a short text can stand for gigabytes."""

from pathlib import Path
from typing import Any

import yaml

from checkweigher_dsp.input_files import read_input

# Levels of nesting, values counted through the aliases, characters of a number.
_DEEPEST, _MOST_VALUES, _LONGEST_NUMBER = 20, 100_000, 100


def read_yaml(path: Path) -> Any:
    """Return the content of a YAML file.

    Raises
    ------
    OSError
        If the file cannot be read.
    ValueError
        If it is no such YAML: see `parse_yaml`.
    """
    return parse_yaml(read_input(path).decode('utf-8'))


def read_yaml_as(path: Path, refusal: type[ValueError], what: str = 'a YAML file') -> Any:
    """Return the content of a YAML file; `refusal`, in one line, if it cannot be read."""
    try:
        return read_yaml(path)
    except OSError as error:
        raise refusal(f'{path}: {error.strerror or error}') from None
    except ValueError as error:
        raise refusal(f'{path}: not {what}: {error}') from None


def parse_yaml(text: str) -> Any:
    """Return the content of a YAML text.

    It is refused where it is nested deeply, where aliases multiply it, where an alias stands within
    its own anchor, where a number is too long, where a string is no Unicode, and where a key stands
    twice: YAML would silently take the last one.

    Raises
    ------
    ValueError
        If it is refused or no YAML; one line that says where.
    """
    try:
        return yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        place = f'line {mark.line + 1}: ' if mark else ''
        raise ValueError(f'{place}{error.problem or error.context}') from None
    except yaml.YAMLError as error:
        raise ValueError(' '.join(str(error).split())) from None


class _Loader(yaml.SafeLoader):
    """Loader of plain values that counts what it composes."""

    def __init__(self, text: str) -> None:
        super().__init__(text)
        self._depth = self._values = 0
        self._sizes: dict[int, int] = {}  # of complete nodes by their id, in values

    def compose_node(self, parent: Any, index: Any) -> Any:
        """Return the next node, within the bounds."""
        before, alias = self._values, self.check_event(yaml.AliasEvent)
        mark = self.peek_event().start_mark
        self._depth += 1
        problem = f'nested deeper than {_DEEPEST}' if self._depth > _DEEPEST else ''
        if not problem:
            node = super().compose_node(parent, index)
            problem = _problem(node)
            if alias and id(node) not in self._sizes:
                problem = 'an alias stands within its own anchor'
            self._values += self._sizes.get(id(node), 0) if alias else 1
            if self._values > _MOST_VALUES:
                problem = f'more than {_MOST_VALUES} values'
        if problem:
            raise yaml.MarkedYAMLError(problem=problem, problem_mark=mark)
        self._depth -= 1
        self._sizes.setdefault(id(node), self._values - before)
        return node


def _problem(node: Any) -> str:
    """Return what is wrong with a node itself, empty if nothing is."""
    if isinstance(node, yaml.ScalarNode):
        if node.tag.endswith((':int', ':float')) and len(node.value) > _LONGEST_NUMBER:
            return f'a number of {len(node.value)} characters'
        if any('\ud800' <= each <= '\udfff' for each in node.value):
            return 'a text with half a surrogate pair'
    elif isinstance(node, yaml.MappingNode):
        seen: set[tuple[str, str]] = set()
        for key, _ in node.value:
            if isinstance(key, yaml.ScalarNode):
                if (key.tag, key.value) in seen:
                    return f'{key.value} stands twice'
                seen.add((key.tag, key.value))
    return ''
