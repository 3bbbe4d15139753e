# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The record of the belt over ends of all kinds, in files and processes of their own."""

import errno
from itertools import combinations
import os
import signal
import subprocess
import sys
import time

import pytest
from running import wait_for

from checkweigher_core.parameters import ParameterError
from checkweigher_driver.line_io.belt_record import BeltRecord, OnBelt, record_path

RUNNING = OnBelt(released=True)


def found(path):
    """Return what a start finds, and end it in order."""
    record = BeltRecord(path)
    record.close(record.found)
    return record.found


@pytest.mark.parametrize('doubts', [(), ('item 3',)])
def test_an_orderly_end_leaves_only_what_nobody_has_looked_for_in_doubt(tmp_path, doubts):
    path = tmp_path / 'machines' / 'one.belt'
    record = BeltRecord(path)
    assert record.found.to_look_for() == ()
    record.keep(OnBelt(True, (), doubts))
    record.close(OnBelt(doubts=doubts))
    assert found(path).to_look_for() == doubts


def test_a_record_and_its_release_are_on_the_disk_before_the_belt_runs(tmp_path, on_disk):
    path = tmp_path / 'machines' / 'lane1' / 'belt'
    record = BeltRecord(path)
    assert on_disk[0] == path
    assert set(on_disk[1:]) == {path.parent, path.parent.parent, tmp_path}
    assert path.with_name('belt.begun').exists()
    on_disk.clear()
    record.keep(RUNNING)
    assert on_disk == [path]
    record.close(OnBelt())
    assert on_disk == [path, path]


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
        with pytest.raises(ParameterError, match='another driver uses this file'):
            BeltRecord(path)
        process.send_signal(signal.SIGKILL)
    (text,) = found(path).to_look_for()
    assert 'look for item 7 UNDER, and products that have entered since' in text


@pytest.mark.parametrize(
    'data',
    [
        b'', b'\0' * 100, b'["", [], []]\n', b'[true, [', b'[' * 16_384, b'7\n', b'[false]\n',
        b'\xff\xfe\n', b'00000000 \n', b'1a75953e [7]\n',
    ],
)  # fmt: skip
def test_a_record_that_cannot_be_read_leaves_all_in_doubt(tmp_path, data):
    path = tmp_path / 'belt'
    path.write_bytes(data)
    assert 'may not have been empty' in found(path).to_look_for()[0]


def test_a_record_that_is_gone_is_no_first_start(tmp_path):
    path = tmp_path / 'belt'
    assert found(path).to_look_for() == found(path).to_look_for() == ()
    path.unlink()
    assert found(path) == OnBelt(released=True)


def test_an_orderly_end_of_the_version_without_check_sums_leaves_nothing_in_doubt(tmp_path):
    path = tmp_path / 'belt'
    path.write_bytes(b'[false, [], []]\n"], []]\n' + b'\0' * 100)
    assert found(path) == OnBelt()


def test_a_first_start_that_is_refused_leaves_nothing(tmp_path, monkeypatch):
    def full(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    path = tmp_path / 'belt'
    with monkeypatch.context() as context:
        context.setattr(os, 'posix_fallocate', full)
        with pytest.raises(ParameterError, match='No space left'):
            BeltRecord(path)
    assert list(tmp_path.iterdir()) == []
    assert found(path) == OnBelt()


@pytest.mark.parametrize(
    ('call', 'number', 'message'),
    [('pwrite', errno.ENOSPC, 'No space left'), ('fsync', errno.EIO, 'Input/output error')],
)
def test_the_belt_may_not_run_before_its_start_is_on_the_disk(
    tmp_path, monkeypatch, call, number, message
):
    def fail(*_):
        raise OSError(number, os.strerror(number))

    record = BeltRecord(tmp_path / 'belt')
    with monkeypatch.context() as context:
        context.setattr(os, call, fail)
        for _ in range(3):
            with pytest.raises(OSError, match=message):
                record.keep(RUNNING)
    record.keep(RUNNING)
    assert OnBelt.of_line((tmp_path / 'belt').read_bytes()) == RUNNING
    record.close(OnBelt())


# Of a line that was killed, and of one that ended in order, each with a product on its belt.
WITH_A_PRODUCT = (
    OnBelt(True, ('item 7 UNDER (entered 22:13:20.5)',), ()),
    OnBelt(doubts=('the outputs were made safe: look for item 7 UNDER',)),
)


@pytest.mark.parametrize('belt', WITH_A_PRODUCT)
def test_no_damage_hides_a_product(belt):
    line = belt.line()
    assert OnBelt.of_line(line) == belt
    cuts = list(combinations(range(len(line) + 1), 2))
    spoilt = [line[:begin] + line[end:] for begin, end in cuts]  # also each truncation
    spoilt += [line[:begin] + b'\0' * (end - begin) + line[end:] for begin, end in cuts]
    spoilt += [
        line[:place] + bytes([byte]) + line[place + 1 :]
        for place in range(len(line))
        for byte in range(256)
    ]
    assert all(OnBelt.of_line(each).to_look_for() for each in spoilt)
    print(f'{len(spoilt)} damaged records, none of them an empty belt')


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
