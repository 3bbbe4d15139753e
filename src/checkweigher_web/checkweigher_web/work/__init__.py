# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work on a machine from the page, by the services of its nodes."""
