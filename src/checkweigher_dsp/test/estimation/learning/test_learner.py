# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learning item by item: what it weighs, keeps, forgets and notices."""

from dataclasses import replace
import json

import numpy as np
import pytest
from synthetic_line import make_pass

from checkweigher_core.health.findings import Level
from checkweigher_core.settings_files import plain, settings_of
from checkweigher_dsp.estimation.estimators.averages import MeanParameters
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.estimation.learning.learner import LearnedKinds, LearningParameters
from checkweigher_dsp.health.learning import learning_finding

PARAMETERS = IdentifierParameters(estimator='mean', learn=True)
MASSES = (0.1, 0.15, 0.2)


def items(count, seed=1, line=0.0, bump=0.0, first=0, **fields):
    """Return windows of items on a belt with a line of 13 Hz.

    Each item swings at 21 Hz after it has come on, by another part of its mass. A `line` is
    a frequency that comes on top, a `bump` the part of the mass that the load has more half way in.
    """
    random = np.random.default_rng(seed)
    windows = []
    for number in range(count):
        mass = MASSES[(first + number) % len(MASSES)]
        phases, swing = random.uniform(0, 2 * np.pi, 3), random.standard_normal()

        def disturbance(time, mass=mass, phases=phases, swing=swing):
            turns = 2 * np.pi * time
            after = np.maximum(time - 0.05, 0)
            entry = np.where(time > 0.05, np.exp(-after / 0.06) * np.sin(21 * turns), 0)
            way = np.clip(time / 0.1, 0, 1)
            return (
                3e-4 * np.cos(13 * turns + phases[0])
                + 6e-3 * mass * swing * entry
                + (1e-3 * np.cos(line * turns + phases[1]) if line else 0.0)
                + bump * mass * way * (1 - way)
                + 3e-4 * random.standard_normal(len(time))
            )

        window = make_pass(mass, disturbance=disturbance, **fields)
        windows.append(replace(window, item_id=first + number + 1))
    return windows


def taught(*batches, **parameters):
    """Return an identifier that has learned from batches of windows, and their last estimates."""
    identifier = Identifier(replace(PARAMETERS, **parameters))
    for windows in batches:
        estimates = identifier.estimate_all(windows)
    identifier.learn()
    return identifier, estimates


def masses(estimates):
    return [(each.item_id, each.mass, each.std_dev) for each in estimates]


def scatter(estimates):
    """Return the standard deviation within a mass."""
    found = np.array([each.mass for each in estimates])
    kind = np.array([each.item_id % len(MASSES) for each in estimates])
    return float(np.sqrt(np.mean([np.var(found[kind == each], ddof=1) for each in set(kind)])))


def test_after_thirty_items_the_masses_scatter_less_and_say_so():
    windows = items(90)
    plain = Identifier(replace(PARAMETERS, learn=False)).estimate_all(windows)
    identifier, learned = taught(windows)

    assert [each.mass for each in learned[:30]] == [each.mass for each in plain[:30]]
    assert scatter(learned[30:]) < 0.5 * scatter(plain[30:])
    # The gain stays that of the estimator, which is all that needs a reference.
    assert np.mean([each.mass for each in learned[30:]]) == pytest.approx(
        np.mean([each.mass for each in plain[30:]]), rel=2e-3
    )
    finding = learning_finding(identifier.learned, PARAMETERS.learning, on=True)
    assert finding.level is Level.OK
    assert 'weighs; standard deviation' in finding.values['1.000 m/s, 100 mm']
    # The load comes on evenly: at quarters of t1..t2 a quarter of it each.
    assert 'final load' in finding.values['1.000 m/s, 100 mm']


def test_with_gain_and_offset_from_references_the_stated_deviation_is_that_of_the_masses():
    known = MeanParameters(calibrated=True, gain=(1.0,), std_dev=(5e-3,))
    identifier = Identifier(replace(PARAMETERS, mean=known))
    learned = identifier.estimate_all(items(200))[50:]
    stated = np.array([each.std_dev for each in learned])
    assert np.sqrt(np.mean(stated**2)) == pytest.approx(scatter(learned), rel=0.25)


def test_beyond_the_trained_masses_the_deviation_of_learned_weights_grows():
    known = MeanParameters(calibrated=True, std_dev=(5e-3,))
    narrow = replace(known, lightest_mass=(0.1,), heaviest_mass=(0.1,))
    windows = items(200)
    everywhere, beyond = (
        Identifier(replace(PARAMETERS, mean=each)).estimate_all(windows)[-1]
        for each in (known, narrow)
    )
    more = narrow.extrapolation_std_dev(beyond.mass, 1.0)
    assert beyond.mass == everywhere.mass == pytest.approx(MASSES[199 % 3], abs=2e-3)
    assert beyond.std_dev == pytest.approx(np.hypot(everywhere.std_dev, more), rel=1e-9)
    assert beyond.std_dev > 1.1 * everywhere.std_dev


def test_the_masses_depend_on_the_order_of_the_items_alone():
    windows = items(70)
    at_once = Identifier(PARAMETERS).estimate_all(windows)
    one_by_one = Identifier(PARAMETERS)
    assert masses(one_by_one.estimate(window) for window in windows) == masses(at_once)
    early = Identifier(PARAMETERS)
    for window, expected in zip(windows, at_once, strict=True):
        assert masses([early.estimate(window)]) == masses([expected])
        early.learn()  # as the node does, before the next one comes


@pytest.mark.parametrize('when', [17, 45])
def test_a_line_that_was_started_again_goes_on_with_the_same_bits(when):
    windows = items(70)
    before, _ = taught(windows[:when])

    after = Identifier(
        PARAMETERS, settings_of(LearnedKinds, json.loads(json.dumps(plain(before.learned))))
    )

    rest = windows[when:]
    assert masses(after.estimate_all(rest)) == masses(before.estimate_all(rest))


def test_what_rests_on_another_estimator_or_calibration_is_worth_nothing():
    identifier, _ = taught(items(40))
    for other in (
        replace(PARAMETERS, estimator='hann'),
        replace(PARAMETERS, mean=MeanParameters(gain=(1.01,))),
    ):
        assert not Identifier(other, identifier.learned).learned.kinds
    assert Identifier(PARAMETERS, identifier.learned).learned.kinds


def test_what_was_forgotten_does_not_weigh():
    windows = items(60)
    plain = Identifier(replace(PARAMETERS, learn=False)).estimate_all(windows)
    identifier, _ = taught(windows[:50])
    identifier.forget()
    assert masses(identifier.estimate_all(windows[50:])) == masses(plain[50:])


def test_memory_is_bounded_in_items_and_in_kinds():
    known = LearningParameters(fewest=20, most=20, kinds=2)
    lengths = (0.06, 0.08, 0.1)
    identifier, _ = taught(*(items(25, product_length=each) for each in lengths), learning=known)
    assert [kind.length for kind in identifier.learned.kinds] == [0.08, 0.1]
    assert all(not kind.passages and len(kind.recent) <= 20 for kind in identifier.learned.kinds)


@pytest.mark.parametrize('relearn', [False, True])
def test_a_vibration_that_is_new_is_told_with_its_frequency(relearn):
    learning = LearningParameters(relearn=relearn)
    changed = items(100, seed=2, line=33.0, first=130)
    plain = Identifier(replace(PARAMETERS, learn=False)).estimate_all(changed)
    identifier, estimates = taught(items(130), changed, learning=learning)

    (kind,) = identifier.learned.kinds
    if relearn:
        assert kind.change is None
        assert kind.weighs
        assert scatter(estimates[-40:]) < 0.5 * scatter(plain[-40:])
        return
    assert kind.change.frequency == pytest.approx(33.0, abs=1.0)
    assert 130 < kind.change.item_id <= 150
    # What was learned is of another machine, and does not weigh any more.
    assert masses(estimates[30:]) == masses(plain[30:])
    finding = learning_finding(identifier.learned, learning, on=True)
    assert finding.level is Level.WARN
    assert f'vibration at {kind.change.frequency:.1f} Hz' in finding.message
    assert 'forget_learned' in finding.message


def test_a_load_that_comes_on_differently_is_told_with_its_place():
    identifier, _ = taught(items(130), items(30, seed=2, bump=0.3, first=130))
    (kind,) = identifier.learned.kinds
    # Half way from t1 to t2, which is a quarter of the way to t3.
    assert kind.change.place == pytest.approx(0.25, abs=0.1)


def test_a_machine_that_stays_the_same_has_not_changed():
    identifier, _ = taught(items(250))
    assert identifier.learned.kinds[0].change is None
