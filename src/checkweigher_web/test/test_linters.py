# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ament linters on the sources and the package.xml of this package."""

from linters import test_a_linter_finds_nothing  # noqa: F401
