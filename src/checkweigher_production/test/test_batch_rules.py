# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The packers' rules over a running batch, against items counted by hand."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st
import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.records import Decision, ProductOnLine, Verdict
from checkweigher_dsp.rejection.batch_rules import BatchRules, BatchTally
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_production.prepackages import judge_batch

# 100 g and 4 g of packaging: TU1 95.5 g, TU2 91 g.
TARE = 0.004
RULES = ProductOnLine(
    1, lower_limit=0.091 + TARE, nominal=0.1 + TARE, tu1=0.0955 + TARE, tu1_quota=0.025,
    mean_value=True, product='crisps', batch='L1',
)  # fmt: skip


def item(contents: float) -> Verdict:
    decision = Decision.ACCEPT if contents >= 0.091 else Decision.UNDER
    return Verdict(1, 1, decision, mass=contents + TARE)


def judge(rules: BatchRules, contents: list[float], known: ProductOnLine = RULES):
    return [rules.judge(item(each), known) for each in contents]


def test_one_of_forty_may_be_below_tu1():
    rules = BatchRules()
    found = judge(rules, [0.102] * 38 + [0.095, 0.102, 0.095, 0.095, 0.09])
    # The 39th would be 1 of 39; then the 38 before and one more: 1 of 40.
    assert [(each.decision, each.reasons) for each in found[38:]] == [
        (Decision.UNDER, ('TU1Quota',)),
        (Decision.ACCEPT, ()),
        (Decision.ACCEPT, ()),
        (Decision.UNDER, ('TU1Quota',)),
        (Decision.UNDER, ()),  # below TU2, by lower_limit
    ]
    last = found[-1]
    assert (last.product, last.batch) == ('crisps', 'L1')
    assert (last.batch_items, last.batch_accepted, last.batch_below_tu1) == (43, 40, 1)
    assert last.batch_surplus == pytest.approx(39 * 0.002 - 0.005, abs=1e-12)


def test_an_item_below_nominal_needs_a_mean_that_bears_it():
    found = judge(BatchRules(), [0.0999, 0.101, 0.0993, 0.0996, 0.1])
    # 1 g over after the second; 0.7 g are borne, 0.4 g more are not; at nominal always.
    assert [each.decision for each in found] == [
        Decision.UNDER, Decision.ACCEPT, Decision.ACCEPT, Decision.UNDER, Decision.ACCEPT,
    ]  # fmt: skip
    assert found[3].reasons == ('MeanValueRequirement',)
    assert found[4].batch_surplus == pytest.approx(0.0003, abs=1e-12)


def test_without_a_recipe_there_is_no_rule_and_the_items_are_counted():
    found = judge(BatchRules(), [0.095] * 3, RejectParameters().limits)
    assert {(each.decision, each.reasons) for each in found} == {(Decision.ACCEPT, ())}
    assert (found[-1].batch_items, found[-1].batch_accepted) == (3, 3)
    assert (found[-1].batch_below_tu1, found[-1].batch_surplus) == (0, 0.0)


@given(st.lists(st.floats(0.09, 0.11), min_size=1, max_size=200), st.integers(0, 200))
def test_the_accepted_items_pass_at_every_moment_whoever_restarts(masses: list[float], at: int):
    rules, accepted, last = BatchRules(), [], BatchTally()
    for number, contents in enumerate(masses):
        if number == at:  # a new process; what it is told of the batch is in the last verdict
            rules = BatchRules()
            rules.remember(last)
        verdict = rules.judge(item(contents), RULES)
        last = BatchTally.of(verdict)
        if verdict.decision is Decision.ACCEPT:
            accepted.append(contents)
            assert judge_batch(accepted, 0.1).passed
    assert (last.items, last.accepted) == (len(masses), len(accepted))


def test_what_several_remember_of_a_batch_is_counted_once():
    rules = BatchRules()
    told = replace(RULES, **BatchTally('', '', 7, 6, 0, 0.01).counts)
    [seventh_and_one] = judge(rules, [0.102], told)
    assert seventh_and_one.batch_items == 8
    rules.remember(BatchTally('crisps', 'L1', 5, 5, 0, 0.0))  # an older memory
    other = replace(RULES, batch='L2')
    assert [each.batch_items for each in judge(rules, [0.102], other)] == [1]
    again = judge(rules, [0.102], told)  # back in the first: its own count is the later one
    assert (again[0].batch_items, again[0].batch_accepted) == (9, 8)


def test_a_mean_without_a_nominal_weight_is_refused():
    with pytest.raises(ParameterError, match=r'reject\.mean_value: true requires'):
        RejectParameters(mean_value=True)
