# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Random lines with faults: each product has one verdict, and no faulty product is accepted."""

import os

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from line_invariants import Tally, parameters, verdicts_in_time, violations, weigh, wrong_masses
import pytest
from spoilt_lines import MS, Jump, Plan, SpoiltLine, make_line, plans

from checkweigher_core.records import Verdict

# All that is random comes from hypothesis, and is the same in every run.
EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
DELAYS = st.lists(
    st.sampled_from([0, 20 * MS, 200 * MS, 480 * MS, 1000 * MS, None]), min_size=1, max_size=4
)


# Lines on which a stage was wrong before: two verdicts for one product, one that was accepted with
# another one unseen on the belt, or with a zero that was read while one stood on it.
DIFFICULT = {
    'clock back, edges before samples': Plan(
        0.5, (0.15, 0.36), slower=(0, 0.8), taken_off=(0, 0.28), chatter=((0, 't4', 2, 1),),
        delayed=((11, 25), (3, 1)), jump=Jump(16, -5013 * MS, -96),
    ),
    'outfeed edge behind that of the infeed': Plan(
        1.0, (0.15, 0.42, 0.31, 2.5), stops=((0, 0.12, 3.0),), slower=(1, 1.4),
        lost=frozenset({(4, 't3')}), chatter=((3, 't1', 3, 1),), doubled=((127, 3),),
        delayed=((21, 90), (44, 2)), lost_events=frozenset({132, 84}),
    ),
    'index jumps, what was on the belt leaves unseen': Plan(
        0.5, (0.25, 0.15, 0.15, 0.25), stops=((2, 0.12, 3.0),),
        lost=frozenset({(2, 't3'), (2, 't4'), (0, 't1')}), jump=Jump(47, 0, 10_000),
    ),
    'one enters unseen, the belt was never seen empty': Plan(
        1.5, (0.25, 0.115), lost=frozenset({(2, 't1')}), delayed=((58, 25), (24, 1), (42, 25)),
    ),
    'one enters unseen, another has left unseen': Plan(
        0.5, (0.25, 0.115), lost=frozenset({(0, 't1'), (2, 't1'), (2, 't2'), (2, 't3')}),
    ),
    'one was on the belt unseen while the zero was read': Plan(
        0.5, (0.42, 0.205, 1.0), taken_off=(1, 0.09), lost=frozenset({(1, 't1'), (1, 't2')}),
        doubled=((107, 1),), delayed=((57, 1),), jump=Jump(32, 487 * MS, 0),
    ),
    'dense': Plan(1.5, (0.25, 0.25, 0.25, 0.25)),
    'stops while the first one enters': Plan(1.0, (0.6, 0.25), stops=((0, 0.05, 1.0),)),
}  # fmt: skip


def check_line(
    plan: Plan, estimator: str, delays: list[int | None], *, length_known: bool
) -> tuple[SpoiltLine, list[Verdict], list[Verdict]]:
    """Check a line. Returns the line, its verdicts, and the verdicts of the reject stage alone."""
    line = make_line(plan)
    known = parameters(estimator, length_known=length_known)
    weighed = weigh(line, known)
    weighings = [weighing for _, weighing in weighed]
    estimates = [weighing.estimate for weighing in weighings]
    verdicts = [weighing.verdict for weighing in weighings]
    in_time = verdicts_in_time(line, known, weighed, delays)
    assert [*violations(line, verdicts, estimates)] == []
    assert [*wrong_masses(line, weighings, estimator)] == []
    # That the clock went back by little the reject stage alone cannot know.
    if plan.jump is None or plan.jump.time >= 0:
        assert [*violations(line, in_time, estimates)] == []
    return line, verdicts, in_time


def check_lines(estimator: str, count: int) -> Tally:
    """Weigh `count` random lines. Returns the counts, also those of the reject stage alone."""
    tally = Tally()

    @settings(max_examples=count, suppress_health_check=list(HealthCheck))
    @given(plans(), st.booleans(), DELAYS)
    def check(plan: Plan, length_known: bool, delays: list[int | None]) -> None:
        tally.add(*check_line(plan, estimator, delays, length_known=length_known))

    check()
    return tally


@pytest.mark.parametrize('length_known', [False, True])
@pytest.mark.parametrize('estimator', ['mean', 'iswd_eksi'])
@pytest.mark.parametrize('name', DIFFICULT)
def test_a_line_that_is_difficult(name: str, estimator: str, length_known: bool):
    check_line(DIFFICULT[name], estimator, [200 * MS, None], length_known=length_known)


@pytest.mark.parametrize(
    ('estimator', 'count'),
    [
        ('mean', 100),
        ('iswd_eksi', 30),
        pytest.param('mean', 18_000, marks=pytest.mark.soak),
        pytest.param('iswd_eksi', 2_000, marks=pytest.mark.soak),
    ],
)
def test_each_product_has_one_verdict_and_only_sound_ones_are_accepted(estimator: str, count: int):
    tally = check_lines(estimator, EXAMPLES or count)

    print(f'\n{estimator}: {tally}')
    assert tally.decisions['ACCEPT'] > tally.products / 5  # not all is spoilt
    assert tally.decisions['FAULT'] > tally.products / 5
