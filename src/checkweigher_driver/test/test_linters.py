# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The sources and the package.xml of this package pass the linters of ament."""

from linters import test_a_linter_finds_nothing  # noqa: F401
