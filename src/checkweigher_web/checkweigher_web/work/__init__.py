# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Work on the machine from the page, by the services that the commands call."""
