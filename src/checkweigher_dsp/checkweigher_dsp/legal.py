# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Legally relevant software: the program and the libraries that decide masses and verdicts.

The digest covers every Python file and shared library of the packages in `OWN` and `LIBRARIES`,
except their tests. The digest also covers the Python version, and the name of the kernel of the
linear algebra library (BLAS) that this processor uses. Software that only shows, stores or
transmits results is in other packages, which the digest does not cover.
"""

from collections.abc import Iterator
import ctypes
from dataclasses import asdict, dataclass
from functools import cache
import hashlib
from importlib.metadata import version
from importlib.util import find_spec
import json
from pathlib import Path
import platform

import numpy as np

from checkweigher_core.input_files import sha256_of

OWN = ('checkweigher_core', 'checkweigher_dsp')
LIBRARIES = ('numpy', 'pywt')
_LEFT_OUT = {'tests', 'test', '__pycache__'}  # folders that the digest does not cover
_KERNEL = ('scipy_openblas_get_corename64_', 'scipy_openblas_get_corename', 'openblas_get_corename')


@dataclass(frozen=True, slots=True)
class LegalSoftware:
    """Digests of the parts of the legally relevant software, and their common digest."""

    # SHA-256 of all parts, hexadecimal.
    sha256: str
    # For each part by its name: SHA-256 of a package, Python version, or name of the BLAS kernel.
    parts: dict[str, str]

    @property
    def value(self) -> dict[str, object]:
        """Fields by name, as stored in an entry of the audit log."""
        return asdict(self)


@cache
def legal_software() -> LegalSoftware:
    """Return the digests of the legally relevant software.

    The first call computes the digests in about 0.3 s. Later calls return the same digests.
    """
    parts = {name: package_digest(name) for name in (*OWN, *LIBRARIES)}
    parts |= {'Python': platform.python_version(), 'BLAS kernel': blas_kernel()}
    text = json.dumps(parts, sort_keys=True)
    return LegalSoftware(hashlib.sha256(text.encode()).hexdigest(), parts)


def version_text() -> str:
    """Return the version and the digests of the legally relevant software as lines of text."""
    software = legal_software()
    lines = [
        f'checkweigher {version("checkweigher_dsp")}',
        f'legally relevant software, SHA-256: {software.sha256}',
        *(f'  {name:18} {value}' for name, value in software.parts.items()),
    ]
    return '\n'.join(lines)


def package_digest(package: str) -> str:
    """Return the SHA-256 digest of the names and contents of the files of a package."""
    digest = hashlib.sha256()
    for name, path in files_of(package):
        digest.update(f'{sha256_of(path)}  {name}\n'.encode())
    return digest.hexdigest()


def files_of(package: str) -> Iterator[tuple[str, Path]]:
    """Yield the name and path of each Python file and shared library of a package, except tests."""
    spec = find_spec(package)
    assert spec is not None
    assert spec.origin is not None
    root = Path(spec.origin).parent
    # Include the folder PACKAGE.libs, because the NumPy wheel stores its BLAS library there.
    for folder in (root, root.with_name(f'{package}.libs')):
        for path in sorted(folder.rglob('*')):
            name = path.relative_to(root.parent).as_posix()
            if _LEFT_OUT.isdisjoint(name.split('/')) and (
                path.suffix == '.py' or '.so' in path.suffixes
            ):
                yield name, path


def blas_kernel() -> str:
    """Return the name of the BLAS kernel that NumPy uses on this processor, or 'unknown'."""
    np.dot(np.ones(2), np.ones(2))  # This call loads the BLAS library.
    maps = Path('/proc/self/maps').read_text(encoding='utf-8', errors='replace').splitlines()
    for path in sorted({line.split(maxsplit=5)[-1] for line in maps if 'blas' in line}):
        library = ctypes.CDLL(path)
        for name in _KERNEL:
            if function := getattr(library, name, None):
                function.restype = ctypes.c_char_p
                return str(function().decode())
    return 'unknown'
