# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Batches over real DDS: rules and counts go on where reject, product or both are started again."""

import hashlib
import json
from pathlib import Path
from typing import Any

from checkweigher_msgs.srv import NewBatch
from graph import wait_for
from product_line import Line
import pytest

from checkweigher_bringup.batch_reporter import BatchReporter
from checkweigher_bringup.spinning import Spinner
from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros import ports
from checkweigher_production.batch_record import read_lines
from checkweigher_production.nodes.product import ProductNode

# 100 g in 4 g of packaging; 95 g lie between TU2, 91 g, and TU1, 95.5 g.
GOOD, LIGHT = 0.102 + 0.004, 0.095 + 0.004


def judge_by_recipe(line: Line, mass: float) -> Any:
    """Have an item judged once the reject node has its product."""
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
    assert [(e.subject, e.new) for e in line.entries('record')] == [('L1', results[0].sha256)]
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
    assert made['sha256_in_audit_log'] == 'agrees'
    assert results[0].sha256 in html.read_text()


@pytest.mark.usefixtures('spinner')
def test_a_record_without_recipes_is_refused():
    with pytest.raises(ParameterError, match=r'product\.batch_folder: needs recipes'):
        ProductNode({'batch_folder': '/tmp/batches'})
