# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""ROS nodes around the stages: parameters in, message to record, stage, record to message."""

import os

# Matrices as small as those of an item are slower on several threads. Before numpy reads it.
os.environ.setdefault('OPENBLAS_NUM_THREADS', '1')
