# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from node_process import process  # noqa: F401
