# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Changes of a running line, which are in the audit log before they take effect, or refused."""

from contextlib import suppress
import os
from pathlib import Path
import random
import signal
import subprocess
import time
from typing import Any

from checkweigher_msgs.msg import Verdict
from checkweigher_msgs.srv import NewBatch, RecordChange
from full_disk import file_size_limit
from graph import wait_for
from product_line import BELT, Line
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger
from supervised_line import supervised_line

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_core.health.findings import Level
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_production.audit_log import head_path, read_log


@pytest.fixture(name='line')
def _line(line: Line) -> Line:
    line.wait_until_found()
    return line


def set_limit(line: Line, value: float, *, atomically: bool = False) -> Any:
    """Set the lower limit, and return the result."""
    if not atomically:
        return line.set_limit('lower_limit', value)
    change = Parameter('lower_limit', value=value).to_parameter_msg()
    name = 'reject/set_parameters_atomically'
    return line.call(SetParametersAtomically, name, parameters=[change]).result


def limit(line: Line) -> object:
    return line.parameters()['reject']['lower_limit']


def health(line: Line) -> tuple[Level, str]:
    findings = {each.aspect: each for each in line.product.diagnose(time.monotonic())}
    return findings['Audit log'].level, findings['Audit log'].message


def test_on_a_full_disk_nothing_is_changed_and_afterwards_the_log_says_so(line: Line):
    assert set_limit(line, 0.13).successful
    with file_size_limit(line.log.stat().st_size + 100):
        refused = 0
        for number in range(29):
            result = set_limit(line, 0.14 + number / 1000, atomically=number % 2 == 1)
            assert not result.successful
            assert 'not in the audit log' in result.reason
            refused += limit(line) == 0.13
        assert 'not in the audit log' not in line.call(NewBatch, 'new_batch', batch='b').message
        batch, product = line.call(NewBatch, 'new_batch', batch='b'), line.select('nuts')
        assert (batch.success, product.success) == (False, False)
        line.publish(ports.LOAD_CELL_INFO, to_message(ports.LOAD_CELL_INFO, BELT, stamp=1))
        wait_for(lambda: 'no load_cell/info' not in line.call(Trigger, 'zero').message)
        assert 'not in the audit log' in line.call(Trigger, 'zero').message
        assert health(line)[0] == Level.ERROR
        assert 'changes are refused' in health(line)[1]
        assert read_log(line.log).whole
    print(f'29 changes on a full disk: refused {refused}, in effect {29 - refused}')
    assert refused == 29
    wait_for(lambda: bool(line.entries('refused')) and bool(line.entries('calibration')))
    (entry,) = line.entries('refused')
    assert (entry.subject, entry.new.split(',')[0]) == ('audit log', f'{29 + 5} changes')
    wait_for(lambda: health(line)[0] == Level.OK)
    assert set_limit(line, 0.15).successful
    assert limit(line) == 0.15
    assert [(e.old, e.new) for e in line.entries('parameter')][-1] == (0.13, 0.15)


@pytest.mark.parametrize(
    'tamper',
    [
        lambda log: subprocess.run(['sed', '-i', 's/inf/1.0/', str(log)], check=True),
        lambda log: os.truncate(log, 100),
        lambda log: head_path(log).unlink(),
    ],
    ids=['replaced', 'truncated', 'without head'],
)
def test_a_log_that_was_tampered_with_takes_no_entry_and_no_change_is_made(line: Line, tamper: Any):
    assert set_limit(line, 0.13).successful
    tamper(line.log)
    left = line.log.read_bytes()
    result = set_limit(line, 0.14)
    assert (result.successful, limit(line)) == (False, 0.13)
    assert str(line.log) in result.reason
    assert health(line)[0] == Level.ERROR
    assert line.log.read_bytes() == left
    assert not read_log(line.log).whole


def test_without_the_node_that_has_the_log_nothing_is_changed(line: Line):
    assert set_limit(line, 0.13).successful
    line.spinner.remove(line.product)
    result = set_limit(line, 0.14)
    assert (result.successful, limit(line)) == (False, 0.13)
    assert 'the node product did not answer' in result.reason


def test_what_was_announced_and_not_made_is_found(line: Line):
    announced = line.call(
        RecordChange,
        ports.RECORD_CHANGE,
        kind='parameter',
        subject='/lane1/reject',
        new_value='{"upper_limit": 0.2}',
    )
    assert announced.success
    wait_for(lambda: len(line.entries('found')) == len(STAGE_NODES) + 2)
    found = line.entries('found')[-1]
    assert (found.subject, found.old, found.new) == (
        '/lane1/reject',
        {'upper_limit': 0.2},
        {'upper_limit': 'inf'},
    )


def test_what_is_no_change_of_the_line_is_no_entry(line: Line):
    before = read_log(line.log).entries
    for kind, subject, value in (
        ('parameter', '/lane2/reject', '{"upper_limit": 0.2}'),
        ('parameter', '/lane1/nobody', '{"upper_limit": 0.2}'),
        ('parameter', '/lane1/reject', '7'),
        ('parameter', '/lane1/reject', '[' * 100_000),
        ('torn', 'last entry', '{}'),
        ('selection', 'product', '"nuts"'),
    ):
        change = {'kind': kind, 'subject': subject, 'new_value': value}
        assert not line.call(RecordChange, ports.RECORD_CHANGE, **change).success, change
        assert read_log(line.log).entries == before


@pytest.mark.soak
def test_no_change_escapes_the_log_while_the_node_that_has_it_is_killed_and_halted(tmp_path: Path):
    log, chance = tmp_path / 'audit.log', random.Random(3)
    parameters = f'/**/product: {{ros__parameters: {{audit_log: {log}}}}}'
    taken, refused, escaped = [0.0], [], []
    with supervised_line(tmp_path, parameters) as line:
        wait_for(lambda: log.exists() and b'/running/reject' in log.read_bytes())
        line.judge_until(Verdict.ACCEPT)
        for number in range(1, 61):
            kind, product = chance.choice([0, 0, 0, 0, signal.SIGKILL, signal.SIGSTOP]), None
            with suppress(AssertionError, OSError):  # it is yet to be started again
                product = line.pid('product')
                os.kill(product, kind)  # 0: it goes on
            time.sleep(chance.uniform(0, 0.1))
            change = Parameter('actuator_delay', value=number / 1000).to_parameter_msg()
            answer = line.call(SetParameters, 'reject/set_parameters', parameters=[change])
            (taken if answer.results[0].successful else refused).append(number / 1000)
            answer = line.call(GetParameters, 'reject/get_parameters', names=['actuator_delay'])
            if answer.values[0].double_value != taken[-1]:
                escaped.append(number)
            if product is not None and kind == signal.SIGSTOP:
                with suppress(OSError):
                    os.kill(product, signal.SIGCONT)
            time.sleep(chance.uniform(0, 3))
        assert line.end() == 130
    found = read_log(log)
    written = [e.new for e in found.entries if e.subject == '/running/reject.actuator_delay']
    lost, doubled = set(taken[1:]) - set(written), len(written) - len(set(written))
    print(
        f'{len(taken) - 1} changes taken, not in the log {len(lost)}, there twice {doubled}; '
        f'{len(refused)} refused, in effect all the same {len(escaped)}'
    )
    assert found.whole
    assert (lost, doubled, escaped) == (set(), 0, [])
