# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Text, CSV and JSON of evaluations, whose values are known by construction."""

import csv
import io
import json
import math
import os
import stat

from made_evaluations import make_condition, make_evaluation
import pytest

from checkweigher_core.whole_file import OutputError, write_whole
from checkweigher_validation.accuracy.errors import Evaluation
from checkweigher_validation.accuracy.tables import csv_text, json_text, text_table


def rows_of(evaluation):
    return list(csv.DictReader(io.StringIO(csv_text(evaluation))))


def test_the_csv_has_one_row_for_each_condition_in_grams():
    rows = rows_of(make_evaluation())
    assert ','.join(rows[0]) == (
        'part,estimator,belt_speed_m_per_s,mass_g,count,faults,mean_error_g,std_dev_g,index_g,'
        'bound_g,std_dev_over_bound,coverage_68,coverage_95,max_mean_error_g,max_std_dev_g,'
        'within_class'
    )
    keys = ('part', 'estimator', 'belt_speed_m_per_s', 'mass_g')
    by_key = {tuple(row[key] for key in keys): row for row in rows}
    assert len(by_key) == len(rows) == 2 * 2 * 5 * 5
    row = by_key['train', 'iswd_eksi', '1.5', '254.5']

    # The second estimator: mu -0.02 g in training, sigma 2 * 0.05 * 1.5 g, bound 0.02 g.
    names = ('mean_error_g', 'std_dev_g', 'index_g', 'bound_g', 'std_dev_over_bound')
    assert [float(row[name]) for name in names] == pytest.approx([-0.02, 0.15, 0.47, 0.02, 7.5])
    assert (row['count'], row['faults']) == ('60', '0')
    # Class XIII(1), e = 0.1 g, initial: 1.5 e above 200 g, and 0.48 g from 200 g to 300 g.
    assert (row['max_mean_error_g'], row['max_std_dev_g']) == ('0.150000', '0.480000')
    assert row['within_class'] == '1'


def test_what_is_not_known_is_empty_in_csv_and_null_in_json():
    evaluation = Evaluation('one', (make_condition([1e-3], faults=59, std_devs=[math.nan]),), ())
    (row,) = rows_of(evaluation)
    (entry,) = json.loads(json_text(evaluation))['conditions']

    for name in ('std_dev_g', 'index_g', 'bound_g', 'std_dev_over_bound', 'coverage_68'):
        assert row[name] == ''
    for name in ('std_dev_kg', 'index_kg', 'bound_kg', 'std_dev_over_bound', 'coverage_95'):
        assert entry[name] is None
    assert (row['mean_error_g'], row['faults']) == ('1.000000', '59')
    assert (entry['mean_error_kg'], entry['faults']) == (1e-3, 59)
    assert (entry['errors_kg'], entry['stated_std_devs_kg']) == ([1e-3], [None])
    assert row['within_class'] == '0'


def test_the_json_is_in_si_units_with_all_digits():
    evaluation = make_evaluation()
    content = json.loads(json_text(evaluation))

    assert content['title'] == evaluation.title
    assert content['provenance'] == [['profile', 'paper'], ['seed', '1 & 2']]
    assert len(content['conditions']) == len(evaluation.conditions)
    for entry in content['conditions']:
        (one,) = evaluation.select(
            estimator=entry['estimator'],
            speed=entry['belt_speed_m_per_s'],
            mass=entry['mass_kg'],
            part=entry['part'],
        )
        assert entry['std_dev_kg'] == one.std_dev
        assert entry['mean_error_kg'] == one.mean_error
        assert entry['index_kg'] == one.index


def test_the_text_table_says_means_and_the_papers_index():
    lines = text_table(make_evaluation()).splitlines()
    assert not any('train' in line for line in lines)
    assert lines[20].startswith('hann, in 95 % by mass: ')
    assert lines[20].split()[-5:] == ['74.5', '134.5', '164.5', '194.5', '254.5']
    assert [line.split() for line in lines[21:]] == [
        [speed, 'm/min', *['100'] * 5] for speed in ('30', '45', '60', '75', '90')
    ]
    lines = lines[:20]
    cells = [line.split() for line in lines]

    # A title and a header; bound and two estimators at each of five speeds and over all.
    assert len(lines) == 2 + 3 * 6
    assert cells[2] == ['30', 'bound', '0.020']
    # sigma 0.025, |mu| 0.01, A 0.085 g; sigma / 0.02 g.
    # All errors are within 0.0994 g, the stated 68 %, and within class XIII.
    assert cells[3] == ['hann', '0.025', '0.010', '0.085', '1.25', '100', '100', '0', '5/5']
    # Twice as much; the paper: (0.111 + 3 * 0.169) / 5.
    assert cells[4][:5] == ['iswd_eksi', '0.050', '0.020', '0.170', '2.50']
    assert cells[4][5:] == ['100', '100', '0', '5/5', '0.124']
    # Mean of the speeds 1 m/s: sigma 0.1 g, A 0.32 g.
    assert cells[-1][:5] == ['iswd_eksi', '0.100', '0.020', '0.320', '5.00']
    assert cells[-3] == ['all', 'bound', '0.020']


def test_other_masses_are_not_held_against_the_papers():
    assert 'paper' not in text_table(make_evaluation(masses=(0.0745, 0.1345), title='line'))
    assert 'train passes' in text_table(make_evaluation(parts=('train',)))
    # At other speeds there is nothing to hold against, nor over all of them.
    table = text_table(make_evaluation(speeds=(0.5, 2.0))).splitlines()
    assert table[4].split()[-1] == '0.124'
    assert len(table[7].split()) == len(table[10].split()) == 9


def test_unknown_values_are_dashes_in_the_text_table():
    table = text_table(Evaluation('one', (make_condition([], faults=3),), ()))

    assert table.splitlines()[-1].split() == ['mean', *'-' * 6, '3', '0/1']


def test_a_file_is_written_whole_in_place_of_an_older_one(tmp_path, monkeypatch):
    path = tmp_path / 'table.csv'
    path.write_text('older')
    write_whole(path, 'newer')
    assert path.read_text() == 'newer'
    assert stat.S_IMODE(path.stat().st_mode) == 0o644
    with pytest.raises(OutputError, match='cannot be written: No such file'):
        write_whole(tmp_path / 'nowhere' / 'table.csv', 'text')

    def full(*_):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(os, 'replace', full)
    with pytest.raises(OutputError, match=r'table\.csv: cannot be written: No space left'):
        write_whole(path, 'newest')
    assert path.read_text() == 'newer'
    assert list(tmp_path.iterdir()) == [path]
