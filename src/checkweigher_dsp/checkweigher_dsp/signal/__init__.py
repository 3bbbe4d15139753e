# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Algorithms that several stages use: averages, autoregression, Kalman filter, platform model."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
