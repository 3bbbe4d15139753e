# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node `product` over real DDS: recipes of a running line."""

import math
from pathlib import Path
import subprocess
from typing import Any

from checkweigher_msgs.srv import NewBatch
from full_disk import file_size_limit
from graph import wait_for
from product_line import RECIPES, TU1_GROSS, Line
import pytest
from rcl_interfaces.msg import SetParametersResult

from checkweigher_bringup.spinning import Spinner, node_command, write_parameter_file
from checkweigher_core.health.findings import Level
from checkweigher_core.ros import ports


def test_a_selected_product_has_its_limits_from_the_next_item_on(line: Line):
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


def test_a_product_of_a_wrong_length_is_a_fault_and_is_counted(line: Line):
    assert line.select('bars').success
    assert line.judge(0.1).decision == 1  # ACCEPT
    verdict = line.judge(0.1, length=0.16)
    assert (verdict.decision, list(verdict.reasons)) == (verdict.FAULT, ['ProductTooLong'])
    wait_for(lambda: bool(line.statistics) and line.statistics[-1].items == 2)
    counted = line.statistics[-1]
    assert (list(counted.reasons), list(counted.reason_counts)) == (['ProductTooLong'], [1])
    assert line.select('nuts').success
    assert line.judge(0.2, length=0.16).decision == verdict.ACCEPT


def test_a_product_gets_back_what_another_one_had_set(line: Line):
    before = line.parameters()
    answer = line.select('snails')
    assert not answer.success
    assert answer.message.startswith('snails.speed: 0.05 m/s is below min_belt_speed of segmenter')
    assert line.parameters() == before
    assert line.select('crisps').success
    assert line.parameters()['identifier']['estimator'] == 'hann'
    assert line.select('nuts').success
    assert line.parameters() == before


def test_a_recipe_that_one_node_refuses_changes_nothing_anywhere(line: Line):
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


def test_a_selection_that_the_log_has_no_room_for_leaves_the_product_before(line: Line):
    assert line.select('nuts').success
    line.judge(0.2)
    before, room, noted = line.parameters(), 0, 0
    while noted < 2:  # until the entry of the selection fits, and no entry of its parameters
        room += 100
        with file_size_limit(line.log.stat().st_size + room):
            answer = line.select('crisps')
        assert not answer.success, room
        assert 'No space left' in answer.message
        noted = len(line.entries('selection'))
    assert line.parameters() == before
    assert line.judge(0.18).decision == 2  # UNDER: nuts are still on the line
    assert line.statistics[-1].product == 'nuts'


def test_a_line_that_could_not_go_back_accepts_nothing(line: Line):
    assert line.select('nuts').success
    denoise, changes = line.stages['denoise'], []

    def once(parameters: list[Any]) -> SetParametersResult:
        changes.extend(parameters)
        return SetParametersResult(successful=len(changes) == 1, reason='no more')

    denoise.add_on_set_parameters_callback(once)
    answer = line.select('half_trained')
    assert answer.message.endswith('the previous values could not be restored: denoise: no more')
    assert list(line.judge(0.2).reasons) == ['NoProduct']
    denoise.remove_on_set_parameters_callback(once)
    assert line.select('nuts').success
    assert line.parameters()['denoise']['stretch'] == 1024
    assert line.judge(0.2).decision == 1  # ACCEPT


def test_a_limit_that_is_set_holds_until_another_product_is_selected(line: Line):
    assert line.select('nuts').success
    assert 'reject.lower_limit: 0.19 is above upper' in line.set_limit('upper_limit', 0.15).reason
    assert line.set_limit('lower_limit', 0.17).successful
    assert [line.judge(0.18).decision for _ in range(3)] == [1, 1, 1]  # ACCEPT
    assert line.call(NewBatch, 'new_batch', batch='L2').success
    verdict = line.judge(0.18)
    assert (verdict.decision, verdict.batch, verdict.lower_limit) == (1, 'L2', 0.17)
    assert line.select('nuts').success
    assert line.judge(0.18).decision == 2  # UNDER
    assert line.entries('selection')[-1].old['lower_limit'] == 0.17
    # The parameter has this value still, while the limit is that of the product.
    assert line.set_limit('lower_limit', 0.17).successful
    assert line.judge(0.18).decision == 1
    changes = [(entry.subject, entry.old, entry.new) for entry in line.entries('parameter')]
    assert changes == 2 * [('/lane1/reject.lower_limit', 0.19, 0.17)]
    finding = line.product._selection.finding()
    text = 'limits on the line, 170 g and none, are not those of the recipe, 190 g and'
    assert (finding.level, text in finding.text) == (Level.WARN, True)
    assert line.set_limit('lower_limit', -math.inf).successful
    line.judge(0.18)
    assert line.product._selection.finding().level == Level.ERROR  # nothing is rejected any more


def test_a_bad_recipe_file_changes_nothing(line: Line):
    before = line.parameters()
    for change, product, complaint in (
        (('nuts:', 'walnuts:'), 'nuts', "has no product 'nuts'; it has crisps, walnuts, tins"),
        (('nominal: 0.2', 'nominal: heavy'), 'crisps', "nuts.nominal: 'heavy' is not a number"),
    ):
        line.recipes.write_text(RECIPES.replace(*change), encoding='utf-8')
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
    line.wait_for_product('nuts')
    assert (line.products[-1].batch, line.products[-1].lower_limit) == ('monday', 0.19)
    (selection,) = line.entries('selection')
    changed = {name: (selection.old[name], new) for name, new in selection.new.items()}
    assert {name: each for name, each in changed.items() if each[0] != each[1]} == {
        'product': ('', 'nuts'),
        'batch': ('', 'monday'),
        'lower_limit': ('-inf', 0.19),
        'nominal': (0.0, 0.2),
    }
    assert not line.entries('parameter')


def test_a_reject_node_that_is_started_again_has_the_limits_before_its_first_verdict(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path, needs_product=True)
    line.wait_until_found()
    verdict = line.judge(0.2)
    assert (verdict.decision, list(verdict.reasons)) == (verdict.FAULT, ['NoProduct'])
    assert line.select('nuts').success
    assert line.judge(0.2).decision == verdict.ACCEPT
    wait_for(lambda: line.statistics[-1].items == 1)

    line.restart('reject')

    line.wait_for_product('nuts')
    verdict = line.judge(0.18)
    assert (verdict.decision, verdict.product, verdict.batch_items) == (verdict.UNDER, 'nuts', 2)
    assert line.judge(0.2).decision == verdict.ACCEPT
    assert not line.entries('restored')
    # What it was started with stands in the log; the limits stand there since the selection.
    assert len(line.entries('selection')) == 1


def test_a_reject_process_that_is_killed_goes_on_with_limits_and_counts(
    spinner: Spinner, tmp_path: Path
):
    line = Line(spinner, tmp_path, without='reject')
    own = tmp_path / 'reject.yaml'
    write_parameter_file(own, {'reject': line.for_reject})
    command = node_command(ports.NODES['reject'], 'lane1', own)
    for number in (1, 2):
        with subprocess.Popen(command) as reject:
            if number == 1:
                wait_for(lambda: bool(line.select('nuts').success))
            line.wait_for_product('nuts')
            verdict = line.judge(0.18)
            assert (verdict.decision, verdict.batch_items) == (verdict.UNDER, number)
            wait_for(lambda number=number: line.statistics[-1].items == number)
            reject.kill()
        if number == 1:  # until DDS has given it up
            wait_for(lambda: 'reject' not in line.operator.get_node_names())
            line.publishers.clear()
            line.products.clear()


def test_an_identifier_that_is_started_again_has_the_estimator_of_the_product(line: Line):
    assert line.select('crisps').success

    line.restart('identifier')

    wait_for(lambda: line.parameters()['identifier']['estimator'] == 'hann')
    line.wait_for_product('crisps')
    assert [each.product for each in line.products[-3:]] == ['crisps', '', 'crisps']
    wait_for(lambda: bool(line.entries('restored')))
    (restored,) = line.entries('restored')
    assert (restored.subject, restored.new) == ('identifier', 'crisps')


def test_a_product_node_that_is_started_again_keeps_what_is_on_the_line(line: Line):
    assert line.select('nuts').success

    line.restart_product(product='crisps')

    wait_for(lambda: len(line.entries('selection')) == 2)
    assert line.judge(0.18).decision == 2  # UNDER, for nuts
    assert [entry.new['product'] for entry in line.entries('selection')] == ['nuts', 'nuts']
    assert line.entries('selection')[1].old == line.entries('selection')[1].new
