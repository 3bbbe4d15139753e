# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The time-varying low-pass against numbers worked by hand and a recursion of its own."""

import math

from hypothesis import given
from hypothesis import strategies as st
import numpy as np
import pytest

from checkweigher_dsp.estimation.estimators.tvlpf import lowpass_weights

RATE = 960.0
ROUNDING = 1e-12

SCHEDULES = st.tuples(
    st.integers(1, 4), st.floats(0, 400), st.floats(0, 40), st.floats(0, 1), st.just(RATE)
)


def _recursion(samples, sections, initial, final, decay, rate):
    """Return the output of the cascade as the field writes it, sample by sample."""
    state = [samples[0]] * sections
    for n, sample in enumerate(samples):
        cutoff = final + (initial - final) * decay**n
        alpha = 1 - math.exp(-2 * math.pi * cutoff / rate)
        passed = sample
        for section in range(sections):
            state[section] += alpha * (passed - state[section])
            passed = state[section]
    return passed


@given(SCHEDULES, st.integers(1, 120), st.integers(0, 2**32 - 1))
def test_the_weights_are_those_of_the_direct_recursion(schedule, count, seed):
    samples = np.random.default_rng(seed).standard_normal((3, count))
    result = samples @ lowpass_weights(count, *schedule)
    assert result == pytest.approx([_recursion(row, *schedule) for row in samples], abs=ROUNDING)
