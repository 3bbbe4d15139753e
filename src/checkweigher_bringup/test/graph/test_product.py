# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The product node over real DDS: recipes of a running line."""

from collections.abc import Iterator
import math
from pathlib import Path

from graph import wait_for
from product_line import RECIPES, TU1_GROSS, Line
import pytest

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import Spinner, spinning
from checkweigher_dsp.nodes.product import ProductNode


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
    # Each item came after a load_cell/info, with which a stream begins.
    assert math.isnan(counted.throughput)


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
        (('nuts:', 'walnuts:'), 'nuts', "has no product 'nuts'; it has crisps, walnuts, tins"),
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
    wait_for(lambda: len(line.entries('parameter')) == 4)
    assert {(e.subject, e.old, e.new) for e in line.entries('parameter')} == {
        ('/lane1/reject.lower_limit', '-inf', 0.19),
        ('/lane1/reject.nominal', 0.0, 0.2),
        ('/lane1/reject.product', '', 'nuts'),
        ('/lane1/reject.batch', '', 'monday'),
    }


def test_a_reject_node_that_is_started_again_accepts_nothing_before_it_has_the_limits(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path, needs_product=True)
    wait_for(lambda: len(line.entries('found')) == len(STAGE_NODES) + 1)
    verdict = line.judge(0.2)
    assert (verdict.decision, list(verdict.reasons)) == (verdict.FAULT, ['NoProduct'])
    assert line.select('nuts').success
    assert line.judge(0.2).decision == verdict.ACCEPT

    line.restart('reject')

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


def test_an_identifier_that_is_started_again_has_the_estimator_of_the_product(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path)
    assert line.select('crisps').success

    line.restart('identifier')

    wait_for(lambda: line.parameters()['identifier']['estimator'] == 'hann')
    wait_for(lambda: line.parameters()['reject']['product'] == 'crisps')


def test_a_product_node_that_is_started_again_keeps_what_is_on_the_line(
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
