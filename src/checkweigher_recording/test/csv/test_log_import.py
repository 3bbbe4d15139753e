# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Logs of laboratories become records."""

import json
import math
import os
from pathlib import Path

from lines import counts_of, grams_of
import numpy as np
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Eye
from checkweigher_recording.csv.log_import import ImportParameters, import_csv
from checkweigher_recording.csv.table import CsvError

START = 1_700_000_000_000_000_000


def _edges_file(tmp_path, **changes):
    content = {
        'sample_rate_hz': 1000,
        'ftc1': [[0, 0], [3, 1], [5, 0]],
        'ftc2': [[0, 0], [7, 1], [9, 0]],
        'mass_g': 150.5,
    } | changes
    path = tmp_path / 'log.edges.json'
    path.write_text(json.dumps({key: value for key, value in content.items() if value is not ...}))
    return path


def _no_edges(tmp_path, **changes):
    return _edges_file(tmp_path, ftc1=[[0, 0]], ftc2=[[0, 0]], **changes)


def _log(tmp_path, text=None):
    path = tmp_path / 'log.csv'
    path.write_text(text or 'bridge\n' + ''.join(f'{100 * row}\n' for row in range(12)))
    return path


def test_a_single_column_and_an_edges_file(tmp_path):
    parameters = ImportParameters(counts_per_kg=1e5, zero_counts=20.0, weigh_length=0.35)
    recording = import_csv(_log(tmp_path), parameters, _edges_file(tmp_path))

    assert recording.load_cell.sample_rate == 1000.0
    assert recording.load_cell.counts_per_kg == 1e5
    assert recording.load_cell.zero_counts == 20.0
    assert recording.load_cell.weigh_length == 0.35
    assert counts_of(recording).tolist() == [100 * row for row in range(12)]
    assert [(block.first_index, block.stamp - START) for block in recording.blocks] == [
        (0, 0), (10, 10_000_000)
    ]  # fmt: skip
    # Rows 3, 5, 7, 9 at 1 kHz.
    assert [(edge.stamp - START, edge.eye, edge.blocked) for edge in recording.edges] == [
        (3_000_000, Eye.INFEED, True),
        (5_000_000, Eye.INFEED, False),
        (7_000_000, Eye.OUTFEED, True),
        (9_000_000, Eye.OUTFEED, False),
    ]
    assert [(one.stamp - START, one.mass) for one in recording.references] == [(3_000_000, 0.1505)]


def test_columns_by_name_and_by_number(tmp_path):
    rows = [
        (row / 500, row % 2, 12 if 2 <= row < 5 else 0, 0 if row < 4 else 12) for row in range(8)
    ]
    text = 't;force;FTC1;FTC2\n' + ''.join(';'.join(map(str, row)) + '\n' for row in rows)
    expected = [
        (4_000_000, Eye.INFEED, True),
        (8_000_000, Eye.OUTFEED, True),
        (10_000_000, Eye.INFEED, False),
    ]
    for names in (('force', 't', 'FTC1', 'FTC2'), ('1', '0', '2', '3')):
        values = dict(zip(('signal', 'time', 'infeed', 'outfeed'), names, strict=True))
        parameters = ImportParameters(delimiter=';', threshold=8.0, counts_per_kg=1.0, **values)
        recording = import_csv(_log(tmp_path, text), parameters)

        assert recording.load_cell.sample_rate == pytest.approx(500.0, rel=1e-12)
        assert counts_of(recording).tolist() == [0, 1, 0, 1, 0, 1, 0, 1]
        assert [(e.stamp - START, e.eye, e.blocked) for e in recording.edges] == expected
        assert recording.references == ()


def test_eyes_that_are_blocked_below_the_threshold(tmp_path):
    text = '1,9,9\n1,0,9\n1,9,0\n1,9,9\n'
    eyes = {'infeed': '1', 'outfeed': '2', 'threshold': 5.0, 'blocked_below': True}
    parameters = ImportParameters(signal='0', sample_rate=1000.0, counts_per_kg=1.0, **eyes)
    recording = import_csv(_log(tmp_path, text), parameters)

    assert [(e.stamp - START, e.eye, e.blocked) for e in recording.edges] == [
        (1_000_000, Eye.INFEED, True),
        (2_000_000, Eye.INFEED, False),
        (2_000_000, Eye.OUTFEED, True),
        (3_000_000, Eye.OUTFEED, False),
    ]


def test_a_calibration_ingrams_of(tmp_path):
    # g = 5000 * (mV/V) - 1000: empty at 0.2 mV/V, 1 kg more is 0.2 mV/V more.
    text = '0.2\n0.3\n0.400001\n'
    parameters = ImportParameters(slope=5000.0, offset=-1000.0, scale=1e6, sample_rate=1000.0)
    recording = import_csv(_log(tmp_path, text), parameters, _no_edges(tmp_path))

    assert counts_of(recording).tolist() == [200_000, 300_000, 400_001]
    assert recording.load_cell.zero_counts == pytest.approx(200_000)
    assert recording.load_cell.counts_per_kg == pytest.approx(200_000)


@pytest.mark.parametrize(
    ('text', 'values', 'counts'),
    [
        # Decimal commas, quotes, a blank line and a byte order mark.
        (
            '\ufeff"Kraft, N";"Zeit"\r\n"1,5";0\r\n2,5;0,001\r\n\r\n3,5;0,002\r\n',
            {'signal': 'Kraft, N', 'time': 'Zeit', 'delimiter': ';', 'decimal': ',', 'scale': 10.0},
            [15, 25, 35],
        ),
        ('0\t0\n1\t1\n2\t2\n', {'signal': '1', 'delimiter': 'tab'}, [0, 1, 2]),
        (' 0   0\n 1   1\n 2   2\n', {'signal': '1', 'delimiter': 'space'}, [0, 1, 2]),
    ],
)
def test_logs_of_other_formats(tmp_path, text, values, counts):
    path = tmp_path / 'log.csv'
    path.write_bytes(text.encode())
    recording = import_csv(path, ImportParameters(counts_per_kg=1.0, **values), _no_edges(tmp_path))

    assert counts_of(recording).tolist() == counts


def test_a_hole_in_the_time_column_is_a_jump_of_the_index(tmp_path):
    # 1 kHz, rounded to 0.1 ms and with rows 4..9 lost.
    kept = [0, 1, 2, 3, 10, 11]
    text = 't,s\n' + ''.join(f'{row / 1000 + 0.00003:.4f},{row}\n' for row in kept)
    parameters = ImportParameters(signal='s', time='t', counts_per_kg=1.0)
    edges = _edges_file(tmp_path, ftc1=[[0, 0], [4, 1]], ftc2=[[0, 0]], mass_g=...)
    recording = import_csv(_log(tmp_path, text), parameters, edges)

    assert [(block.first_index, block.counts.tolist()) for block in recording.blocks] == [
        (0, [0, 1, 2, 3]),
        (10, [10, 11]),
    ]
    assert recording.blocks[1].stamp - START == 10_000_000
    assert recording.edges[0].stamp - START == 10_000_000


def test_other_keys_fractions_of_a_row_and_a_list_of_masses(tmp_path):
    edges = _edges_file(
        tmp_path, ftc1=..., ftc2=..., mass_g=[10, 20.5],
        a=[[0, 0], [1.25, 1], [2, 0], [5.5, 1], [6, 0]], b=[[0, 1], [1.5, 0]],
    )  # fmt: skip
    parameters = ImportParameters(counts_per_kg=1.0, infeed_key='a', outfeed_key='b')
    recording = import_csv(_log(tmp_path), parameters, edges)

    assert [(one.stamp - START, one.mass) for one in recording.references] == [
        (1_250_000, 0.01),
        (5_500_000, 0.0205),
    ]
    # The state at the begin is no edge.
    assert [(e.stamp - START, e.blocked) for e in recording.edges if e.eye is Eye.OUTFEED] == [
        (1_500_000, False)
    ]


@pytest.mark.parametrize(
    ('text', 'values', 'message'),
    [
        ('', {}, r'log\.csv: empty'),
        ('force\n', {}, r'log\.csv: no rows below the header'),
        ('a,b\n1,2\n', {}, r'log\.csv: no column is named for the signal; the file has a, b'),
        ('1,2\n1,2\n', {}, r'the file has 0 to 1, without names'),
        ('a,b\n1,2\n', {'signal': 'c'}, r"no column 'c' for the signal; it has a, b"),
        ('a,b\n1,2\n', {'signal': '2'}, r"no column '2' for the signal"),
        ('a,a\n1,2\n', {'signal': 'a'}, r"several columns 'a'"),
        ('a\n1\n\n2\nx\n', {}, r"log\.csv:5: 'x' is not a number"),
        ('a,b\n1,2\n3\n', {'signal': 'b'}, r'log\.csv:3: 1 columns, but at least 2'),
        ('a\n1\n\nnan\n', {}, r'log\.csv:4: a value is not finite'),
        ('a\n1\n3e9\n', {}, r'log\.csv:3: 3e\+09 counts do not fit into 32 bits'),
        ('t,s\n0,1\n1,1\n1,1\n', {'signal': 's', 'time': 't'}, r'log\.csv:4: the time does not'),
        (
            't,s\n0,1\n1,1\n2,1\n2.1,1\n3,1\n',
            {'signal': 's', 'time': 't', 'sample_rate': 1.0},
            r'log\.csv:5: only 0\.1 s after the row above',
        ),
        ('t,s\n0,1\n', {'signal': 's', 'time': 't'}, r'log\.csv: a single row'),
    ],
)
def test_a_log_that_cannot_be_used_is_named_with_its_line(tmp_path, text, values, message):
    path = tmp_path / 'log.csv'
    path.write_text(text)
    values = {'counts_per_kg': 1.0, 'sample_rate': 0.0} | values
    edges = _no_edges(tmp_path, sample_rate_hz=... if 'time' in values else 1000)
    with pytest.raises(CsvError, match=message) as caught:
        import_csv(path, ImportParameters(**values), edges)
    assert '\n' not in str(caught.value)
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize(
    ('changes', 'message'),
    [
        ({'ftc1': ...}, r'ftc1: must be a list of \[row, level\]'),
        ({'ftc2': []}, r'ftc2: must be a list of \[row, level\]'),
        ({'ftc1': [[0, 0], [3]]}, r'ftc1: \[3\] is not \[row, level\]'),
        ({'ftc1': [[0, 0], [3, 2]]}, r'ftc1: \[3, 2\] is not'),
        ({'ftc1': [[0, 0], [12, 1]]}, r'ftc1: row 12 is not in 0\.\.11'),
        ({'ftc1': [[0, 0], [5, 1], [3, 0]]}, r'ftc1: \[3, 0\] does not follow \[5, 1\]'),
        ({'ftc1': [[0, 0], [5, 0]]}, r'ftc1: \[5, 0\] does not follow \[0, 0\]'),
        ({'mass_g': 'heavy'}, r"mass_g: 'heavy' is not a mass"),
        ({'mass_g': [1, 2]}, r'mass_g: 2 masses for 1 items'),
        ({'sample_rate_hz': 0}, r'sample_rate_hz: 0 is not a rate'),
    ],
)
def test_an_edges_file_that_cannot_be_used(tmp_path, changes, message):
    edges = _edges_file(tmp_path, **changes)
    with pytest.raises(CsvError, match=message) as caught:
        import_csv(_log(tmp_path), ImportParameters(counts_per_kg=1.0), edges)
    assert str(caught.value).startswith(str(edges))


def test_files_that_are_missing_or_no_text(tmp_path):
    parameters = ImportParameters(counts_per_kg=1.0)
    with pytest.raises(CsvError, match=r'none\.csv: cannot be read: No such file'):
        import_csv(tmp_path / 'none.csv', parameters, _edges_file(tmp_path))
    with pytest.raises(CsvError, match=r'^[^:]*none\.json: cannot be read: No such file'):
        import_csv(_log(tmp_path), parameters, tmp_path / 'none.json')
    for text, message in (('{', 'not JSON: .*: line 1 column 2'), ('[]', 'not an edges file')):
        (tmp_path / 'bad.json').write_text(text)
        with pytest.raises(CsvError, match=message):
            import_csv(_log(tmp_path), parameters, tmp_path / 'bad.json')
    (tmp_path / 'log.csv').write_bytes(b'1\n2\xff\n')
    with pytest.raises(CsvError, match='not a text file: byte 3'):
        import_csv(tmp_path / 'log.csv', parameters, _edges_file(tmp_path))


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({}, 'either slope or counts_per_kg'),
        ({'slope': 1.0, 'counts_per_kg': 1.0}, 'either slope or counts_per_kg'),
        ({'counts_per_kg': 1.0, 'scale': 0.0}, 'import.scale'),
        ({'counts_per_kg': 1.0, 'infeed': 'a'}, 'import.infeed'),
        ({'counts_per_kg': 1.0, 'delimiter': ',', 'decimal': ','}, 'import.decimal'),
    ],
)
def test_parameters_that_contradict_each_other(values, message):
    with pytest.raises(ParameterError, match=message):
        ImportParameters(**values)


def test_parameters_that_do_not_fit_the_files(tmp_path):
    log, edges = _log(tmp_path), _edges_file(tmp_path)
    with pytest.raises(ParameterError, match='either columns of the eyes or an edges file'):
        import_csv(log, ImportParameters(counts_per_kg=1.0))
    with pytest.raises(ParameterError, match='960 Hz, but the edges file says 1000 Hz'):
        import_csv(log, ImportParameters(counts_per_kg=1.0, sample_rate=960.0), edges)
    limits = ImportParameters(counts_per_kg=1.0, min_counts=5, max_counts=5)
    with pytest.raises(ParameterError, match='min_counts 5 is not below'):
        import_csv(log, limits, edges)
    edges = _edges_file(tmp_path, sample_rate_hz=...)
    with pytest.raises(ParameterError, match='unknown'):
        import_csv(log, ImportParameters(counts_per_kg=1.0), edges)


# Recordings of a real belt scale that are not part of the project.
_REAL_PASSES = Path(
    os.environ.get('CHECKWEIGHER_REAL_PASSES', Path(__file__).parents[5] / 'shared/real_passes')
)


@pytest.mark.skipif(not _REAL_PASSES.is_dir(), reason='the real recordings are not here')
@pytest.mark.parametrize('mass', ['105.85', '206.83', '621.25', '1017.70'])
def test_a_real_pass_has_its_mass(mass):
    (log,) = _REAL_PASSES.glob(f'*_{mass}_*.csv')
    edges = log.with_name(f'{log.stem}.edges.json')
    parameters = ImportParameters(slope=5191.42051e-7, offset=-4874.38, weigh_length=0.73)
    recording = import_csv(log, parameters, edges)
    cell = recording.load_cell
    grams = grams_of(recording)
    _, t2, t3, t4 = (
        math.ceil((edge.stamp - START) / 1e9 * cell.sample_rate - 1e-3) for edge in recording.edges
    )

    def weighted(values):
        return np.average(values, weights=np.hanning(len(values) + 2)[1:-1])

    assert recording.references[0].mass == pytest.approx(float(mass) / 1000)
    # What Hann-weighted means of the pass and of the empty belt after it are known to keep to.
    error = weighted(grams[t2:t3]) - weighted(grams[t4 + 80 :]) - float(mass)
    assert abs(error) < 0.5
