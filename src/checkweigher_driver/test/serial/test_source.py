# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Every serial source against a device on a pseudo-terminal, at the pace of its wire."""

from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
import itertools
import os
import re
import time
from types import SimpleNamespace

import numpy as np
import pytest
from serial_device import number_of
from serial_line import LINES, RATE, Reader, SerialDevice, make

from checkweigher_core.parameters import ParameterError
from checkweigher_driver.serial.port import SerialError, open_port

BREAKS = 20  # of a line that is unplugged again and again


@pytest.fixture
def device(tmp_path):
    started = []

    def start(*options):
        started.append(SerialDevice(tmp_path / 'port', '--rate', RATE, *options))
        return started[-1]

    yield start
    for each in started:
        each.end()


def travel(name, values, options, link):
    """Return what a source did while its line was well, was disturbed and was unplugged."""
    checked = values.get('checksum', name == 'aed')
    journey = SimpleNamespace(name=name, checked=checked, figures={}, trouble={}, times={})
    device = SerialDevice(link, '--rate', RATE, *options)

    def note(station):
        journey.figures[station] = reader.source.figures()
        journey.trouble[station] = reader.source.trouble

    try:
        reader = Reader(make(name, link, **values))
        reader.wait_for_samples(2400)
        end = reader.end_index
        note('well')
        for command in ('lose 3', 'corrupt'):
            lost = reader.source.figures()['samples lost']
            device.tell(command)
            if command == 'lose 3' or journey.checked:
                figures = reader.source.figures
                reader.wait_for(lambda: figures()['samples lost'] > lost)  # noqa: B023
            reader.wait_for_samples(50)
        note('disturbed')
        device.tell('silence 1.3')
        journey.times['to silence'] = reader.wait_for(lambda: reader.source.trouble)
        note('silent')
        reader.wait_for_samples(100)
        note('heard again')
        device.tell('unplug')
        journey.times['to unplugged'] = reader.wait_for(lambda: reader.source.trouble)
        note('unplugged')
        device.tell('replug')
        journey.times['to replugged'] = reader.wait_for_samples(100)
        note('replugged')
        journey.times['to end'] = reader.close()
        port = open_port(str(link), 115_200)  # the source holds it no more
        journey.after = port.read(1)
        port.close()
        journey.blocks, journey.error = reader.events, reader.error
        journey.well = [block for block in reader.events if block.first_index < end]
        journey.host_late = reader.host_late
    finally:
        device.end()
    return journey


@contextmanager
def streaming(link, rate=RATE):
    """Run a device that streams, and yield it with the reader of its source."""
    machine = SerialDevice(link, '--rate', rate)
    reader = Reader(make('aed', link))
    reader.wait_for_samples(1)
    yield machine, reader
    reader.close()
    machine.end()


def stopped(link):
    """Return the figures of a source whose stream another program stops."""
    with streaming(link) as (machine, reader):
        machine.tell('stop')
        reader.wait_for(lambda: reader.source.figures()['breaks'])
        reader.wait_for_samples(50)
    return reader.source.figures()


def replaced(link):
    """Return the error that ends a source in whose place another device is plugged in."""
    with streaming(link) as (machine, reader):
        for command in ('unplug', 'identity HBM,FIT/5,9999999,P72', 'replug'):
            machine.tell(command)
        reader.wait_for_end()
    return reader.error


def slower(link):
    """Return what a source says of a device that is set to another rate."""
    with streaming(link, 600) as (_, reader):
        reader.wait_for(lambda: reader.source.trouble)
        return reader.source.trouble


@pytest.fixture(scope='module')
def running(tmp_path_factory):
    """Have all that takes long run side by side; most of the time is spent waiting."""

    def port():
        return tmp_path_factory.mktemp('line') / 'port'

    with ThreadPoolExecutor(8) as pool:
        done = {name: pool.submit(travel, *line, port()) for name, line in LINES.items()}
        for task in (stopped, replaced, slower):
            done[task] = pool.submit(task, port())
        yield done


@pytest.fixture(params=LINES)
def journey(running, request):
    return running[request.param].result()


def numbers(block):
    return [number_of(count) for count in block.counts.tolist()]


def test_at_1200_values_a_second_nothing_is_lost(journey):
    blocks = journey.well
    counts = np.concatenate([block.counts for block in blocks])

    assert journey.trouble['well'] == ''
    assert journey.figures['well']['samples lost'] == journey.figures['well']['breaks'] == 0
    assert len(counts) >= 2400
    assert [b.first_index for b in blocks] == list(
        np.cumsum([0] + [len(b.counts) for b in blocks[:-1]])
    )
    sent = np.array([number_of(count) for count in counts.tolist()])
    np.testing.assert_array_equal(np.diff(sent), 1)


def test_stamps_follow_the_samples(journey):
    blocks = journey.well
    stamps = np.array([b.stamp for b in blocks])
    indices = np.array([b.first_index for b in blocks])
    # A machine so busy that all reads of the first second are late begins a new line.
    figures = journey.figures['well']
    assert np.sum(np.diff(stamps) <= 0) <= figures['clock steps'] + figures['clock shifts']
    off = (stamps - stamps[0]) / 1e9 - (indices - indices[0]) / RATE
    # A busy machine reads some blocks late, and learns of it only afterwards.
    assert np.median(np.abs(off - np.median(off))) < 0.02


def test_no_disturbance_lets_a_wrong_value_through(journey):
    for block in journey.blocks:
        sent = numbers(block)
        bad = [n for n, after in itertools.pairwise(sent) if after != n + 1]
        # Without a checksum the disturbed byte does come through: once.
        assert len(bad) <= (0 if journey.checked else 2)


def test_what_is_lost_is_a_jump_of_the_index(journey):
    blocks = journey.blocks
    gaps = [
        after.first_index - before.first_index - len(before.counts)
        for before, after in itertools.pairwise(blocks)
    ]
    assert min(gaps) >= 0
    assert sum(gaps) == journey.figures['replugged']['samples lost']
    assert journey.figures['disturbed']['bad frames'] >= 1
    assert journey.figures['replugged']['breaks'] == 2
    assert journey.error is None


def test_after_a_break_the_index_is_that_of_the_time(journey):
    first, last = journey.blocks[0], journey.blocks[-1]
    sent = numbers(last)[-1] - numbers(first)[0]
    index = last.first_index + len(last.counts) - 1 - first.first_index
    most = 0.1 + journey.host_late  # s: a busy host reads late
    assert abs(sent - index) < most * RATE
    late = (last.stamp - first.stamp) / 1e9 - (last.first_index - first.first_index) / RATE
    assert abs(late) < most


def test_trouble_is_said_in_words_and_ends(journey):
    trouble = journey.trouble
    assert 'no bytes arrive for 1 s; check the cable' in trouble['silent']
    assert trouble['heard again'] == trouble['replugged'] == ''
    assert 'is the device plugged in?' in trouble['unplugged']


def test_a_closed_source_ends_and_lets_go(journey):
    assert journey.times['to end'] < 2 + journey.host_late
    if journey.name == 'aed':  # ascii sends unasked
        assert journey.after == b''


@pytest.mark.parametrize(
    ('options', 'values'),
    [
        ((), {'address': 21}),
        (('--reset-time', 0.3), {'reset': True}),  # it is waited for
        (('--late', 0.6), {}),  # a reply after it was given up is not taken for the next one
    ],
)
def test_the_device_says_who_it_is(device, options, values):
    source = make('aed', device(*options).link, **values)
    source.close()
    assert (source.load_cell.model, source.load_cell.serial_number) == ('HBM FIT/5', '0123456')
    assert source.load_cell.sample_rate == RATE


@pytest.mark.parametrize(
    ('options', 'message'),
    [
        (('--mute',), r'no reply to IDN\? within 0.5 s; check the supply, the wires, baud_rate'),
        (('--refuse', 'IDN'), r'the device does not know IDN\?'),
        (('--identity', 'scale 3'), r"the reply 'scale 3' to IDN\? is not that of a load cell"),
        (('--refuse', 'STR'), r"replies '\?' to STR 1; see aed\.termination"),
        (('--refuse', 'CSM'), r"replies '\?' to CSM 1; see aed\.checksum"),
        (('--refuse', 'ASF'), r"replies '\?' to ASF 5; see aed\.filter"),
        (('--baud', '57600'), r'set to 57600 Bd, but aed\.baud_rate is 115200'),
    ],
)
def test_a_device_that_does_not_answer_as_it_should_is_refused(device, options, message):
    with pytest.raises(SerialError, match=message):
        make('aed', device(*options).link, filter=5)


def test_another_device_in_its_place_ends_the_stream(running):
    error = running[replaced].result()
    assert isinstance(error, SerialError)
    assert 'HBM FIT/5 9999999 answers instead of HBM FIT/5 0123456' in str(error)


def test_a_stream_that_is_stopped_is_started_again(running):
    figures = running[stopped].result()
    assert figures['breaks'] == 1
    assert figures['samples lost'] > 1.0 * RATE


def test_a_device_that_is_set_to_another_rate_is_said_to_be(running):
    found = re.fullmatch(
        r'the device sends (\d+) values per second, but aed.sample_rate is 1200',
        running[slower].result(),
    )
    assert found
    assert float(found[1]) == pytest.approx(600, rel=0.1)


def test_a_port_that_cannot_be_opened_says_why(device, tmp_path):
    with pytest.raises(SerialError, match='there is no such port; is the device plugged in'):
        make('aed', tmp_path / 'none')
    plain = tmp_path / 'plain'
    plain.touch()
    with pytest.raises(SerialError, match='is not a serial port'):
        make('aed', plain)
    machine = device()
    first = make('aed', machine.link)
    with pytest.raises(SerialError, match='another program has the port open'):
        make('aed', machine.link)
    first.close()


def test_a_port_without_permission_names_the_group(device, tmp_path):
    target = device().link.resolve()
    target.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65534)  # root may open everything
    try:
        with pytest.raises(SerialError, match=r'no permission; add the user to the group \w+'):
            make('aed', target)
    finally:
        os.seteuid(user)
        target.chmod(0o600)


@pytest.mark.parametrize(
    ('values', 'message'),
    [
        ({'port': ''}, r'aed\.port: empty, must name a port such as /dev/ttyUSB0'),
        ({'counts_per_kg': 0.0}, r'aed\.counts_per_kg: 0, must be given for this machine'),
        ({'weigh_length': 0.0}, r'aed\.weigh_length: 0, must be given'),
        (
            {'sample_rate': 960.0, 'baud_rate': 38_400},
            r'aed\.baud_rate: 38400 Bd is too slow for 960 values per second of 6 bytes; '
            r'must be 57600 Bd or more',
        ),
        ({'trailer': 'none', 'checksum': False}, r"aed\.trailer: 'none' needs aed\.checksum"),
    ],
)
def test_what_cannot_work_is_refused_before_the_port_is_opened(tmp_path, values, message):
    with pytest.raises(ParameterError, match=message):
        make('aed', tmp_path / 'none', **values)


def test_960_values_a_second_fit_through_57600_baud(tmp_path):
    for rate, trailer in ((57_600, 'auto'), (38_400, 'none')):
        with pytest.raises(SerialError, match='there is no such port'):
            make('aed', tmp_path / 'no', sample_rate=960.0, baud_rate=rate, trailer=trailer)


def test_a_pattern_without_a_number_is_refused(tmp_path):
    with pytest.raises(ParameterError, match=r'ascii\.pattern: .* has no group'):
        make('ascii', tmp_path / 'none', pattern='S.*')


@pytest.mark.soak
@pytest.mark.parametrize('name', LINES)
def test_a_minute_at_1200_values_a_second_loses_nothing(name, tmp_path):
    kind, values, options = LINES[name]
    device = SerialDevice(tmp_path / 'port', '--rate', RATE, *options)
    reader = Reader(make(kind, tmp_path / 'port', **values))
    reader.wait_for_samples(1)
    cpu, begin = time.process_time(), time.monotonic()
    reader.wait_for_samples(60 * RATE, patience=90)
    cpu = (time.process_time() - cpu) / (time.monotonic() - begin)
    reader.close()
    device.end()

    figures = reader.source.figures()
    counts = np.concatenate([block.counts for block in reader.events])
    print(f'\n{name}: {len(counts)} values, {cpu:.1%} of a core, {figures}')
    sent = np.array([number_of(count) for count in counts.tolist()])
    np.testing.assert_array_equal(np.diff(sent) % 2**24, 1)
    assert figures['samples lost'] == figures['bad frames'] == figures['breaks'] == 0


def unplugged_again_and_again(name, link):
    """Return how long each break took to be noticed and each replug to bring samples, s."""
    kind, values, options = LINES[name]
    device = SerialDevice(link, '--rate', RATE, *options)
    reader = Reader(make(kind, link, **values))
    reader.wait_for_samples(100)
    noticed, back = [], []
    for number in range(BREAKS):
        device.tell('unplug')
        noticed.append(reader.wait_for(lambda: reader.source.trouble))
        time.sleep(0.1 * number)  # breaks of different lengths, not a wait for something
        device.tell('replug')
        back.append(reader.wait_for_samples(50))
    reader.close()
    device.end()
    assert reader.error is None
    assert reader.source.figures()['breaks'] >= BREAKS
    values_of = [number_of(count) for b in reader.events for count in b.counts.tolist()]
    assert all(after > before for before, after in itertools.pairwise(values_of))
    return noticed, back


@pytest.mark.soak
def test_a_line_that_is_unplugged_again_and_again_comes_back_each_time(tmp_path):
    with ThreadPoolExecutor() as pool:
        results = list(
            pool.map(
                unplugged_again_and_again, LINES, [tmp_path / f'port{i}' for i in range(len(LINES))]
            )
        )
    for name, (noticed, back) in zip(LINES, results, strict=True):
        print(
            f'\n{name}: {len(noticed)} breaks, noticed after {np.median(noticed):.3f} s '
            f'(at most {max(noticed):.3f} s), samples {np.median(back):.2f} s after the replug '
            f'(at most {max(back):.2f} s)'
        )
