# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes around the stages: parameters in, message to record, stage, record to message."""

import os

# Several threads slow down the small matrices of an item. Set before numpy reads it.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
