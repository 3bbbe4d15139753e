# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of machines from evaluations whose values are known by construction."""

import csv
import io
import json

from made_evaluations import make_evaluation
import pytest

from checkweigher_validation.accuracy.machine_tables import (
    ATTAINABLE,
    MachineResult,
    family_csv,
    family_json,
    family_tables,
    family_text,
    ratios,
)

SPEEDS = (0.5, 1.5)


@pytest.fixture(name='machines')
def _machines():
    # The n-th estimator has n times the sigma and mu of the first.
    def result(machine, *estimators):
        names = (ATTAINABLE, *estimators)
        return MachineResult(
            machine,
            make_evaluation(speeds=SPEEDS, estimators=names),
            make_evaluation(speeds=SPEEDS, estimators=names, parts=('test',)),
            chosen='hann',
        )

    return result(7, 'mean', 'hann'), result(8, 'hann', 'mean')


def test_ratios_are_those_of_a_to_the_attainable_a(machines):
    tuned = [each.tuned for each in machines]
    assert ratios(tuned, 'mean', 0.5) == pytest.approx([2, 3])
    assert ratios(tuned, 'mean') == pytest.approx([2, 2, 3, 3])
    assert ratios(tuned, 'hann', part='train') == pytest.approx([3, 3, 2, 2])


def test_the_table_has_the_mean_and_the_worst_by_speed_and_over_all(machines):
    tuned, untrained = family_tables(machines)
    for table in (tuned, untrained):
        assert [row.estimator for row in table.rows] == ['mean', 'hann']
        for row in table.rows:
            for cell in row.cells:
                assert cell == pytest.approx((2.5, 3.0))
            assert row.faults == 0
        # A = 0.01 g + 3 x 0.05 g per m/s.
        assert table.attainable == pytest.approx((0.085e-3, 0.235e-3, 0.16e-3))
    assert tuned.rows[0].trained == pytest.approx(2.5)
    assert untrained.rows[0].trained != untrained.rows[0].trained  # NaN


def test_the_text_has_a_row_an_estimator_and_training_apart(machines):
    lines = family_text(machines, 'Machines 7 to 8').splitlines()
    assert lines[0].startswith('Machines 7 to 8: A / attainable A')
    first = [line.split()[0] for line in lines[1:-1]]
    rows = ['attainable', 'mean', 'hann']
    assert first == ['tuned', *rows, 'untrained', *rows]
    assert lines[1].endswith('training')
    assert not lines[5].endswith('training')
    assert lines[2].split()[-3:] == ['0.085', '0.235', '0.160']
    assert lines.pop() == 'tune chooses hann on 2'
    assert lines[3].split()[1:7] == ['2.50', '3.00'] * 3


def test_csv_and_json_have_each_condition_of_each_machine(machines):
    rows = list(csv.DictReader(io.StringIO(family_csv(machines))))
    assert len(rows) == 2 * 3 * 2 * 5 * (2 + 1)
    assert {row['machine'] + row['tuned'] for row in rows} == {'71', '70', '81', '80'}
    content = json.loads(family_json(machines, 'title', (('seed', '7'),)))
    assert [each['machine'] for each in content['machines']] == [7, 8]
    assert sum(len(each['tuned']) + len(each['untrained']) for each in content['machines']) == 180
