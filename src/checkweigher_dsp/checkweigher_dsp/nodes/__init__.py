# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes, each of which runs one stage of the line."""

import os

# Set the number of threads here, because numpy reads this variable when it is imported. One thread
# is fastest for the small matrices of an item.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
