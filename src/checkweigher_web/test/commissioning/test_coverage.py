# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from dataclasses import replace
from pathlib import Path

from lines import simulated, write_line
import pytest

from checkweigher_core.records import Eye, EyeEdge
from checkweigher_validation.verification.plan import EXAMPLE
from checkweigher_web.commissioning.coverage import (
    Recorded,
    lines_of,
    loads_of,
    not_covered,
    passes_in,
)

AT_30 = Recorded(0.5, 0.15, 60, 0.66)


def test_bags_say_which_masses_and_speeds_were_recorded(tmp_path: Path):
    bags = [str(tmp_path / f'passes_{number}') for number in (1, 2, 3)]
    for bag, mass, speed in zip(bags, (0.15, 0.5), (0.5, 1.0), strict=False):
        write_line(Path(bag), simulated(masses=[mass], count=5, speed=speed, spacing=0.8))
    cut = simulated(count=1)
    early = EyeEdge(cut.references[0].stamp - 1, Eye.OUTFEED, True)
    bags.append(str(write_line(tmp_path / 'cut', replace(cut, edges=[early]))))
    first, second = passes_in(bags)  # the third bag does not exist, and the last has no whole pass
    assert first == pytest.approx((0.5, 0.15, 5, 0.8), rel=0.01)
    assert second == pytest.approx((1.0, 0.5, 5, 0.8), rel=0.01)


@pytest.mark.parametrize(
    ('known', 'lacking'),
    [
        ([], [(0.5, 0.0745), (0.5, 0.5), (1.0, 0.0745), (1.0, 0.5)]),
        ([AT_30], [(0.5, 0.5), (1.0, 0.0745), (1.0, 0.5)]),
        ([AT_30, AT_30._replace(speed=1.2)], [(0.5, 0.5), (1.0, 0.5)]),
        ([Recorded(speed, mass, 60, 0.66) for speed in (0.499, 1.01) for mass in (0.1, 0.4)], []),
    ],
)
def test_what_the_plan_weighs_far_from_the_recorded_passes_is_not_covered(
    known: list[Recorded], lacking: list[tuple[float, float]]
):
    loads = loads_of(EXAMPLE)
    assert sorted(set(loads)) == [(v, m) for v in (0.5, 1.0) for m in (0.0745, 0.1945, 0.5)]
    assert list(not_covered(known, loads)) == lacking
    assert loads_of('class: none') == []
    lines = lines_of(lacking)
    assert len(lines) == (len(lacking) + 1 if lacking else 0)
    assert not lines or lines[0].startswith('Asked for by the plan of Verify, but not covered')
