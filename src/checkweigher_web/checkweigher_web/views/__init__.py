# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Views of a lane or a recorded shift, which `registry.VIEWS` lists in the order of the page."""
