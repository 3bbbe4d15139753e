# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Record fields that are missing in the messages of older bags and in the lines of older files."""

from dataclasses import field, fields
from typing import TypeVar

T = TypeVar('T')


def newer(default: T) -> T:
    """Return a dataclass field that is missing in older messages and files.

    `default` is the value of the field in a record that is read from an older message or file.
    """
    return field(default=default, metadata={'newer': True})


def newer_fields(record: type) -> frozenset[str]:
    """Return the names of the fields of a record that were made by `newer`."""
    return frozenset(each.name for each in fields(record) if each.metadata.get('newer'))
