"""The product node over real DDS: recipes, statistics and audit log of a running line."""

from array import array
from collections.abc import Callable, Iterator
import csv
from dataclasses import asdict
import json
import math
from pathlib import Path
import queue
import statistics
from typing import Any

from checkweigher_msgs.msg import StreamStatus
from checkweigher_msgs.srv import NewBatch, ResetStatistics, SelectProduct
import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter
from running import BAGS, run_command
from test_nodes import call, wait_for

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_driver.driver_node import DriverNode
from checkweigher_dsp.audit_log import Entry, read_log
from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import (
    edge_to,
    estimate_to,
    load_cell_to,
    stamp_from,
    zero_change_to,
)
from checkweigher_dsp.nodes.product import ProductNode
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.records import (
    NANOSECONDS,
    Eye,
    EyeEdge,
    LoadCell,
    MassEstimate,
    ZeroChange,
)

RECIPES = """
products:
  crisps:
    nominal: 0.150
    tare: 0.004
    lower_limit: TU1
    upper_limit: 0.165
    parameters: {identifier: {estimator: hann}}
  nuts: {nominal: 0.2, lower_limit: 0.19}
  bars: {nominal: 0.1, length: [0.05, 0.15], speed: [0.5, 1.5]}
  snails: {nominal: 0.1, speed: [0.01, 0.05]}
  half_trained:
    nominal: 0.1
    parameters:
      denoise: {stretch: 2048}
      identifier: {estimator: mean, mean: {gain: [1.0, 1.1]}}
"""
TU1_GROSS = 0.14325 + 0.004
BELT = LoadCell(960.0, 5e5, 1.25e6, -(2**23), 2**23 - 1, 7.2, 0.2)


class Line:
    """Stages and product node on one executor, and an operator beside them."""

    def __init__(
        self,
        spinner: Spinner,
        folder: Path,
        without: str = '',
        needs_product: bool = False,
        **parameters: object,
    ) -> None:
        self.spinner = spinner
        self.recipes = folder / 'recipes.yaml'
        self.recipes.write_text(RECIPES, encoding='utf-8')
        self.log = folder / 'audit.log'
        # Without deadlines, for a bag comes faster than its time.
        self.for_reject = {'deadlines': False, 'needs_product': needs_product}
        self.stages = {name: self.make(name) for name in STAGE_NODES if name != without}
        self.product = ProductNode(
            {'recipes': str(self.recipes), 'audit_log': str(self.log), **parameters}
        )
        self.operator = Node('operator')
        self.verdicts: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self.statistics: list[Any] = []
        self.publishers: dict[str, Any] = {}
        self.judged = 0
        self.listen(topics.VERDICT, self.verdicts.put)
        self.listen(topics.STATISTICS, self.statistics.append)
        for node in (*self.stages.values(), self.product, self.operator):
            spinner.add(node)

    def make(self, name: str) -> Any:
        return STAGE_NODES[name](self.for_reject if name == 'reject' else None)

    def start_anew(self, name: str) -> None:
        """Destroy a stage and put another one in its place."""
        self.spinner.remove(self.stages[name])
        # Two nodes of one name in one process and the graph loses the name of the second.
        wait_for(lambda: name not in self.operator.get_node_names())
        self.stages[name] = self.make(name)
        self.spinner.add(self.stages[name])
        self.publishers.clear()

    def listen(self, topic: topics.Topic, callback: Callable[[Any], None]) -> None:
        self.operator.create_subscription(topic.type, topic.name, callback, topic.qos)

    def call(self, kind: Any, name: str, **request: object) -> Any:
        return call(self.operator, kind, name, **request)

    def select(self, product: str) -> Any:
        return self.call(SelectProduct, 'select_product', product=product)

    def judge(self, mass: float, length: float = 0.1, reasons: tuple[str, ...] = ()) -> Any:
        """Have an item of a mass pass the eyes and be judged, and return its verdict."""
        self.judged += 1
        begin = (1_700_000_000 + 5 * self.judged) * NANOSECONDS
        t1, t2, t3, t4 = (begin + tenths * NANOSECONDS // 10 for tenths in range(4))
        self.publish(topics.LOAD_CELL_INFO, load_cell_to(BELT, begin))
        for stamp, eye, blocked in (
            (t1, Eye.INFEED, True), (t2, Eye.INFEED, False),
            (t3, Eye.OUTFEED, True), (t4, Eye.OUTFEED, False),
        ):  # fmt: skip
            self.publish(topics.PHOTO_EYES, edge_to(EyeEdge(stamp, eye, blocked)))
        estimate = MassEstimate(
            self.judged,
            t1,
            t2,
            t3,
            mass=mass,
            std_dev=1e-4,
            belt_speed=1.0,
            line_speed=1.0,
            product_length=length,
            reasons=reasons,
        )
        self.publish(topics.MASS_ESTIMATE, estimate_to(estimate))
        while True:
            verdict = self.verdicts.get(timeout=20.0)
            # The segmenter, which gets no samples, has its say of old items to a new reject node.
            if stamp_from(verdict.t1) == t1:
                return verdict

    def publish(self, topic: topics.Topic, message: Any) -> None:
        if topic.name not in self.publishers:
            publisher = self.operator.create_publisher(topic.type, topic.name, topic.qos)
            wait_for(lambda: publisher.get_subscription_count() >= 2)
            self.publishers[topic.name] = publisher
        self.publishers[topic.name].publish(message)

    def parameters(self) -> dict[str, dict[str, object]]:
        return {
            name: {
                n: list(p.value) if isinstance(p.value, (array, tuple)) else p.value
                for n, p in node.get_parameters_by_prefix('').items()
            }
            for name, node in self.stages.items()
        }

    def entries(self, *kinds: str) -> list[Entry]:
        found = read_log(self.log)
        assert found.whole
        return [entry for entry in found.entries if entry.kind in kinds]


@pytest.fixture
def spinner() -> Iterator[Spinner]:
    with spinning('lane1') as running:
        yield running


def test_a_selected_product_has_its_limits_from_the_next_item_on(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    assert line.judge(0.147).decision == 1  # ACCEPT: there is no limit yet
    answer = line.select('crisps')
    assert (answer.success, answer.message) == (True, '')
    verdict = line.judge(0.147)
    assert verdict.decision == verdict.UNDER
    assert verdict.lower_limit == pytest.approx(TU1_GROSS, rel=1e-12)
    assert line.judge(0.148).decision == verdict.ACCEPT
    wait_for(lambda: bool(line.statistics) and line.statistics[-1].items == 2)
    counted = line.statistics[-1]
    assert (counted.product, counted.accepted, counted.under) == ('crisps', 1, 1)
    assert counted.giveaway == pytest.approx(0.148 - 0.154, rel=1e-9)


def test_a_product_of_a_wrong_length_is_a_fault_and_is_counted(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    assert line.select('bars').success
    assert line.judge(0.1).decision == 1  # ACCEPT
    verdict = line.judge(0.1, length=0.16)
    assert (verdict.decision, list(verdict.reasons)) == (verdict.FAULT, ['ProductTooLong'])
    wait_for(lambda: bool(line.statistics) and line.statistics[-1].items == 2)
    counted = line.statistics[-1]
    assert (list(counted.reasons), list(counted.reason_counts)) == (['ProductTooLong'], [1])
    assert line.select('nuts').success
    assert line.judge(0.2, length=0.16).decision == verdict.ACCEPT


def test_a_speed_at_which_the_line_weighs_nothing_is_refused(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    before = line.parameters()
    answer = line.select('snails')
    assert not answer.success
    assert answer.message.startswith('reject: reject.max_speed: 0.05 is below min_belt_speed 0.1')
    assert line.parameters() == before


def test_a_product_gets_back_what_another_one_had_set(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    before = line.parameters()
    assert line.select('crisps').success
    assert line.parameters()['identifier']['estimator'] == 'hann'
    assert line.select('nuts').success
    after = line.parameters()
    assert after.pop('reject')['lower_limit'] == 0.19
    before.pop('reject')
    assert after == before


def test_a_recipe_that_one_node_refuses_changes_nothing_anywhere(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    assert line.select('nuts').success
    before = line.parameters()
    # denoise, asked first, takes its part; identifier wants one gain for each speed.
    answer = line.select('half_trained')
    assert not answer.success
    assert answer.message.startswith('identifier: ')
    assert 'mean.gain: 2 values for 1 speeds' in answer.message
    assert line.parameters() == before
    assert line.judge(0.18).decision == 2  # UNDER: nuts are still on the line
    assert line.statistics[-1].product == 'nuts'
    denoise = [e for e in line.entries('parameter') if e.subject == '/lane1/denoise.stretch']
    assert [(e.old, e.new) for e in denoise][-1:] == [(2048, 1024)]
    (refused,) = line.entries('refused')
    assert refused.old == 'half_trained'


@pytest.mark.parametrize(
    ('change', 'product', 'complaint'),
    [
        (('nuts:', 'walnuts:'), 'nuts', "has no product 'nuts'; it has crisps, walnuts, bars, "),
        (('nominal: 0.2', 'nominal: heavy'), 'crisps', "nuts.nominal: 'heavy' is not a number"),
    ],
)
def test_a_bad_recipe_file_changes_nothing(
    spinner: Spinner, tmp_path: Path, change: tuple[str, str], product: str, complaint: str
):
    line = Line(spinner, tmp_path)
    line.recipes.write_text(RECIPES.replace(*change), encoding='utf-8')
    before = line.parameters()
    answer = line.select(product)
    assert not answer.success
    assert complaint in answer.message
    assert line.parameters() == before


def test_a_product_is_not_selected_while_a_node_is_missing(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, without='identifier')
    assert line.select('nuts').success  # which has nothing for it
    before = line.parameters()
    answer = line.select('crisps')
    assert (answer.success, answer.message) == (False, 'identifier: is not there')
    assert line.parameters() == before


def test_the_product_of_the_parameters_is_there_from_the_start(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, product='nuts', batch='monday')
    wait_for(lambda: bool(line.statistics))
    assert (line.statistics[-1].product, line.statistics[-1].batch) == ('nuts', 'monday')
    assert line.parameters()['reject']['lower_limit'] == 0.19
    wait_for(lambda: len(line.entries('parameter')) == 2)
    assert {(e.subject, e.old, e.new) for e in line.entries('parameter')} == {
        ('/lane1/reject.lower_limit', '-inf', 0.19),
        ('/lane1/reject.product', '', 'nuts'),
    }


def test_a_reject_node_that_is_started_anew_accepts_nothing_before_it_has_the_limits(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path, needs_product=True)
    wait_for(lambda: len(line.entries('found')) == len(STAGE_NODES) + 1)
    verdict = line.judge(0.2)
    assert (verdict.decision, list(verdict.reasons)) == (verdict.FAULT, ['NoProduct'])
    assert line.select('nuts').success
    assert line.judge(0.2).decision == verdict.ACCEPT

    line.start_anew('reject')

    verdict = line.judge(0.18)  # with its limits already or without them yet
    assert verdict.decision in (verdict.FAULT, verdict.UNDER)
    wait_for(lambda: bool(line.entries('restored')))
    assert line.judge(0.18).decision == verdict.UNDER
    assert line.judge(0.2).decision == verdict.ACCEPT
    (restored,) = line.entries('restored')
    assert (restored.subject, restored.new) == ('reject', 'nuts')
    found = [entry.subject for entry in line.entries('found')]
    # What it was started with stands in the log, then that it was set.
    assert found.count('/lane1/reject') == 2
    limits = [e for e in line.entries('parameter') if e.subject == '/lane1/reject.lower_limit']
    assert [(e.old, e.new) for e in limits] == [('-inf', 0.19), ('-inf', 0.19)]


def test_an_identifier_that_is_started_anew_has_the_estimator_of_the_product(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path)
    assert line.select('crisps').success

    line.start_anew('identifier')

    wait_for(lambda: line.parameters()['identifier']['estimator'] == 'hann')
    wait_for(lambda: line.parameters()['reject']['product'] == 'crisps')


def test_a_product_node_that_is_started_anew_keeps_what_is_on_the_line(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path)
    assert line.select('nuts').success
    spinner.remove(line.product)
    wait_for(lambda: 'product' not in line.operator.get_node_names())

    line.product = ProductNode(
        {'recipes': str(line.recipes), 'audit_log': str(line.log), 'product': 'crisps'}
    )
    spinner.add(line.product)

    wait_for(lambda: len(line.entries('selection')) == 2)
    assert line.judge(0.18).decision == 2  # UNDER, for nuts
    assert [entry.new for entry in line.entries('selection')] == ['nuts', 'nuts']


def test_what_becomes_of_the_zero_is_in_the_log(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path)
    change = ZeroChange(1_700_000_000 * NANOSECONDS, 0.001, 0.0002, 1e-5)
    publisher = line.operator.create_publisher(
        topics.ZERO_SETTING.type, topics.ZERO_SETTING.name, topics.ZERO_SETTING.qos
    )
    for _ in range(2):  # what is latched comes again
        publisher.publish(zero_change_to(change))
    out = ('ZeroOutOfRange',)
    for reasons in ((), out, out, ('MissingEdge',), ()):
        line.judge(math.nan if reasons else 0.1, reasons=reasons)
    wait_for(lambda: len(line.entries('zero')) == 3)

    setting, *range_ = sorted(line.entries('zero'), key=lambda entry: entry.subject, reverse=True)

    assert (setting.subject, setting.old, setting.new) == ('zero_setting', None, asdict(change))
    assert [(e.subject, e.old, e.new) for e in range_] == [
        ('ZeroOutOfRange', False, True),
        ('ZeroOutOfRange', True, False),
    ]


def test_a_start_with_a_bad_recipe_is_refused(spinner: Spinner, tmp_path: Path):
    path = tmp_path / 'recipes.yaml'
    path.write_text('products: {crisps: {nominal: -1}}', encoding='utf-8')
    with pytest.raises(ParameterError, match=r'recipes\.yaml: crisps\.nominal: -1'):
        ProductNode({'recipes': str(path), 'product': 'crisps'})


def test_a_log_that_was_tampered_with_is_not_continued(spinner: Spinner, tmp_path: Path):
    path = tmp_path / 'audit.log'
    path.write_text('{"sequence":7}\n', encoding='utf-8')
    with pytest.raises(ParameterError, match=r'audit\.log: line 1: changed'):
        ProductNode({'audit_log': str(path)})


def test_a_change_of_a_parameter_is_in_the_log_with_its_old_and_its_new_value(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path)
    wait_for(lambda: len(line.entries('found')) == len(STAGE_NODES) + 1)
    values = [Parameter('lower_limit', value=0.13), Parameter('lower_limit', value=0.14)]
    for value in values:
        line.call(SetParameters, 'reject/set_parameters', parameters=[value.to_parameter_msg()])
    wait_for(lambda: len(line.entries('parameter')) == 2)
    changes = [(e.source, e.subject, e.old, e.new) for e in line.entries('parameter')]
    assert changes == [
        ('/lane1/product', '/lane1/reject.lower_limit', '-inf', 0.13),
        ('/lane1/product', '/lane1/reject.lower_limit', 0.13, 0.14),
    ]
    done = run_command('audit', line.log)
    assert done.returncode == 0
    assert '/lane1/reject.lower_limit: 0.13 -> 0.14' in done.stdout
    # What was changed in the file is told with its line.
    count = len(read_log(line.log).entries)
    line.log.write_bytes(line.log.read_bytes().replace(b'"new":0.14', b'"new":0.13'))
    done = run_command('audit', line.log, '--json')
    assert done.returncode == 1
    told = json.loads(done.stdout)
    assert (told['problem'], told['bad_line']) == ('changed', count)
    assert run_command('audit', tmp_path / 'nothing').returncode == 2


def test_a_batch_and_a_reset_end_a_count_and_are_in_the_log(spinner: Spinner, tmp_path: Path):
    line = Line(spinner, tmp_path, batch='monday')
    line.judge(0.1)
    assert not line.call(NewBatch, 'new_batch', batch='monday').success
    assert not line.call(NewBatch, 'new_batch', batch=' ').success
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


def test_the_statistics_of_a_bag_are_those_of_its_csv(spinner: Spinner, tmp_path: Path):
    bag, path, parameters = BAGS / 'paper_90', tmp_path / 'masses.csv', tmp_path / 'limits.yaml'
    parameters.write_text(
        '/**/reject:\n  ros__parameters: {lower_limit: 0.14725, upper_limit: 0.169}\n'
        '/**/identifier:\n  ros__parameters: {estimator: hann}\n'
    )
    run_command('weigh', bag, '--params', parameters, '--csv', path)
    with path.open(newline='') as file:
        rows = list(csv.DictReader(file))
    line = Line(spinner, tmp_path)
    assert line.select('crisps').success
    ends: queue.SimpleQueue[int] = queue.SimpleQueue()
    line.listen(topics.SEGMENTER_STATUS, lambda m: ends.put(m.state))
    spinner.add(DriverNode({'source': 'bag', 'bag.path': str(bag), 'rate': 0.0}))
    while ends.get(timeout=20.0) != StreamStatus.FINISHED:
        pass
    wait_for(lambda: line.statistics[-1].items == len(rows))
    counted = line.statistics[-1]
    decisions = [row['decision'] for row in rows]
    assert [counted.accepted, counted.under, counted.over, counted.faults] == [
        decisions.count(name) for name in ('ACCEPT', 'UNDER', 'OVER', 'FAULT')
    ]
    masses = [float(r['mass_g']) / 1000 - 0.004 for r in rows if r['decision'] == 'ACCEPT']
    assert len(masses) == 5
    assert counted.mean == pytest.approx(statistics.fmean(masses), abs=1e-12)
    assert counted.std_dev == pytest.approx(statistics.stdev(masses), abs=1e-12)
    assert counted.giveaway == pytest.approx(statistics.fmean(masses) - 0.15, abs=1e-12)
    assert counted.share_below_tu1 == 0.0
    ends_at = [float(row['t3']) for row in rows]
    span = max(ends_at) - min(ends_at)
    assert counted.throughput == pytest.approx((len(rows) - 1) * 60 / span, rel=1e-6)
    assert not math.isnan(counted.throughput)
    (calibration,) = line.entries('calibration')
    assert calibration.new['counts_per_kg'] == 500000.0
