# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Command line: help, examples, options from the parameters, and imports."""

from dataclasses import fields
from pathlib import Path
import subprocess
import sys

from here import run_here
import pytest
from running import BAGS, run_command

from checkweigher_bringup.cli import COMMANDS, build_parser
from checkweigher_core.ros.graph.policy import enclaves
from checkweigher_recording.csv.log_import import ImportParameters


def examples(text: str) -> list[str]:
    return [line.strip() for line in text.splitlines() if line.startswith('  checkweigher ')]


def test_help_shows_an_example_of_every_command_that_the_parser_takes():
    done = run_command('--help')
    assert done.returncode == 0
    taken = [build_parser().parse_args(line.split()[1:]).command for line in examples(done.stdout)]
    assert taken == list(COMMANDS)


@pytest.mark.parametrize('name', COMMANDS)
def test_every_command_has_help_with_examples_that_the_parser_takes(name: str):
    done = run_here(name, '--help')
    assert done.returncode == 0
    for line in examples(done.stdout):
        words = line.partition('  #')[0].split()[1:]
        assert build_parser().parse_args(words).command == name


def test_help_needs_none_of_the_heavy_imports():
    script = (
        'import sys; from checkweigher_bringup.cli import build_parser; build_parser(); '
        "print(sorted({'numpy', 'rclpy', 'rosbags', 'scipy', 'yaml'} & set(sys.modules)))"
    )
    done = subprocess.run([sys.executable, '-c', script], capture_output=True, text=True)
    assert done.stdout.strip() == '[]', done.stderr


def test_import_has_an_option_for_every_one_of_its_parameters():
    parsed = build_parser().parse_args(['import', 'log.csv', '--output', 'bag'])
    missing = {entry.name for entry in fields(ImportParameters)} - set(vars(parsed))
    assert not missing


@pytest.mark.parametrize('closed', ['>&-', '>&- 2>&-', '<&- >&-'])
def test_a_command_whose_output_is_closed_does_its_work(closed: str, tmp_path: Path):
    script = f'exec {sys.executable} -m checkweigher_bringup.cli "$@" {closed}'
    words = ['weigh', str(BAGS / 'paper_90'), '--csv', str(tmp_path / 'masses.csv')]

    done = subprocess.run(['bash', '-c', script, 'bash', *words], capture_output=True, text=True)

    assert (done.returncode, done.stderr) == (0, '')
    assert len((tmp_path / 'masses.csv').read_text().splitlines()) == 26


def test_an_output_that_cannot_be_written_is_one_line():
    with open('/dev/full', 'w') as full:
        done = run_command('weigh', BAGS / 'paper_90', stdout=full)
    assert done.returncode == 2
    assert done.stderr == 'checkweigher weigh: the output: No space left on device\n'


@pytest.mark.parametrize(
    ('words', 'enclave'),
    [
        (('status', '--count', '1'), 'observer'),
        (('echo', '--namespace', 'lane1'), 'lane1/observer'),
        (('record', '--namespace', 'lane1', '--output', 'bag'), 'lane1/observer'),
        (('run', '--namespace', 'lane1'), 'lane1/run'),
        (('page', '--port', '0'), 'page'),
        (('gateway', 'metrics', '--settings', 'gateways.yaml'), 'gateway_metrics'),
    ],
)
def test_each_command_takes_its_enclave_and_says_in_one_line_that_it_cannot(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[str, ...], enclave: str
):
    monkeypatch.setenv('ROS_SECURITY_ENABLE', 'true')
    monkeypatch.setenv('ROS_SECURITY_STRATEGY', 'Enforce')
    monkeypatch.setenv('ROS_SECURITY_KEYSTORE', str(tmp_path / 'none'))
    (tmp_path / 'gateways.yaml').write_text('metrics: {port: 0}')

    done = run_command(*words, cwd=tmp_path)

    line = done.stderr.splitlines()[-1]
    assert line.startswith(f'checkweigher {words[0]}: ROS_SECURITY_ENABLE=true: ')
    assert line.endswith(f"directory '{tmp_path}/none/enclaves/{enclave}' does not exist")
    assert (done.returncode, done.stdout) == (2, '')
    assert enclave in {path.strip('/') for path in enclaves(['lane1'])}


def test_a_line_starts_without_what_only_a_source_a_report_or_a_tuning_needs():
    code = """
import sys
import checkweigher_bringup.line
heavy = {'scipy', 'matplotlib', 'loky', 'rosbags', 'mcap', 'pymodbus', 'serial', 'gpiod'}
print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))
from checkweigher_bringup import batch_reporter
from checkweigher_bringup.commissioning import dynamic_setting, verifier
import checkweigher_web.server
print(sorted({'scipy', 'matplotlib', 'loky'} & set(sys.modules)))
"""
    done = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True)

    assert done.stdout.split() == ['[]', '[]']
