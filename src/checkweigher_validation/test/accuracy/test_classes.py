# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Limits of OIML R 51-1 and GB/T 27739 against numbers worked by hand."""

import math
import re

from hypothesis import given
from hypothesis import strategies as st
from made_evaluations import errors_with, make_condition
import pytest

from checkweigher_validation.accuracy.classes import (
    CLASSES,
    AccuracyClass,
    check_range,
    judge,
    smallest_interval,
    suitability,
    weighings_required,
)

FACTORS = {'XI': 0.5, 'XII': 0.5, 'XIIII': 2}  # a factor for each class that may not have 1
EXACT = 1e-12  # relative


@pytest.mark.parametrize(
    ('mass', 'mean_error', 'std_dev'),
    [
        # 745 e, 1345 e, 1645 e, 1945 e: 1 e. 2545 e: 1.5 e.
        (0.0745, 0.1e-3, 0.24e-3),  # 50 g to 100 g: 0.24 g
        (0.1345, 0.1e-3, 0.3228e-3),  # 100 g to 200 g: 0.24 % of 134.5 g
        (0.1645, 0.1e-3, 0.3948e-3),
        (0.1945, 0.1e-3, 0.4668e-3),
        (0.2545, 0.15e-3, 0.48e-3),  # 200 g to 300 g: 0.48 g
    ],
)
def test_limits_of_class_xiii_1_are_those_of_table_2_of_the_paper(mass, mean_error, std_dev):
    assert AccuracyClass().max_error(mass) == pytest.approx(mean_error, rel=EXACT)
    assert AccuracyClass().max_std_dev(mass) == pytest.approx(std_dev, rel=EXACT)


@pytest.mark.parametrize(
    ('names', 'loads'),
    [
        (('XI', 'Y(I)'), (50_000, 200_000)),
        (('XII', 'Y(II)'), (5_000, 20_000, 100_000)),
        (('XIII', 'Y(a)'), (500, 2_000, 10_000)),
        (('XIIII', 'Y(b)'), (50, 200, 1_000)),
    ],
)
@pytest.mark.parametrize('interval', [1e-4, 5e-3])
def test_the_error_steps_right_after_its_loads(names, loads, interval):
    # Tables of the directive, in e: initially and in service.
    steps = {
        names[0]: ((0.5, 1.0, 1.5, math.nan), (1.0, 2.0, 3.0, math.nan)),
        names[1]: ((1.0, 1.5, 2.0, math.nan), (1.5, 2.5, 3.5, math.nan)),
    }
    for name, by_service in steps.items():
        for in_service, errors in zip((False, True), by_service, strict=True):
            limits = AccuracyClass(name, FACTORS.get(name, 1), interval, in_service)
            for number, load in enumerate(loads):
                at, above = (limits.max_error((load + more) * interval) for more in (0, 1e-3))
                assert at == pytest.approx(errors[number] * interval)
                assert above == pytest.approx(errors[number + 1] * interval, nan_ok=True)


@pytest.mark.parametrize(('mass', 'steps'), [(0.05, 0.5), (0.2, 1.0), (1.0, 1.5)])
@pytest.mark.parametrize('name', ['XIII', 'Y(a)'])
@pytest.mark.parametrize('in_service', [False, True])
def test_loads_at_rest_have_one_limit_in_both_categories(name, in_service, mass, steps):
    # UK SI 2016/1153, Schedule 1G, Chapter II, Table 1 (Static); NI SR 2006/154, Schedule 5.
    limit = AccuracyClass(name, in_service=in_service).max_static_error(mass)
    assert limit == pytest.approx((2 if in_service else 1) * steps * 1e-4, rel=EXACT)


@pytest.mark.parametrize(
    ('mass', 'initial', 'in_service'),
    [
        (0.010, 0.048e-3, 0.06e-3),
        (0.050, 0.24e-3, 0.3e-3),
        (0.075, 0.24e-3, 0.3e-3),
        (0.150, 0.36e-3, 0.45e-3),
        (0.250, 0.48e-3, 0.6e-3),
        (0.300, 0.48e-3, 0.6e-3),
        (0.400, 0.64e-3, 0.8e-3),
        (0.750, 0.8e-3, 1.0e-3),
        (5.0, 4e-3, 5e-3),
        (12.0, 8e-3, 10e-3),
        (20.0, 10.6e-3, 13.4e-3),
    ],
)
def test_standard_deviations_of_each_row_are_those_worked_by_hand(mass, initial, in_service):
    assert AccuracyClass().max_std_dev(mass) == pytest.approx(initial, rel=EXACT)
    assert AccuracyClass(in_service=True).max_std_dev(mass) == pytest.approx(in_service, rel=EXACT)


@given(st.floats(1e-3, 50), st.sampled_from([0.02, 0.1, 0.5, 1.0]))
def test_the_class_factor_scales_the_standard_deviation_alone(mass, factor):
    scaled = AccuracyClass(factor=factor)
    expected = factor * AccuracyClass().max_std_dev(mass)
    assert scaled.max_std_dev(mass) == pytest.approx(expected, rel=EXACT)
    assert scaled.max_error(0.1) == AccuracyClass().max_error(0.1)
    assert AccuracyClass('XI', 0.5).max_error(1e4 * mass) > 0  # there is no largest load


@pytest.mark.parametrize(
    ('name', 'allowed', 'refused'),
    [
        # MID, Annex VIII, Chapter II, 4.2; at most 2 by R 51.
        ('XI', (0.01, 0.5), (1, 2)),
        ('XII', (0.2, 0.5), (1, 2)),
        ('XIII', (0.1, 0.5, 1), (2,)),
        ('XIIII', (2,), (0.5, 1, 5)),
    ],
)
def test_each_class_has_the_factors_of_the_directive(name, allowed, refused):
    for factor in allowed:
        assert str(AccuracyClass(name, factor)).startswith(f'{name}({factor:g}), ')
    for factor in refused:
        with pytest.raises(ValueError, match=f'class factor x.*: {factor} is not '):
            AccuracyClass(name, factor)


def test_weighings_required_are_those_of_the_rule():
    masses = (0.1, 1.0, 1.1, 10.0, 15.0, 20.0, 21.0)
    assert [weighings_required(mass) for mass in masses] == [60, 60, 30, 30, 20, 20, 10]


@pytest.mark.parametrize(
    ('mean', 'std_dev', 'kept'),
    [
        (-0.099e-3, 0.39e-3, (True, True)),
        (-0.101e-3, 0.39e-3, (False, True)),
        (0.099e-3, 0.4e-3, (True, False)),
    ],
)
def test_a_condition_passes_within_both_limits(mean, std_dev, kept):
    verdict = judge(make_condition(errors_with(mean, std_dev)), AccuracyClass())

    assert (verdict.error_passed, verdict.std_dev_passed) == kept
    assert verdict.passed == all(kept)
    assert (verdict.weighings, verdict.weighings_required) == (60, 60)
    assert verdict.max_error == pytest.approx(0.1e-3)
    assert verdict.max_std_dev == pytest.approx(0.3948e-3)


def test_the_nameplate_decides_which_limits_hold():
    one = make_condition(errors_with(0.15e-3, 0.45e-3))

    assert not judge(one, AccuracyClass()).passed
    # In service 0.2 g and 0.3 % of 164.5 g = 0.4935 g.
    assert judge(one, AccuracyClass(in_service=True)).passed
    # With x = 2 and e = 0.1 g only the standard deviation is within: the load is above 1000 e.
    assert judge(one, AccuracyClass('XIIII', 2)).std_dev_passed
    assert not judge(one, AccuracyClass('XIIII', 2)).error_passed
    # With e = 0.2 g the load is 822.5 e: 1 e.
    assert judge(one, AccuracyClass(interval=0.2e-3)).error_passed


def test_too_few_weighings_none_at_all_and_a_load_above_the_class_do_not_pass():
    few = judge(make_condition(errors_with(0, 1e-6, count=58), faults=2), AccuracyClass())
    assert (few.enough_weighings, few.passed) == (False, False)
    none = judge(make_condition([], faults=60), AccuracyClass())
    assert (none.error_passed, none.std_dev_passed) == (False, False)
    # XIIII goes up to 1000 e = 100 g.
    above = judge(make_condition(errors_with(0, 1e-6)), AccuracyClass('XIIII', 2))
    assert math.isnan(above.max_error)
    assert not above.passed


@pytest.mark.parametrize(
    'refused',
    [
        lambda: AccuracyClass('X'),
        lambda: AccuracyClass(factor=0),
        lambda: AccuracyClass(factor=0.3),
        lambda: AccuracyClass(factor=5),
        lambda: AccuracyClass('Y(a)', factor=0.5),
        lambda: smallest_interval('XIIII', 0.1),
        lambda: AccuracyClass(interval=math.nan),
        lambda: AccuracyClass('xiii'),
    ],
)
def test_what_no_class_has_is_refused(refused):
    with pytest.raises(ValueError, match=r'not one of|not a positive|class factor|no verification'):
        refused()


def test_there_are_four_classes_of_each_category():
    assert CLASSES == ('XI', 'XII', 'XIII', 'XIIII', 'Y(I)', 'Y(II)', 'Y(a)', 'Y(b)')
    assert str(AccuracyClass()) == 'XIII(1), e = 0.1 g, initial verification'
    assert str(AccuracyClass('Y(a)', in_service=True)) == 'Y(a), e = 0.1 g, in service'
    # GB/T 27739 writes it so.
    assert AccuracyClass('XIV', 2) == AccuracyClass('XIIII', 2)


def test_one_weighing_beyond_the_limit_of_category_y_fails():
    # 1645 e: 1.5 e = 0.15 g. The mean is right, and of category X the spread as well.
    errors = errors_with(0, 0.01e-3)
    assert AccuracyClass('Y(a)').max_std_dev(0.1) == math.inf
    assert judge(make_condition(errors), AccuracyClass('Y(a)')).passed
    errors[7] = 0.16e-3
    assert judge(make_condition(errors), AccuracyClass()).passed
    assert not judge(make_condition(errors), AccuracyClass('Y(a)')).error_passed


@pytest.mark.parametrize(
    ('name', 'maximum', 'interval'),
    [
        ('XIII', 1.0, 0.1e-3),
        ('XIII', 1.01, 0.2e-3),
        ('XIII', 7.2, 1e-3),
        ('Y(a)', 20.0, 2e-3),
        ('XIII', 20.1, 5e-3),
        ('XIIII', 7.2, 10e-3),
        ('XII', 7.2, 0.1e-3),
        ('XII', 2.0, 0.02e-3),
        ('Y(I)', 7.2, 1e-6),
    ],
)
def test_e_is_the_smallest_that_the_class_allows_for_max(name, maximum, interval):
    assert smallest_interval(name, maximum) == pytest.approx(interval, rel=EXACT)


@pytest.mark.parametrize(
    ('name', 'interval', 'minimum', 'maximum', 'complaint'),
    [
        # Rows of MID, Annex VIII, Chapter II, Table 3: g.
        ('XI', 0.001, 1, 50, ''),
        ('XI', 0.001, 1, 49, 'class XI has no verification scale interval'),
        ('XI', 1, 1, 49_000, 'e: 1 g gives 49000 intervals'),
        ('XII', 0.05, 1, 5, ''),
        ('XII', 0.05, 1, 4.9, 'e: 0.05 g gives 98 intervals'),
        ('XII', 0.1, 1, 500, ''),
        ('XII', 0.1, 1, 499, 'e: 0.1 g gives 4990 intervals'),
        ('XII', 0.1, 1, 10_001, 'e: 0.1 g is below 0.2 g'),
        ('XIII', 2, 60, 200, ''),
        ('XIII', 2, 60, 199, 'e: 2 g gives 99.5 intervals'),
        ('XIII', 5, 60, 2500, ''),
        ('XIII', 5, 60, 2499, 'e: 5 g gives 499.8 intervals'),
        ('XIII', 0.25, 60, 600, 'e: 0.25 g is not 1, 2 or 5'),
        ('XIIII', 5, 60, 500, ''),
        ('XIIII', 5, 60, 499, 'class XIIII has no verification scale interval'),
        ('XIIII', 2, 60, 600, 'e: 2 g is below 5 g'),
        # UK SI 2003/2761, Schedule 1.
        ('Y(a)', 0.1, 2, 600, ''),
        ('Y(a)', 0.1, 1.9, 600, 'Min: 1.9 g is below 2 g, the smallest of class Y(a): 20 e'),
        ('Y(b)', 5, 50, 500, ''),
        ('Y(b)', 5, 49, 500, 'Min: 49 g is below 50 g, the smallest of class Y(b): 10 e'),
        ('XIII', 0.1, 0.1, 600, ''),  # none is known
    ],
)
def test_a_range_that_no_class_allows_is_refused_with_the_rule(
    name: str, interval: float, minimum: float, maximum: float, complaint: str
):
    own = AccuracyClass(name, FACTORS.get(name, 1), interval * 1e-3)
    if not complaint:
        check_range(own, minimum * 1e-3, maximum * 1e-3)
        return
    with pytest.raises(ValueError, match=re.escape(complaint)):
        check_range(own, minimum * 1e-3, maximum * 1e-3)


@pytest.mark.parametrize(
    ('name', 'interval', 'nominal', 'max_error', 'allowed'),
    [
        ('XIII', 1e-3, 0.25, 1e-3, 1.8e-3),  # up to 500 e in service 1 e; TNE 9 g
        ('XIII', 1e-3, 0.1, 1e-3, 0.9e-3),  # TNE 4.5 g
        ('XIII', 1e-3, 1.0, 2e-3, 3e-3),  # 500 to 2000 e: 2 e; TNE 15 g
        ('XIII', 2e-3, 0.75, 2e-3, 3e-3),
        ('Y(a)', 1e-3, 0.25, 1.5e-3, 1.8e-3),
        ('Y(a)', 2e-3, 0.25, 3e-3, 1.8e-3),
        ('XIIII', 5e-3, 5.5, math.nan, 16.5e-3),  # above 1000 e
        # TNE 15 g, 1 e. No nameplate has such e, but they are just a fifth and just above.
        ('XIII', 3e-3, 0.5, 3e-3, 3e-3),
        ('XIII', 3.001e-3, 0.5, 3.001e-3, 3e-3),
    ],
)
def test_a_class_checks_prepackages_of_five_times_its_error_in_service(
    name: str, interval: float, nominal: float, max_error: float, allowed: float
):
    found = suitability(AccuracyClass(name, FACTORS.get(name, 1), interval), nominal)
    assert found.max_error == pytest.approx(max_error, nan_ok=True)
    assert found.allowed_error == pytest.approx(allowed)
    assert found.suitable == (max_error <= allowed)
