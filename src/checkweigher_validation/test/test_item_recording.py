# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Short recordings of one item, in which the item has the result of the long recording."""

from dataclasses import replace

from lines import edges_of, saturated_at, simulated, without_edges
import pytest

from checkweigher_core.recording import Recording
from checkweigher_core.records import Decision
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.results import ItemResult, weigh
from checkweigher_validation.item_recording import KeepError, keep_item

DEFAULTS = LineParameters()


@pytest.fixture(scope='module')
def line() -> Recording:
    """Return a line on which items 21 and 26 are faults."""
    sound = simulated(count=30, seed=7)
    broken = saturated_at(sound, edges_of(sound, 20)['t2'].stamp + 50_000_000)
    return without_edges(broken, edges_of(sound, 25)['t2'])


@pytest.fixture(scope='module')
def results(line: Recording) -> list[ItemResult]:
    return weigh(line, DEFAULTS)


@pytest.mark.parametrize('number', [1, 2, 15, 21, 26, 30])
def test_an_item_has_the_same_verdict_in_a_small_recording(
    line: Recording, results: list[ItemResult], number: int
):
    item = results[number - 1]
    assert (item.verdict.decision == Decision.FAULT) == (number in (21, 26))
    part, kept = keep_item(line, DEFAULTS, item.estimate, item.verdict)
    assert len(part.blocks.counts) < 0.75 * len(line.blocks) * len(line.blocks[0].counts)
    found = {(each.estimate.t1, each.estimate.t3): each for each in weigh(part, DEFAULTS)}
    again = found[item.estimate.t1, item.estimate.t3]
    assert again.estimate == kept.estimate
    assert again.verdict.decision == item.verdict.decision
    assert again.verdict.reasons == item.verdict.reasons
    if not item.verdict.reasons:
        accuracy = 0.1 * item.estimate.std_dev
        assert again.estimate.mass == pytest.approx(item.estimate.mass, abs=accuracy)
        assert again.reference == item.reference


def test_an_item_of_other_parameters_is_refused(line: Recording, results: list[ItemResult]):
    item = results[14]
    other = replace(item.verdict, decision=Decision.OVER)
    with pytest.raises(KeepError, match='item 15 has another result'):
        keep_item(line, DEFAULTS, item.estimate, other)
