# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes. Each node runs one stage of the line."""

import os

# Set the number of threads here, before a node imports numpy, because numpy reads the variable when
# it is imported. One thread is fastest for the small matrices of an item.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
