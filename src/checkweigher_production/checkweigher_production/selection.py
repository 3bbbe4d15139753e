# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""File with the selected product, its limits and the batch, which are restored after a restart."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
import hashlib
import json
from pathlib import Path
from typing import Any, Self

from checkweigher_core.changes import BATCH, SELECTION
from checkweigher_core.parameters import SettingsError, parameter
from checkweigher_core.records import ProductOnLine
from checkweigher_core.settings_files import Settings, plain, read_settings, write_settings
from checkweigher_dsp.rejection.parameters import LIMITS, limits_of
from checkweigher_production.audit_log import Entry
from checkweigher_production.recipes import Product

FILE = 'on_line.state'  # name of the file in the folder of the batch records
_ANEW = 'select the product again'


@dataclass(frozen=True)
class Selection(Settings):
    """Last selection of product, limits and batch on the line."""

    batch: str = parameter('', 'name of the batch')
    before: str = parameter('', 'name of the previous batch, whose record may lack its end')
    products: Mapping[str, Product] = parameter(
        None, 'recipe of the selected product, by product name; none without a product'
    )
    limits: Mapping[str, Any] = parameter(
        None, 'limits of the product that the reject node uses, by parameter name'
    )
    entry: str = parameter('', 'hash of the last entry of the audit log when the file was written')
    sha256: str = parameter('', 'SHA-256 of all other fields, hexadecimal')

    @classmethod
    def of(
        cls, batch: str, before: str, product: Product | None, limits: ProductOnLine | None
    ) -> Self:
        """Return a selection of a batch and a product, with the limits in use.

        The selection has no product if `product` or `limits` is None. `before` is the name of the
        previous batch.
        """
        if product is None or limits is None:
            return cls(batch=batch, before=before)
        products = {product.name: product}
        return cls(batch=batch, before=before, products=products, limits=limits_of(limits))

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Check the SHA-256 in the content of a file, and return the content unchanged.

        Raises `SettingsError` if the content is not a mapping or its SHA-256 is wrong.
        """
        if not isinstance(content, dict) or content.get('sha256') != _digest(content):
            raise SettingsError(f'was changed after it was written; {_ANEW}')
        return content

    @property
    def product(self) -> Product | None:
        """Recipe of the selected product, or None if the product or a limit is missing."""
        known = (self.limits or {}).keys() == {*LIMITS}
        return next(iter((self.products or {}).values()), None) if known else None

    @property
    def on_line(self) -> ProductOnLine | None:
        """Record of the selected product and its limits for the reject node.

        The value is None if `product` is None. The limits are read from the file, not from the
        recipe.
        """
        product = self.product
        return None if product is None else replace(product.on_line(self.batch), **self.limits)


def read_selection(folder: Path, entries: Sequence[Entry]) -> Selection | None:
    """Return the selection that is stored in a folder, or None if there is no file.

    Raises `SettingsError` if the file cannot be used, or if `entries`, the entries of the audit
    log, contain a later selection.
    """
    path = folder / FILE
    if not path.exists():
        return None
    found = read_settings(path, Selection)
    if _has_later_selection(entries, found.entry):
        raise SettingsError(f'{path}: the audit log has a later selection; {_ANEW}')
    return found


def write_selection(folder: Path, selection: Selection) -> None:
    """Write a selection to its file. If OSError is raised, the file is unchanged."""
    content = {'format': selection.format, **plain(selection)}
    write_settings(folder / FILE, replace(selection, sha256=_digest(content)))


def _has_later_selection(entries: Sequence[Entry], last: str) -> bool:
    """Return whether an entry after the entry with the hash `last` selects a product or a batch.

    If no entry has the hash `last`, all entries are checked.
    """
    for entry in reversed(entries):
        if entry.hash == last:
            return False
        if entry.kind in (SELECTION, BATCH):
            return True
    return False


def _digest(content: Mapping[str, Any]) -> str:
    others = {key: value for key, value in content.items() if key != 'sha256'}
    return hashlib.sha256(json.dumps(others, sort_keys=True).encode()).hexdigest()
