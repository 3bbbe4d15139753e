# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Identity of the program that computes results."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
import hashlib
from importlib.metadata import version
import platform

from checkweigher_dsp.legal import package_digest

_WEIGHING = ('core', 'dsp', 'recording', 'validation')  # packages on which the results depend
_LIBRARIES = ('numpy', 'scipy', 'PyWavelets', 'pyarrow')


@dataclass(frozen=True, slots=True)
class Program:
    """Version and digest of the program, and versions of Python and the libraries.

    Equal programs compute equal results on processors of the same type.
    """

    version: str
    sha256: str
    libraries: tuple[str, ...]

    def __str__(self) -> str:
        return f'checkweigher {self.version} ({self.sha256[:8]}; {", ".join(self.libraries)})'


@cache
def program() -> Program:
    """Return the identity of the program of this process."""
    libraries = [f'{name} {version(name)}' for name in _LIBRARIES]
    return Program(
        version('checkweigher_validation'),
        program_digest(_WEIGHING),
        (f'Python {platform.python_version()}', *libraries),
    )


def other_program(there: Program, here: Program) -> str:
    """Return a line on why a worker cannot be used, or an empty string if the worker can be used.

    `there` is the program of the worker and `here` the program of this process.
    """
    if there == here:
        return ''
    return f'the worker runs {there}, but this process runs {here}; install the same version'


def program_digest(packages: Iterable[str]) -> str:
    """Return the SHA-256 digest of the names and contents of all Python files of some packages.

    `packages` contains the names of the packages without the prefix ``checkweigher_``.
    """
    digests = [package_digest(f'checkweigher_{package}') for package in packages]
    return hashlib.sha256(''.join(digests).encode()).hexdigest()
