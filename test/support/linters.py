# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Linters of ament on the package of a test module, where an installation has them."""

from pathlib import Path

import pytest

UNDOCUMENTED = 'D100', 'D101', 'D102', 'D103', 'D104', 'D105', 'D106', 'D107'
# ament_copyright cannot read SPDX-License-Identifier, so test_packages.py checks the headers.
LINTERS = {
    'ament_flake8': ['--config', str(Path(__file__).with_name('ament_flake8.ini'))],
    # In numpydoc's convention. ament_flake8 checks D401 as well, but lets properties be nouns.
    'ament_pep257': ['--convention', 'numpy', '--add-ignore', 'D401', *UNDOCUMENTED],
    'ament_xmllint': [],
}


@pytest.mark.linter
@pytest.mark.parametrize('linter', LINTERS)
def test_a_linter_finds_nothing(linter: str, request: pytest.FixtureRequest):
    main = pytest.importorskip(f'{linter}.main').main
    assert main(argv=[*LINTERS[linter], str(request.path.parents[1])]) == 0
