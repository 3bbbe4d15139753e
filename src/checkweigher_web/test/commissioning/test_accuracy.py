# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from checkweigher_web.commissioning.accuracy import matrix_of

LINES = (
    'estimator       m/min  passes  A trained  A held out',
    'untrained        30.0      60     0.4000      0.4000',
    'untrained        60.0      60     0.8000      0.8000',
    'hann             30.0      60     0.2000      0.3000',
    'hann             60.0      60     0.3000      0.5000',
    'learned          30.0      60     0.1000      0.2000',
    'learned          60.0      60     0.2000      0.4000',
)


def test_the_chosen_estimator_is_on_top_with_now_and_then_at_each_speed():
    found = matrix_of([*LINES, 'chosen: hann: simpler than learned'])
    assert found.heads == ('estimator', '30.0 m/min', '60.0 m/min')
    assert found.rows == (
        ('hann', '0.300 g', '0.500 g'),
        ('learned', '0.200 g', '0.400 g'),
        ('as now, without training', '0.400 g', '0.800 g'),
    )
    assert found.changes == (
        '30.0 m/min: 0.400 g now → 0.300 g',
        '60.0 m/min: 0.800 g now → 0.500 g',
        'Best: hann; simpler than learned',
    )


def test_a_training_that_is_no_better_says_so():
    found = matrix_of([*LINES, 'chosen: untrained: no tuned estimator is clearly better'])
    assert found.rows[0][0] == 'as now, without training'
    assert found.changes == ('Training would make nothing clearly better: keep what the line has.',)


def test_without_lines_there_is_nothing():
    assert matrix_of([])[1:] == ((), ())
