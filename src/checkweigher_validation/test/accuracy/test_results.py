# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The summary below a table of items."""

import numpy as np
import pytest

from checkweigher_validation.accuracy.results import ErrorSum


def test_errors_are_summed_without_being_kept():
    errors = np.random.default_rng(3).normal(0.1, 2.0, 1000).tolist()
    found = ErrorSum()

    for error in errors:
        found.add(error)

    assert found.count == 1000
    assert (found.mean, found.std_dev) == pytest.approx((np.mean(errors), np.std(errors, ddof=1)))
    assert found.largest == max(errors, key=abs)
