"""The command line: its help, its examples, and what it takes from the parameters."""

from dataclasses import fields
import os
import subprocess
import sys

import pytest
from running import BAGS, run_command

from checkweigher_bringup.cli import COMMANDS, build_parser
from checkweigher_bringup.commands import weigh
from checkweigher_dsp.pipeline import side_processes
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.csv.log_import import ImportParameters

EXAMPLES = {name: example for name, _, example in COMMANDS}


def test_help_lists_every_command_with_its_example():
    done = run_command('--help')
    assert done.returncode == 0
    for example in EXAMPLES.values():
        assert example in done.stdout


@pytest.mark.parametrize('name', EXAMPLES)
def test_every_command_has_help_with_its_example(name: str):
    done = run_command(name, '--help')
    assert done.returncode == 0
    assert EXAMPLES[name] in done.stdout


@pytest.mark.parametrize('name', EXAMPLES)
def test_every_example_is_one_that_the_parser_takes(name: str):
    assert build_parser().parse_args(EXAMPLES[name].split()).command == name


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


@pytest.fixture
def weigh_beside(monkeypatch):
    """Return a function that weighs a bag, however short it is, with one more process."""
    monkeypatch.setattr(weigh, '_LONG', 0)
    monkeypatch.setattr(side_processes, 'spare_cores', lambda: 1)
    return lambda bag: weigh.run(build_parser().parse_args(['weigh', str(bag)]))


def test_another_process_reads_a_bag_and_changes_nothing(weigh_beside, capsys):
    assert weigh_beside(BAGS / 'paper_90') == 0

    assert capsys.readouterr().out == run_command('weigh', BAGS / 'paper_90').stdout


def test_a_bag_is_read_here_if_the_process_that_reads_it_is_killed(
    weigh_beside, capsys, monkeypatch
):
    begin = weigh._begin_reading

    def begin_and_kill(arguments, processes):
        processes.submit(os._exit, 9)
        return begin(arguments, processes)

    monkeypatch.setattr(weigh, '_begin_reading', begin_and_kill)

    assert weigh_beside(BAGS / 'paper_90') == 0
    assert capsys.readouterr().out == run_command('weigh', BAGS / 'paper_90').stdout


def test_what_another_process_finds_wrong_with_a_bag_is_said_as_ever(weigh_beside, tmp_path):
    with pytest.raises(BagError, match='there is no such file'):
        weigh_beside(tmp_path / 'nothing')
