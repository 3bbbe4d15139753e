# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The parts of a pass, and what their weights make of it."""

from dataclasses import replace

import numpy as np
import pytest
from synthetic_line import make_pass

from checkweigher_dsp.estimation.estimators.learned import (
    Layout,
    Learned,
    LearnedParameters,
    pass_features,
)

# The pass of `make_pass` takes 0.2 s, half of it to come on.
LAYOUT = Layout(lead=4, rise=8, window=8)
PART = 0.2 / 16  # s
ROUNDING = 1e-6  # counts are 1e-9 kg, and a part has twelve samples


def ramp(time):
    """Return a disturbance that tells the time, kg."""
    return 0.01 * time


def quiet(**values):
    return make_pass(1e-9, disturbance=ramp, **values)


def test_each_part_has_the_mean_of_its_time():
    features = pass_features(quiet(), LAYOUT)
    centres = PART * (np.arange(-4, 16) + 0.5)
    # But for the last part, whose last sample lies up to one interval before t3.
    assert features[:-1] == pytest.approx(ramp(centres)[:-1], abs=ROUNDING)
    assert features[-1] == pytest.approx(ramp(centres[-1]), abs=0.01 / 960)


def test_a_longer_product_has_the_same_parts_at_the_same_places_of_itself():
    window = quiet()
    longer = replace(window, t2=window.t1 + 150_000_000)
    begin = window.window_begin + 48  # 50 ms at 960 Hz
    features = pass_features(replace(longer, window_begin=begin), Layout(0, 8, 8))
    # 8 parts of the rise in 150 ms, 8 of the window in 50 ms.
    centres = np.concatenate([0.15 / 8 * (np.arange(8) + 0.5), 0.15 + 0.05 / 8 * np.arange(0.5, 8)])
    assert features[:-1] == pytest.approx(ramp(centres)[:-1], abs=0.01 / 960)


def test_an_eye_that_jitters_moves_no_part():
    window = quiet()
    assert pass_features(replace(window, t2=window.t2 + 1_000_000), LAYOUT) == pytest.approx(
        pass_features(window, LAYOUT), abs=0.01 / 960
    )


@pytest.mark.parametrize('layout', [Layout(40, 8, 8), Layout(0, 100, 0)])
def test_there_are_no_features_where_there_is_no_signal_or_no_part(layout):
    # 40 parts are 0.5 s; the signal begins 0.45 s before t1. Without t1 nothing is known.
    window = quiet()
    if layout.lead:
        assert np.all(np.isnan(pass_features(window, layout)))
    assert np.all(np.isnan(pass_features(replace(window, t1=None), layout)))


def test_close_behind_another_item_the_window_alone_is_used():
    # Weights that tell which of them are used: 1 kg a part of the lead.
    known = LearnedParameters(
        parts=8, rise_parts=8, lead_parts=4, gap=0.5, speeds=(1.0,),
        weights=(1.0,) * 4 + (0.0,) * 16, weights_alone=(0.125,) * 8,
    )  # fmt: skip
    empty = make_pass(0.2, disturbance=lambda time: np.where(time < 0, 0.001, 0.0))
    assert Learned(known).estimate(empty).mass == pytest.approx(0.004, rel=0.02)
    # 0.45 s of signal, and the item before left 0.09 s before t1: less than half of 0.2 s.
    close = replace(empty, empty_begin=int(0.36 * 960))
    assert Learned(known).estimate(close).mass == pytest.approx(0.2, rel=0.01)


def test_between_two_speeds_the_weights_are_between():
    known = LearnedParameters(
        parts=1, speeds=(0.5, 2.0), weights=(1.0, 4.0), weights_alone=(1.0, 4.0), gain=(1.0, 1.0),
        offset=(0.0, 0.0), std_dev=(0.0, 0.0), relative_std_dev=(0.0, 0.0),
        zero_std_dev=(0.0, 0.0),
    )  # fmt: skip
    mass = Learned(known).estimate(make_pass(0.2)).mass
    alone = Learned(replace(known, weights=(1.0, 1.0), weights_alone=(1.0, 1.0))).estimate(
        make_pass(0.2)
    )
    # 1 m/s is a third of the way.
    assert mass == pytest.approx(2.0 * alone.mass)
