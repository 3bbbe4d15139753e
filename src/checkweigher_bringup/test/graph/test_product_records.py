# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node `product` over real DDS: statistics, audit log and batches, which survive restarts."""

from dataclasses import asdict
import hashlib
import json
import math
from pathlib import Path
import queue
import statistics
from typing import Any

from checkweigher_msgs.msg import StreamStatus
from checkweigher_msgs.srv import NewBatch, RecordChange, ResetStatistics
from graph import wait_for
from here import run_here
from product_line import Line
import pytest
from rcl_interfaces.msg import ParameterEvent
from rclpy.parameter import Parameter
from running import BAGS, PATIENCE, Rows

from checkweigher_bringup.batch_reporter import BatchReporter
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import NANOSECONDS, ZeroChange
from checkweigher_core.ros import ports
from checkweigher_core.ros.conversion import to_message
from checkweigher_driver.driver_node import DriverNode
from checkweigher_production.audit_chain import read_chain
from checkweigher_production.audit_log import AuditLog, head_path, read_log
from checkweigher_production.batch_record import read_lines
from checkweigher_production.nodes.product import ProductNode


def test_what_becomes_of_the_zero_is_in_the_log(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, recipes='')
    out = ('ZeroOutOfRange',)
    for reasons in ((), out, out, ('MissingEdge',), ()):
        line.judge(math.nan if reasons else 0.1, reasons=reasons)
    change = ZeroChange(1_700_000_000 * NANOSECONDS, 0.001, 0.0002, 1e-5)
    publisher = line.operator.create_publisher(
        ports.ZERO_SETTING.type, ports.ZERO_SETTING.name, ports.ZERO_SETTING.qos
    )
    for _ in range(2):  # what is latched comes again
        publisher.publish(to_message(ports.ZERO_SETTING, change))
    wait_for(lambda: len(line.entries('zero')) == 3)

    setting, *range_ = sorted(line.entries('zero'), key=lambda entry: entry.subject, reverse=True)

    assert (setting.subject, setting.old, setting.new) == ('zero_setting', None, asdict(change))
    assert [(e.subject, e.old, e.new) for e in range_] == [
        ('ZeroOutOfRange', False, True),
        ('ZeroOutOfRange', True, False),
    ]


def test_the_audit_log_believes_no_parameter_event(line: Line):
    line.wait_until_found()
    events = line.operator.create_publisher(ParameterEvent, '/parameter_events', 1000)
    names = ('upper_limit', 'no_such_parameter')
    for number in range(300):
        false = [Parameter(name, value=float(number)).to_parameter_msg() for name in names]
        for node in ('reject', 'nobody'):
            said = ParameterEvent(node=f'/lane1/{node}', changed_parameters=false)
            events.publish(said)
    assert line.set_limit('upper_limit', 0.5).successful
    wait_for(lambda: bool(line.entries('parameter')))
    assert [(e.subject, e.old, e.new) for e in line.entries('parameter')] == [
        ('/lane1/reject.upper_limit', 'inf', 0.5)
    ]


def test_results_and_signatures_come_into_the_log_with_names_that_are_claims(line: Line):
    for kind, subject, success in (
        ('verification', '20260528T060000Z', True),
        ('signature', 'no such batch', False),
    ):
        answer = line.call(
            RecordChange, 'record_change', kind=kind, subject=subject, new_value='{"a": 1}',
            who='chief.inspector',
        )  # fmt: skip
        assert answer.success is success, answer.message
    (entry,) = line.entries('verification', 'signature')
    assert (entry.subject, entry.new, entry.who) == (
        '20260528T060000Z',
        {'a': 1},
        'claimed:chief.inspector',
    )


def test_a_clock_that_was_set_back_and_the_log_before_are_in_a_new_log(
    spinner: Spinner, tmp_path: Path
):
    with AuditLog(tmp_path / 'audit.log') as log:
        log.append('2999-01-01T00:00:00+00:00', '/lane1/product', 'zero', 'zero', 0.0, 1.0)
    line = Line(spinner, tmp_path)
    wait_for(lambda: bool(line.entries('clock')))
    (set_back,) = line.entries('clock')
    assert (set_back.subject, set_back.old) == ('start', '2999-01-01T00:00:00+00:00')
    spinner.remove(line.product)
    for path in (line.log, head_path(line.log)):
        path.rename(path.with_name(path.name.replace('audit', 'old')))
    line.start_product()
    wait_for(lambda: bool(line.entries('found')))
    chain = read_chain(line.log)
    (first, before), (second, now) = chain.logs
    assert (first.name, second.name, chain.fault) == ('old.log', 'audit.log', '')
    last = before.entries[-1]
    named = {'file': 'old.log', 'entries': last.sequence, 'hash': last.hash}
    assert (now.entries[0].kind, now.entries[0].new) == ('log', named)


def test_a_start_with_a_bad_recipe_is_refused(spinner: Spinner, tmp_path: Path):
    path = tmp_path / 'recipes.yaml'
    path.write_text('products: {crisps: {nominal: -1}}', encoding='utf-8')
    with pytest.raises(ParameterError, match=r'yaml: line 1: products\.crisps\.nominal: -1'):
        ProductNode({'recipes': str(path), 'product': 'crisps'})
    log = tmp_path / 'audit.log'
    log.write_text('{"sequence":7}\n', encoding='utf-8')
    with pytest.raises(ParameterError, match=r'audit\.log: line 1: changed'):
        ProductNode({'audit_log': str(log)})


def test_a_change_of_a_parameter_is_in_the_log_with_its_old_and_its_new_value(line: Line):
    line.wait_until_found()
    for value in (0.13, 0.14):
        assert line.set_limit('lower_limit', value).successful
    wait_for(lambda: len(line.entries('parameter')) == 2)
    changes = [(e.source, e.subject, e.old, e.new) for e in line.entries('parameter')]
    assert changes == [
        ('/lane1/product', '/lane1/reject.lower_limit', '-inf', 0.13),
        ('/lane1/product', '/lane1/reject.lower_limit', 0.13, 0.14),
    ]
    done = run_here('audit', line.log)
    assert done.returncode == 0
    assert '/lane1/reject.lower_limit: 0.13 -> 0.14' in done.stdout
    # What was changed in the file is told with its line.
    count = len(read_log(line.log).entries)
    line.log.write_bytes(line.log.read_bytes().replace(b'"new":0.14', b'"new":0.13'))
    done = run_here('audit', line.log, '--json')
    assert done.returncode == 1
    told = json.loads(done.stdout)
    assert (told['problem'], told['bad_line']) == ('changed', count)
    assert run_here('audit', line.recipes.parent / 'nothing').returncode == 2


def test_a_batch_and_a_reset_end_a_count_and_are_in_the_log(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, batch='monday', batch_folder=str(tmp_path / 'batches'))
    line.judge(0.1)
    for name, why in (('monday', 'not used before'), (' ', 'before'), ('x' * 300, 'at most 200')):
        answer = line.call(NewBatch, 'new_batch', batch=name)
        assert (answer.success, why in answer.message) == (False, True)
    ended = line.call(NewBatch, 'new_batch', batch='tuesday')
    assert (ended.success, ended.finished.batch, ended.finished.items) == (True, 'monday', 1)
    line.judge(0.1)
    line.judge(0.1)
    ended = line.call(ResetStatistics, 'reset_statistics')
    assert (ended.success, ended.finished.batch, ended.finished.items) == (True, 'tuesday', 2)
    wait_for(lambda: line.statistics[-1].items == 0)
    assert [(e.kind, e.old['items'], e.new) for e in line.entries('batch', 'reset')] == [
        ('batch', 1, 'tuesday'),
        ('reset', 2, None),
    ]


def test_the_statistics_of_a_bag_are_those_of_its_csv(spinner: Spinner, rows: Rows, tmp_path: Path):
    bag, parameters = BAGS / 'paper_90', tmp_path / 'limits.yaml'
    parameters.write_text(
        '/**/reject:\n  ros__parameters: {lower_limit: 0.14725, upper_limit: 0.169}\n'
        '/**/identifier:\n  ros__parameters: {estimator: hann}\n'
    )
    weighed = rows('weigh', bag, '--params', parameters)
    line = Line(spinner, tmp_path, weighs=True)
    assert line.select('crisps').success
    ends: queue.SimpleQueue[int] = queue.SimpleQueue()
    line.listen(ports.SEGMENTER_STATUS, lambda m: ends.put(m.state))
    spinner.add(DriverNode({'source': 'bag', 'bag.path': str(bag), 'rate': 0.0}))
    while ends.get(timeout=PATIENCE) != StreamStatus.FINISHED:
        pass
    wait_for(lambda: line.statistics[-1].items == len(weighed))
    counted = line.statistics[-1]
    decisions = [row['decision'] for row in weighed]
    assert [counted.accepted, counted.under, counted.over, counted.faults] == [
        decisions.count(name) for name in ('ACCEPT', 'UNDER', 'OVER', 'FAULT')
    ]
    masses = [float(r['mass_g']) / 1000 - 0.004 for r in weighed if r['decision'] == 'ACCEPT']
    assert len(masses) == 5
    assert counted.mean == pytest.approx(statistics.fmean(masses), abs=1e-12)
    assert counted.std_dev == pytest.approx(statistics.stdev(masses), abs=1e-12)
    assert counted.giveaway == pytest.approx(statistics.fmean(masses) - 0.15, abs=1e-12)
    assert counted.share_below_tu1 == 0.0
    ends_at = [float(row['t3']) for row in weighed]
    span = max(ends_at) - min(ends_at)
    assert counted.throughput == pytest.approx((len(weighed) - 1) * 60 / span, rel=1e-6)
    assert not math.isnan(counted.throughput)
    (calibration,) = line.entries('calibration')
    assert calibration.new['counts_per_kg'] == 500000.0


# 100 g in 4 g of packaging; 95 g lie between TU2, 91 g, and TU1, 95.5 g.
GOOD, LIGHT = 0.102 + 0.004, 0.095 + 0.004


def judge_by_recipe(line: Line, mass: float) -> Any:
    """Send an item, and return its verdict when the node `reject` has the product."""
    line.wait_for_product('tins')
    return line.judge(mass)


def test_the_rules_and_counts_of_a_batch_go_on_whatever_is_started_again(
    spinner: Spinner, tmp_path: Path
):
    of_batch: dict[str, object] = {
        'product': 'tins', 'batch': 'L1', 'batch_folder': str(tmp_path / 'batches')
    }  # fmt: skip
    line = Line(spinner, tmp_path, needs_product=True, **of_batch)
    feedback: list[Any] = []
    results: list[Any] = []
    line.listen(ports.FILLER_FEEDBACK, feedback.append)
    line.listen(ports.BATCH_RESULT, results.append)

    found = [judge_by_recipe(line, GOOD) for _ in range(38)]
    assert {each.decision for each in found} == {found[0].ACCEPT}
    early = line.judge(LIGHT)
    assert (early.decision, list(early.reasons)) == (early.UNDER, ['TU1Quota'])
    line.judge(GOOD)
    assert line.judge(LIGHT).decision == early.ACCEPT  # one of 40
    wait_for(lambda: len(feedback) == 4)
    # 2 g above the target: half of it, limited to 3 g in all.
    assert [each.correction for each in feedback] == pytest.approx(
        [-0.001, -0.002, -0.003, -0.003], abs=1e-9
    )
    assert [each.limited for each in feedback] == [False, False, False, True]

    line.products.clear()
    line.restart('reject')
    again = judge_by_recipe(line, LIGHT)
    assert (again.decision, list(again.reasons)) == (again.UNDER, ['TU1Quota'])
    assert (again.batch_items, again.batch_accepted, again.batch_below_tu1) == (42, 40, 1)

    line.restart_product(**of_batch)
    again = judge_by_recipe(line, GOOD)
    assert (again.batch, again.batch_items, again.batch_accepted) == ('L1', 43, 41)
    wait_for(lambda: line.statistics[-1].items == 43)

    line.spinner.remove(line.product)
    line.restart('reject')
    line.start_product(**of_batch | {'batch': 'other'})
    again = judge_by_recipe(line, LIGHT)
    assert (again.decision, again.batch, again.batch_items) == (again.UNDER, 'L1', 44)
    wait_for(lambda: line.statistics[-1].items == 44)
    assert (line.statistics[-1].accepted, line.statistics[-1].below_tu1) == (41, 1)

    assert line.call(NewBatch, 'new_batch', batch='L2').success
    first = line.judge(LIGHT)
    assert (first.batch, first.batch_items, list(first.reasons)) == ('L2', 1, ['TU1Quota'])
    wait_for(lambda: bool(results))
    path = Path(results[0].record)
    assert (results[0].batch, path.name) == ('L1', 'L1.jsonl')
    assert results[0].sha256 == hashlib.sha256(path.read_bytes()).hexdigest()
    states = [e.new for e in line.entries('record') if e.subject == 'L1']
    went_on = ['stopped', 'continued']
    assert [each['event'] for each in states] == ['begun', *2 * went_on, 'ended']
    assert (states[-1]['sha256'], states[-1]['size']) == (results[0].sha256, path.stat().st_size)
    kinds = [each['kind'] for each in read_lines(path)]
    assert (kinds[0], kinds[-1], kinds.count('verdict')) == ('begin', 'end', 44)
    assert kinds.count('filler') == len(feedback)
    assert not line.call(NewBatch, 'new_batch', batch='L1').success

    line.spinner.add(BatchReporter())
    wait_for(lambda: bool(line.entries('report')))
    (report,) = line.entries('report')
    html, numbers = path.with_suffix('.html'), path.with_suffix('.json')
    assert report.new == {
        each.name: hashlib.sha256(each.read_bytes()).hexdigest() for each in (html, numbers)
    }
    made = json.loads(numbers.read_text())
    assert made['products'][0]['decisions'] == {'FAULT': 0, 'ACCEPT': 41, 'UNDER': 3, 'OVER': 0}
    assert made['products'][0]['reasons'] == {'TU1Quota': 3}
    assert {each['kind'] for each in made['changes']} >= {'selection', 'batch'}
    assert (made['sha256_in_audit_log'], made['faults']) == ('agrees', [])
    assert results[0].sha256 in html.read_text()


def test_an_item_without_a_product_is_recorded_once_though_the_product_node_restarts(
    spinner: Spinner, tmp_path: Path
):
    folder = tmp_path / 'batches'
    line = Line(spinner, tmp_path, needs_product=True, batch='L1', batch_folder=str(folder))
    for _ in range(2):
        assert line.judge(GOOD).product == ''
    wait_for(lambda: line.statistics[-1].items == 2)

    line.restart_product(batch_folder=str(folder))
    assert line.judge(GOOD).product == ''
    wait_for(lambda: line.statistics[-1].items == 3)

    line.spinner.remove(line.product)
    kinds = [each['kind'] for each in read_lines(folder / 'L1.jsonl')]
    assert kinds.count('verdict') == 3


@pytest.mark.usefixtures('spinner')
def test_a_record_without_recipes_is_refused():
    with pytest.raises(ParameterError, match=r'product\.batch_folder: needs recipes'):
        ProductNode({'batch_folder': '/tmp/batches'})
