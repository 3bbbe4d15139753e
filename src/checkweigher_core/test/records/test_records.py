# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The values that pass between the stages."""

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
from checkweigher_core.records.reasons import Reason

LOAD_CELL = LoadCell(
    sample_rate=960.0,
    counts_per_kg=1e6,
    zero_counts=5000.0,
    min_counts=-(2**23),
    max_counts=2**23 - 1,
    capacity=7.2,
    weigh_length=0.2,
)
WINDOW = WeighWindow(1, 0, 10, 20, counts_per_kg=1e6, counts=np.full(20, 100, np.int32))


@pytest.mark.parametrize(
    ('name', 'value'),
    [
        ('sample_rate', 0.0),
        ('sample_rate', -960.0),
        ('sample_rate', math.nan),
        ('sample_rate', math.inf),
        ('capacity', 0.0),
        ('weigh_length', -0.2),
        ('weigh_length', math.nan),
        ('counts_per_kg', 0.0),
        ('counts_per_kg', math.nan),
        ('zero_counts', math.inf),
        ('zero_counts', 1e308),
        ('zero_counts', 2.0**23),
        ('min_counts', 2**23 - 1),
        ('min_counts', -(2**31) - 1),
        ('sample_rate', 1e-300),
        ('sample_rate', 1e7),
        ('counts_per_kg', 1e300),
        ('counts_per_kg', -1e-300),
        ('weigh_length', 1e6),
        ('capacity', math.inf),
    ],
)
def test_what_cannot_describe_a_load_cell_is_refused_by_name(name, value):
    with pytest.raises(ValueError, match=f'load cell: {name} '):
        replace(LOAD_CELL, **{name: value})


def test_a_load_cell_may_be_mounted_upside_down():
    assert replace(LOAD_CELL, counts_per_kg=-1e6).counts_per_kg == -1e6


@pytest.mark.parametrize('mass', [-0.1, math.nan, math.inf, 1e308])
def test_what_is_no_mass_is_no_reference(mass):
    with pytest.raises(ValueError, match='a reference mass of'):
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


_OTHER = {'counts': np.zeros(3, np.int32), 'denoised': np.zeros(3), 'reasons': ('SamplesLost',)}


@pytest.mark.parametrize('name', [entry.name for entry in fields(WeighWindow)])
def test_windows_that_differ_in_one_field_are_not_equal(name):
    window = WINDOW

    assert replace(window, **{name: _OTHER.get(name, 77)}) != window


def test_windows_that_differ_in_one_sample_are_not_equal():
    window = WINDOW
    counts = window.counts.copy()
    counts[7] += 1

    assert replace(window, counts=counts) != window


def test_force_is_the_load_without_the_zero():
    window = WeighWindow(
        1, 0, 1, 2, counts_per_kg=-50.0, zero=100.0, counts=np.array([100, 50, -50], np.int32)
    )

    np.testing.assert_array_equal(window.force, [0.0, 1.0, 3.0])


def test_an_estimate_is_weighed_unless_it_has_a_reason():
    assert MassEstimate(1, 0, 1, 2, mass=0.1).weighed
    assert not MassEstimate(1, 0, 1, 2, ('SamplesLost',), mass=0.1).weighed


def test_each_reason_has_a_hint_of_its_own():
    assert len({reason.hint for reason in Reason}) == len(Reason)


def test_a_sample_rate_that_no_load_cell_has_is_refused():
    with pytest.raises(ValueError, match='sample_rate is 1e'):
        replace(LOAD_CELL, sample_rate=1e12)


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
    # NaN is not equal to itself.
    assert repr(arrived) == repr(record)
