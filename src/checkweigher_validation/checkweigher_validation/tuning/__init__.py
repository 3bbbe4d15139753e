# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learning the parameters of the estimators from passes of known mass."""
