"""Random lines, spoilt in every way: one verdict for each product, no unsound one accepted."""

import os

from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from line_invariants import Tally, parameters, verdicts_in_time, violations, weigh, wrong_masses
import pytest
from spoilt_lines import MS, Plan, make_line, plans

# All that is random comes from hypothesis, and is the same in every run.
EXAMPLES = int(os.environ.get('CHECKWEIGHER_EXAMPLES', '0'))
DELAYS = st.lists(
    st.sampled_from([0, 20 * MS, 200 * MS, 480 * MS, 1000 * MS, None]), min_size=1, max_size=4
)


def check_lines(estimator: str, count: int) -> Tally:
    """Weigh `count` random lines; return what came of them, and of the reject stage on a clock."""
    tally = Tally()

    @settings(
        max_examples=count, deadline=None, database=None, derandomize=True,
        suppress_health_check=list(HealthCheck),
    )  # fmt: skip
    @given(plans(), st.booleans(), DELAYS)
    def check(plan: Plan, length_known: bool, delays: list[int | None]) -> None:
        line = make_line(plan)
        weighed = weigh(line, parameters(estimator, length_known=length_known))
        weighings = [weighing for _, weighing in weighed]
        estimates = [weighing.estimate for weighing in weighings]
        verdicts = [weighing.verdict for weighing in weighings]
        in_time = verdicts_in_time(line, weighed, delays)
        tally.add(line, verdicts, in_time)
        assert [*violations(line, verdicts, estimates)] == []
        assert [*wrong_masses(line, weighings, estimator)] == []
        # That the clock went back by little the reject stage alone cannot know.
        if plan.jump is None or plan.jump.time >= 0:
            assert [*violations(line, in_time, estimates)] == []

    check()
    return tally


@pytest.mark.parametrize(('estimator', 'count'), [('mean', 250), ('iswd_eksi', 50)])
def test_each_product_has_one_verdict_and_only_sound_ones_are_accepted(estimator: str, count: int):
    tally = check_lines(estimator, EXAMPLES or count)

    assert tally.decisions['ACCEPT'] > tally.products / 5  # not all is spoilt
    assert tally.decisions['FAULT'] > tally.products / 5


@pytest.mark.soak
@pytest.mark.parametrize(('estimator', 'count'), [('mean', 18_000), ('iswd_eksi', 2_000)])
def test_many_lines(estimator: str, count: int):
    print(f'\n{estimator}: {check_lines(estimator, EXAMPLES or count)}')
