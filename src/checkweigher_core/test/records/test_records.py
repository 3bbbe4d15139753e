# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the records that the stages exchange."""

from dataclasses import fields, replace
import math
import pickle

import numpy as np
import pytest

from checkweigher_core.records import (
    Eye,
    EyeEdge,
    LoadCell,
    MassEstimate,
    Reference,
    WeighWindow,
    seconds,
)

LOAD_CELL = LoadCell(960.0, 1e6, 5000.0, -(2**23), 2**23 - 1, 7.2, 0.2)
WINDOW = WeighWindow(1, 0, 10, 20, counts_per_kg=1e6, counts=np.full(20, 100, np.int32))


IMPOSSIBLE = {
    'sample_rate': (0.0, -960.0, math.nan, math.inf, 1e-300, 1e7, 1e12),
    'counts_per_kg': (0.0, math.nan, 1e300, -1e-300),
    'zero_counts': (math.inf, 1e308, 2.0**23),
    'min_counts': (2**23 - 1, -(2**31) - 1),
    'capacity': (0.0, math.inf),
    'weigh_length': (-0.2, math.nan, 1e6),
}


@pytest.mark.parametrize(
    ('name', 'value'), [(name, value) for name, values in IMPOSSIBLE.items() for value in values]
)
def test_what_cannot_describe_a_load_cell_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f'load cell: {name} '):
        replace(LOAD_CELL, **{name: value})


@pytest.mark.parametrize('mass', [-0.1, math.nan, math.inf, 1e308])
def test_what_is_no_mass_is_no_reference(mass):
    with pytest.raises(ValueError, match='reference mass is'):
        Reference(0, mass)


def test_a_stamp_in_seconds():
    assert seconds(1_500_000_000) == 1.5
    assert math.isnan(seconds(None))


def test_windows_of_equal_fields_are_equal_unknown_ones_included():
    unknown = WeighWindow(1, None, None, None)
    assert unknown == WeighWindow(1, None, None, None)
    assert replace(WINDOW, counts=WINDOW.counts.copy()) == WINDOW
    assert unknown != WINDOW
    assert unknown != 'window'


_OTHER = {
    'counts': np.where(np.arange(20) == 7, 101, WINDOW.counts),  # one sample differs
    'denoised': np.zeros(3),
    'reasons': ('SamplesLost',),
}


@pytest.mark.parametrize('name', [entry.name for entry in fields(WeighWindow)])
def test_windows_that_differ_in_one_field_are_not_equal(name):
    assert replace(WINDOW, **{name: _OTHER.get(name, 77)}) != WINDOW


def test_force_is_the_load_without_the_zero():
    window = WeighWindow(
        1, 0, 1, 2, counts_per_kg=-50.0, zero=100.0, counts=np.array([100, 50, -50], np.int32)
    )

    np.testing.assert_array_equal(window.force, [0.0, 1.0, 3.0])


@pytest.mark.parametrize(
    'record',
    [
        EyeEdge(7, Eye.OUTFEED, True),
        Reference(7, 0.1345),
        MassEstimate(3, 1, None, 4, ('MissingEdge',), mass=0.2, estimator='mean', a1=-1.5),
        WeighWindow(
            3, 1, 2, 4, 0.5, counts=np.arange(5, dtype=np.int32), denoised=np.linspace(0, 1, 5)
        ),
    ],
    ids=lambda record: type(record).__name__,
)
def test_what_goes_to_another_process_arrives_as_it_was(record):
    arrived = pickle.loads(pickle.dumps(record))

    assert type(arrived) is type(record)
    # Compare the texts, because a NaN is not equal to itself.
    assert repr(arrived) == repr(record)
