# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of the belt over ends of all kinds, in files and processes of their own."""

import signal
import subprocess
import sys
import time

from modbus_machine import wait_for
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_driver.line_io.belt_record import BeltRecord, OnBelt, record_path

RUNNING = OnBelt(released=True)


def found(path):
    """Return what a start finds, and end it in order."""
    record = BeltRecord(path)
    record.close(record.found)
    return record.found


def test_a_first_start_and_an_orderly_end_leave_nothing_in_doubt(tmp_path):
    path = tmp_path / 'machines' / 'one.belt'
    record = BeltRecord(path)
    assert record.found.to_look_for() == ()
    record.keep(RUNNING)
    record.close(OnBelt())
    assert found(path).to_look_for() == ()


def test_what_nobody_has_looked_for_is_told_at_the_next_start(tmp_path):
    record = BeltRecord(tmp_path / 'belt')
    record.keep(OnBelt(True, (), ('item 3',)))
    record.close(OnBelt(doubts=('item 3',)))
    assert found(tmp_path / 'belt').to_look_for() == ('item 3',)


def test_a_killed_process_leaves_the_names_of_what_was_on_the_belt(tmp_path):
    path = tmp_path / 'belt'
    program = (
        'import sys, time\n'
        'from pathlib import Path\n'
        'from checkweigher_driver.line_io.belt_record import BeltRecord, OnBelt\n'
        'record = BeltRecord(Path(sys.argv[1]))\n'
        'record.keep(OnBelt(True))\n'
        'record.keep(OnBelt(True, ("item 7 UNDER",)))\n'
        'print("kept", flush=True)\n'
        'time.sleep(60)\n'
    )
    with subprocess.Popen(
        [sys.executable, '-c', program, str(path)], stdout=subprocess.PIPE, text=True
    ) as process:
        assert process.stdout.readline() == 'kept\n'
        wait_for(lambda: b'item 7' in path.read_bytes(), 'the names')
        with pytest.raises(ParameterError, match='another driver has it'):
            BeltRecord(path)
        process.send_signal(signal.SIGKILL)
    (text,) = found(path).to_look_for()
    assert 'look for item 7 UNDER, and what has entered since' in text


@pytest.mark.parametrize('data', [b'\0' * 100, b'[true, [', b'7\n', b'[false]\n', b'\xff\xfe\n'])
def test_a_record_that_cannot_be_read_leaves_all_in_doubt(tmp_path, data):
    path = tmp_path / 'belt'
    path.write_bytes(data)
    assert 'did not end with an empty belt' in found(path).to_look_for()[0]


@pytest.mark.parametrize('name', ['', 'file/belt', 'fifo', 'full'])
def test_where_there_can_be_no_record_the_driver_is_told_at_the_start(tmp_path, name):
    (tmp_path / 'file').touch()
    (tmp_path / 'fifo').symlink_to('/dev/null')
    (tmp_path / 'full').symlink_to('/dev/full')
    with pytest.raises(ParameterError, match=r"^rejector\.record: '[^\n]*must be a file"):
        BeltRecord(tmp_path / name)


def test_the_names_cost_those_who_tell_them_no_disk(tmp_path):
    record = BeltRecord(tmp_path / 'belt')
    record.keep(RUNNING)
    names = tuple(f'item {number} UNDER (entered 12:00:00.0)' for number in range(10))
    took = []
    for number in range(1000):
        belt = OnBelt(True, (*names, str(number)))
        begin = time.perf_counter_ns()
        record.keep(belt)
        took.append(time.perf_counter_ns() - begin)
    record.close(OnBelt())
    took.sort()
    print(f'keep: median {took[500] / 1e3:.1f} us, 99 % within {took[990] / 1e3:.1f} us')
    assert took[500] < 2_000_000


def test_a_record_has_the_name_of_its_outputs(monkeypatch):
    monkeypatch.setenv('XDG_STATE_HOME', '/state')
    path = record_path('', 'modbus-10.0.0.1-502-1-0')
    assert str(path) == '/state/checkweigher/modbus-10.0.0.1-502-1-0.belt'
    assert record_path('', 'gpio-/dev/gpiochip0-2').name == 'gpio-_dev_gpiochip0-2.belt'
    assert str(record_path('/var/lib/belt', 'any')) == '/var/lib/belt'
