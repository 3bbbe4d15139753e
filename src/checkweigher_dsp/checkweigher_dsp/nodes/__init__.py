# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes. Each node contains one stage."""

import os

# One thread is fastest for the small matrices of an item. numpy reads the variable at its import.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
