# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of a lane, which `registry.VIEWS` lists. Each view is a module."""
