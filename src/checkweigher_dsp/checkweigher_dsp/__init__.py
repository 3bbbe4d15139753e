# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The weighing of an in-motion checkweigher: stages, estimators and their nodes."""
