# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Commands `tune` and `evaluate`."""

from collections.abc import Callable
from dataclasses import replace
import json
from pathlib import Path

from here import refused
from lines import simulated, write_line
import numpy as np
import pytest
from running import Rows, Run, read_rows, run_command

from checkweigher_dsp.estimation.estimators import ESTIMATORS
from checkweigher_dsp.pipeline.line import LineParameters

Bags = dict[str, list[Path]]

MASSES = (0.0745, 0.1645, 0.2545)  # kg
SPEEDS = (1.0, 1.5)  # m/s
BUDGET = 8
FAST = ('--budget', BUDGET, '--jobs', 1)


def bag_of(folder: Path, name: str, **parameters: object) -> Path:
    """Write a bag of a simulated soft machine."""
    line = {'profile': 'soft', 'masses': MASSES, 'count': 18, **parameters}
    return write_line(folder / name, simulated(**line))


@pytest.fixture(scope='module')
def bags(tmp_path_factory: pytest.TempPathFactory) -> Bags:
    """Return bags for training and bags for the test, at two speeds."""
    folder = tmp_path_factory.mktemp('bags')
    return {
        part: [bag_of(folder, f'{part}_{speed}', speed=speed, seed=seed) for speed in SPEEDS]
        for part, seed in (('train', 1), ('test', 2))
    }


@pytest.fixture(scope='module')
def tuned(bags: Bags, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Tune two estimators, and return the parameter file, which selects iswd_eksi."""
    path = tmp_path_factory.mktemp('tuned') / 'machine.yaml'
    done = run_command(
        'tune', *bags['train'], '--estimator', 'iswd_eksi', 'tvlpf', '--output', path, *FAST
    )
    assert done.returncode == 0, done.stderr
    assert done.stderr == ''
    table = done.stdout.splitlines()
    rows = [line.split() for line in table[1:5]]
    assert [row[0] for row in rows] == ['iswd_eksi', 'iswd_eksi', 'tvlpf', 'tvlpf']
    assert [float(row[1]) for row in rows] == pytest.approx([60.0, 90.0] * 2, abs=0.2)
    assert {row[2] for row in rows} == {'18'}
    return path


def errors(rows: list[dict[str, str]]) -> np.ndarray:
    """Return the errors of the masses in g."""
    assert all(row['mass_g'] for row in rows)
    return np.array([float(row['mass_g']) - float(row['reference_g']) for row in rows])


@pytest.mark.parametrize('estimator', ['iswd_eksi', 'tvlpf'])
def test_what_was_tuned_on_some_passes_weighs_others_better(
    bags: Bags, tuned: Path, rows: Rows, estimator: str
):
    for bag in bags['test']:
        chosen = ('--estimator', estimator)
        before = errors(rows('weigh', bag, *chosen))
        after = errors(rows('weigh', bag, *chosen, '--params', tuned))
        assert np.sqrt(np.mean(after**2)) < 0.8 * np.sqrt(np.mean(before**2))


def test_the_file_says_how_far_to_trust_a_mass(bags: Bags, tuned: Path, rows: Rows):
    both = [row for bag in bags['test'] for row in rows('weigh', bag, '--params', tuned)]
    inside = abs(errors(both)) < 2 * np.array([float(row['std_dev_g']) for row in both])
    # 95 % if 18 passes of a speed told all; they do not.
    assert np.mean(inside) > 0.75
    assert len({row['std_dev_g'] for row in both}) > 1


def test_the_graph_and_the_loop_give_the_same_masses_by_it(bags: Bags, tuned: Path, rows: Rows):
    bag = bags['test'][1]
    weighed = rows('weigh', bag, '--params', tuned)
    assert len(weighed) == 18
    assert rows('replay', bag, '--rate', '0', '--params', tuned) == weighed


def test_between_the_speeds_it_weighs_and_outside_it_says_so(
    tuned: Path, rows: Rows, tmp_path: Path
):
    between, outside = (
        rows('weigh', bag_of(tmp_path, f'at_{speed}', speed=speed, count=3), '--params', tuned)
        for speed in (1.2, 0.8)
    )
    assert np.max(abs(errors(between))) < 5.0
    for row in outside:
        assert (row['decision'], row['reasons']) == ('FAULT', 'SpeedNotTrained')
        assert row['mass_g'] == ''


def test_without_a_name_the_best_of_all_on_held_out_passes_is_written(
    checkweigher: Run, rows: Rows, tmp_path: Path
):
    train, test = (bag_of(tmp_path, f'{seed}', speed=1.0, count=40, seed=seed) for seed in (3, 4))
    path = tmp_path / 'machine.yaml'
    done = checkweigher('tune', train, '--output', path, '--budget', 2, '--jobs', 1)
    table = [line.split() for line in done.stdout.splitlines()]
    names = (*ESTIMATORS, 'untrained')
    held_out = {row[0]: float(row[4]) for row in table[1:] if row[0] in names}
    # 40 passes are too few for the others.
    assert held_out.keys() == {'untrained', 'mean', 'hann', 'fir_model', 'learned'}
    # On a platform that rings through the window one needs to have learned how.
    parameters = LineParameters.from_file(path).identifier
    assert parameters.estimator == 'learned'
    assert held_out[parameters.estimator] < 1.1 * min(held_out.values())
    (reason,) = (line for line in path.read_text().splitlines() if line.startswith('# chosen: '))
    assert reason.startswith(f'# chosen: {parameters.estimator}: ')
    assert reason.removeprefix('# ') in done.stdout
    # What is not selected is in the table only.
    assert not any(getattr(parameters, name).calibrated for name in ('hann', 'iswd_eksi'))
    best, plain = (
        errors(rows('weigh', test, '--params', path, *options))
        for options in ((), ('--estimator', 'hann'))
    )
    assert np.std(best) < 0.3 * np.std(plain)


Refused = Callable[..., str]


@pytest.fixture(name='refused')
def _refused(tmp_path: Path) -> Refused:
    """Return a function that runs a command which must be refused and must write no file."""

    def run(command: str, *arguments: object) -> str:
        output = ('--output', tmp_path / 'machine.yaml') if command == 'tune' else ()
        before = sorted(tmp_path.iterdir())
        line = refused(command, *arguments, *output)
        assert sorted(tmp_path.iterdir()) == before
        return line

    return run


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (('--estimator', 'all', 'best'), '--estimator best: is not an estimator; there are aeksi'),
        (('--estimator', 'tvlp_mf'), '--estimator tvlp_mf: is not an estimator; there are aeksi'),
        (('--budget', '0'), '--budget 0: must be above 0'),
        (('--jobs', '-1'), '--jobs -1: must be above 0'),
        (('--lane', 'other'), 'other'),
    ],
)
def test_options_that_cannot_be_used(
    bags: Bags, options: tuple[str, ...], message: str, refused: Refused
):
    assert message in refused('tune', bags['train'][0], *options)


def test_an_output_that_exists(bags: Bags, tmp_path: Path, refused: Refused):
    output = tmp_path / 'machine.yaml'
    output.write_text('mine')
    assert 'exists already' in refused('tune', bags['train'][0])
    assert output.read_text() == 'mine'


def test_a_bag_without_known_masses(tmp_path: Path, refused: Refused):
    bag = write_line(tmp_path / 'bag', replace(simulated(count=4), references=()))
    assert 'no pass of known mass; it needs messages on reference_mass' in refused('tune', bag)


@pytest.mark.parametrize(
    ('parameters', 'message'),
    [
        ({'speed': 0.5, 'count': 2}, '2 passes of known mass at 30.0 m/min'),
        ({'sample_rate': 1000.0, 'count': 3}, 'is 1000 Hz, but 960 Hz in the first bag'),
    ],
)
def test_bags_that_do_not_go_together(
    bags: Bags, tmp_path: Path, parameters: dict[str, object], message: str, refused: Refused
):
    other = bag_of(tmp_path, 'other', **parameters)
    assert message in refused('tune', bags['train'][0], other)


@pytest.mark.parametrize('jobs', ['1', '2'])
def test_passes_that_an_estimator_cannot_be_tuned_on(tmp_path: Path, jobs: str, refused: Refused):
    # No stretch of it is long enough for the least noise model.
    slow = bag_of(tmp_path, 'slow', sample_rate=100.0, speed=0.3, spacing=0.31, lead_in=0.1)
    said = refused('tune', slow, '--estimator', 'hann', 'gauss_markov', '--jobs', jobs)
    assert 'no segment of noise is longer than 40 samples' in said


class TestEvaluation:
    def test_bags_after_training_on_others(self, bags: Bags, checkweigher: Run, tmp_path: Path):
        files = {kind: tmp_path / f'result.{kind}' for kind in ('html', 'csv', 'json', 'tuned')}
        done = checkweigher(
            'evaluate', *bags['test'], '--train', *bags['train'],
            '--estimator', 'lms_notch', 'hann', 'tvlpf', *FAST, '--class', 'XIIII', '--factor', '2',
            *(part for kind, path in files.items() for part in (f'--{kind}', path)),
        )  # fmt: skip
        assert done.stderr == ''
        assert 'tvlpf' in done.stdout
        assert '<html' in files['html'].read_text()
        rows = read_rows(files['csv'])
        keys = [(row['part'], row['estimator'], row['mass_g'], row['count']) for row in rows]
        expected = [
            (part, estimator, mass, '6')
            for part in ('test', 'train')
            for _ in SPEEDS
            for estimator in ('lms_notch', 'hann', 'tvlpf')
            for mass in ('74.5', '164.5', '254.5')
        ]
        assert sorted(keys) == sorted(expected)
        # Both parts stand under the same speeds.
        assert len({row['belt_speed_m_per_s'] for row in rows}) == len(SPEEDS)
        content = json.loads(files['json'].read_text())
        assert len(content['conditions']) == len(rows)
        assert {kind for kind, _ in content['provenance']} >= {'train', 'test', 'numpy'}
        # No line has the notch filter, so it is not in the file.
        parameters = LineParameters.from_file(files['tuned'])
        assert parameters.identifier.estimator == 'hann'
        assert parameters.identifier.tvlpf.calibrated

    def test_a_tuned_file_without_training(self, bags: Bags, tuned: Path, checkweigher: Run):
        done = checkweigher('evaluate', *bags['test'], '--params', tuned, '--jobs', 1)
        assert 'iswd_eksi' in done.stdout

    def test_the_protocol_of_the_paper(self, checkweigher: Run, tmp_path: Path):
        path = tmp_path / 'result.csv'
        options = ('--passes', 4, '--estimator', 'mean', 'hann', '--csv', path, '--jobs', 1)
        done = checkweigher('evaluate', '--protocol', 'paper', *options)
        assert 'bound' in done.stdout
        rows = read_rows(path)
        # Speeds, masses, parts, estimators.
        assert len(rows) == 5 * 5 * 2 * 2
        assert {(row['count'], row['faults']) for row in rows} == {('2', '0')}

    def test_machines_beside_what_is_attainable(self, checkweigher: Run, tmp_path: Path):
        files = {kind: tmp_path / f'result.{kind}' for kind in ('csv', 'json', 'html')}
        outputs = [each for kind, path in files.items() for each in (f'--{kind}', path)]
        done = checkweigher(
            'evaluate', '--protocol', 'machines', '--count', 1, '--seed', 3, '--passes', 6,
            '--further', 10, '--mass', 100, 200, '--estimator', 'mean', '--jobs', 1, *outputs,
        )  # fmt: skip
        assert 'attainable A, g' in done.stdout
        rows = read_rows(files['csv'])
        kinds = {(row['tuned'], row['estimator'], row['part']) for row in rows}
        assert kinds == {
            ('1', 'attainable', 'test'), ('1', 'mean', 'train'), ('1', 'mean', 'test'),
            ('1', 'chosen', 'train'), ('1', 'chosen', 'test'),
            ('0', 'attainable', 'test'), ('0', 'mean', 'test'),
        }  # fmt: skip
        masses = {row['mass_g'] for row in rows if row['part'] == 'train'}
        assert masses == {'100', '200'}
        assert len(json.loads(files['json'].read_text())['machines']) == 1
        assert 'machine 3' in files['html'].read_text()

    @pytest.mark.parametrize(
        ('options', 'message'),
        [
            ((), 'give either bags, or --protocol paper'),
            (('BAG', '--protocol', 'paper'), 'give either bags, or --protocol paper'),
            (('--protocol', 'paper', '--passes', '3'), '--passes 3: must be even'),
            (('--protocol', 'paper', '--seed', '-1'), '--seed -1: must not be negative'),
            (('--protocol', 'paper', '--profile', 'moon'), '--profile moon: is not one of paper'),
            (('--protocol', 'paper', '--train', 'BAG'), '--train'),
            (('--protocol', 'machines', '--train', 'BAG'), '--train: is not for the protocol'),
            (('--protocol', 'machines', '--count', '0'), '--count 0: must be above 0'),
            (('--protocol', 'machines', '--mass', '0'), '--mass: must be above 0'),
            (('--protocol', 'machines', '--without', 'luck'), '--without luck: is not one of'),
            (
                ('--protocol', 'machines', '--passes', '2'),
                '--passes 2: tuning needs at least 3 passes',
            ),
            (('BAG', '--class', 'XV'), "class 'XV' is not one of XI, XII, XIII, XIIII"),
            (('BAG', '--factor', '0.3'), 'class factor x: 0.3 is not 1, 2 or 5 x 10^k up to 2'),
            (('BAG', '--max', '1', '--interval', '1'), 'give only one'),
            (('BAG', '--class', 'XIIII'), 'class factor x of XIIII: 1 is not above 1'),
            (('BAG', '--class', 'XIIII', '--max', '1'), 'no verification scale interval for Max'),
            (('BAG', '--nominal', '20000'), '--nominal'),
            (('BAG', '--tuned', 'OUT'), '--tuned: nothing would be tuned'),
            (('BAG', '--csv', 'OUT', '--json', 'OUT'), 'is the path of two outputs'),
            (('BAG', '--html', '/no/such/folder/report.html'), 'there is no folder'),
        ],
    )
    def test_refused(
        self, bags: Bags, tmp_path: Path, options: tuple[str, ...], message: str, refused: Refused
    ):
        places = {'BAG': bags['test'][0], 'OUT': tmp_path / 'out'}
        assert message in refused('evaluate', *(places.get(option, option) for option in options))

    def test_training_at_another_rate_is_refused(
        self, bags: Bags, tmp_path: Path, refused: Refused
    ):
        other = bag_of(tmp_path, 'other', sample_rate=1000.0, count=3)
        assert 'the sample rate of these bags differs' in refused(
            'evaluate', bags['test'][0], '--train', other, '--estimator', 'mean'
        )
