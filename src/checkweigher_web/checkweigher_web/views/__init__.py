# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of a lane, one file each, listed in `registry.VIEWS`."""
