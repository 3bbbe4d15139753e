# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Marks in the signal of a fault, on simulated lines with one fault each."""

from collections.abc import Callable
from dataclasses import replace
import operator

from lines import edges_of, saturated_at, simulated, without_block_at, without_edges
import numpy as np
import pytest
from shown_lanes import lane_of

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS, Decision, Eye, EyeEdge, SampleBlock, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_web.lane import Lane, ShownItem
from checkweigher_web.views.fault_marks import Mark, Scene, fault_marks
from checkweigher_web.views.signal import signal_chart

DEFAULTS = LineParameters()
MS = NANOSECONDS // 1000
BROKEN = 6  # index of the item with a fault
# The belt speed is 60 m/min, the eyes are 0.2 m apart, and the products 0.1 m long.
TRANSIT, LENGTH = 200 * MS, 100 * MS


@pytest.fixture(scope='module')
def line() -> Recording:
    return simulated(count=9, seed=3, masses=(0.1345,))


def broken_item(lane: Lane, reason: Reason) -> ShownItem:
    found = [item for item in lane.items() if reason in item.verdict.reasons]
    assert found, [item.verdict.reasons for item in lane.items()]
    return lane.with_signals(found[-1])


def marks_of(
    recording: Recording, reason: Reason, parameters: LineParameters = DEFAULTS
) -> list[Mark]:
    """Return the marks of the first item with a reason, and check their numbers in the figure."""
    lane = lane_of(recording, parameters)
    item = broken_item(lane, reason)
    marks = fault_marks(Scene(item, item.stretch, recording.load_cell))
    raw = signal_chart(item, recording.load_cell)[0]['series'][0]
    names = [begin['name'] for begin, _ in raw['markArea']['data']]
    names += [mark['name'] for mark in raw['markLine']['data']]
    assert sorted(names) == [str(k) for k in range(1, len(marks) + 1)]
    return marks


def changed(line: Recording, change: Callable[[int, np.ndarray], np.ndarray]) -> Recording:
    """Return the line with new counts from `change`, which gets the stamp and counts of a block."""
    blocks = [
        SampleBlock(b.stamp, b.first_index, np.asarray(change(b.stamp, b.counts), np.int32))
        for b in line.blocks
    ]
    return replace(line, blocks=tuple(blocks))


def with_edges(line: Recording, *edges: EyeEdge) -> Recording:
    return replace(line, edges=tuple(sorted((*line.edges, *edges), key=lambda e: e.stamp)))


LOST = [('t1', Eye.INFEED, 0), ('t2', Eye.INFEED, LENGTH), ('t3', Eye.OUTFEED, TRANSIT)]


@pytest.mark.parametrize(('lost', 'eye', 'after_t1'), LOST)
def test_a_missing_edge_is_marked_where_it_was_expected_and_its_eye_was_blocked_from_there(
    line: Recording, lost: str, eye: Eye, after_t1: int
):
    edges, broken = edges_of(line, BROKEN), without_edges(line, edges_of(line, BROKEN)[lost])
    (mark,) = [each for each in marks_of(broken, Reason.MISSING_EDGE) if lost in each.text]
    assert mark.edge == lost
    assert mark.begin == mark.end == pytest.approx(edges['t1'].stamp + after_t1, abs=5 * MS)
    assert f'{eye.name.lower()} eye' in mark.text
    item = broken_item(lane_of(broken), Reason.MISSING_EDGE)
    figure = signal_chart(item, line.load_cell)[0]
    series = {each['name']: each for each in figure['series']}
    first = 't2' if lost == 't1' else 't1'
    assert figure['xAxis'][1]['name'] == f'ms after {first}'
    origin = edges[first].stamp
    name = f'{eye.name.lower()} eye blocked, as expected'
    ends = [at for at, _ in series[name]['data'] if at is not None]
    names = ('t3', 't4') if eye == Eye.OUTFEED else ('t1', 't2')
    expected = [(edges[each].stamp - origin) / MS for each in names]
    assert ends == pytest.approx(expected, abs=5)
    # The other bars are those of adjacent items, which passed the eye completely.
    for each in (series[f'{side} eye blocked'] for side in ('infeed', 'outfeed')):
        whole = np.array([at for at, _ in each['data'] if at is not None]).reshape(-1, 2)
        assert np.all(np.diff(whole) < 1.1 * LENGTH / MS)
    (diamond,) = series['missing edge']['data']
    assert diamond[0] == pytest.approx((edges[lost].stamp - origin) / MS, abs=5)
    assert series['missing edge']['z'] > 3 >= series[name].get('z', 3)


def test_of_two_products_the_time_is_marked_in_which_both_are_there(line: Recording):
    edges = edges_of(line, BROKEN)
    second = edges['t1'].stamp + 150 * MS
    near = [
        EyeEdge(second, Eye.INFEED, True), EyeEdge(second + LENGTH, Eye.INFEED, False),
        EyeEdge(second + TRANSIT, Eye.OUTFEED, True),
        EyeEdge(second + TRANSIT + LENGTH, Eye.OUTFEED, False),
    ]  # fmt: skip
    (mark,) = marks_of(with_edges(line, *near), Reason.DISTANCE_FAULT)
    assert (mark.begin, mark.end) == (second, edges['t3'].stamp)
    assert 'next product' in mark.text


def test_a_product_that_no_eye_saw_shows_as_a_change_of_the_load(line: Recording):
    edges = edges_of(line, BROKEN)
    heavier = round(0.05 * line.load_cell.counts_per_kg)
    until = edges['t3'].stamp - 40 * MS
    onto = changed(
        line, lambda stamp, counts: counts + heavier * (until <= stamp < edges['t4'].stamp)
    )
    (mark,) = marks_of(onto, Reason.DISTANCE_FAULT)
    assert (mark.begin, mark.end) == (edges['t2'].stamp, edges['t3'].stamp)
    assert float(mark.text.split()[4]) == pytest.approx(50, rel=0.3)


def test_a_chattering_eye_is_marked_while_it_chatters(line: Recording):
    begin = edges_of(line, BROKEN)['t1'].stamp + 20 * MS
    flicker = [EyeEdge(begin + k * 2 * MS, Eye.INFEED, k % 2 == 1) for k in range(4)]
    (mark,) = marks_of(with_edges(line, *flicker), Reason.CHATTERING_EYE)
    assert mark.begin <= begin
    assert mark.end == flicker[-1].stamp
    assert mark.text.startswith('infeed eye: switches')


def test_saturated_and_lost_samples_are_marked(line: Recording):
    middle = edges_of(line, BROKEN)['t2'].stamp + 50 * MS
    (mark,) = marks_of(saturated_at(line, middle), Reason.SATURATION)
    assert mark.begin <= middle <= mark.end
    assert 'highest' in mark.text
    (mark,) = marks_of(without_block_at(line, middle), Reason.SAMPLES_LOST)
    assert mark.begin < middle < mark.end
    block = len(line.blocks[0].counts)
    assert mark.text.startswith(f'{block} samples lost')


def test_a_rise_at_another_time_is_measured_and_drawn_beside_that_of_the_eyes(line: Recording):
    late = 8 * MS
    edges = edges_of(line, BROKEN)
    earlier = [replace(edge, stamp=edge.stamp - late) for edge in edges.values()]
    shifted = with_edges(without_edges(line, *edges.values()), *earlier)
    (mark,) = marks_of(shifted, Reason.EDGE_MISMATCH)
    assert mark.begin == edges['t1'].stamp - late
    assert mark.end - mark.begin == pytest.approx(late, abs=1.5 * MS)
    assert 'later than the eyes say' in mark.text
    item = broken_item(lane_of(shifted), Reason.EDGE_MISMATCH)
    names = [each['name'] for each in signal_chart(item, line.load_cell)[0]['series']]
    assert 'load by the eyes' in names


def test_speed_length_load_and_zero_are_said_in_numbers(line: Recording):
    cell, edges = line.load_cell, edges_of(line, BROKEN)
    upside_down = replace(cell, counts_per_kg=-cell.counts_per_kg)

    def shifted(mass: float, where: Callable[[int], bool]) -> Recording:
        extra = round(mass * cell.counts_per_kg)
        return changed(line, lambda stamp, counts: counts + extra * where(stamp))

    def inside(stamp: int) -> bool:
        return edges['t1'].stamp <= stamp < edges['t4'].stamp

    slow = [replace(edges[name], stamp=edges[name].stamp + 150 * MS) for name in ('t3', 't4')]
    slowed = with_edges(without_edges(line, edges['t3'], edges['t4']), *slow)
    short = LineParameters().with_values({'segmenter.product_length': 0.15})
    begin = edges_of(line, BROKEN - 1)['t4'].stamp + 50 * MS
    cases: list[tuple[Recording, Reason, LineParameters, str]] = [
        (slowed, Reason.BELT_SPEED_CHANGED, DEFAULTS, '34.3 m/min; the item before: 60'),
        (line, Reason.PRODUCT_TOO_SHORT, short, ' mm on a belt of 200 mm'),
        (replace(line, load_cell=upside_down), Reason.NO_LOAD, DEFAULTS, 'nothing rests'),
        (shifted(7.5, inside), Reason.OVERLOAD, DEFAULTS, 'the capacity of the cell 7200'),
        (
            shifted(0.5, lambda stamp: stamp >= begin), Reason.ZERO_OUT_OF_RANGE,
            DEFAULTS, 'the empty belt reads +500',
        ),
    ]  # fmt: skip
    for recording, reason, parameters, text in cases:
        marks = marks_of(recording, reason, parameters)
        assert any(text in mark.text for mark in marks), (reason, marks)


@pytest.mark.parametrize(
    ('reason', 'text'),
    [(Reason.STREAM_ENDED, 'the samples end here'), (Reason.START_UP, 'the samples begin here')],
)
def test_begin_and_end_of_the_samples_are_marked(line: Recording, reason: Reason, text: str):
    middle = edges_of(line, BROKEN)['t2'].stamp
    side = operator.le if reason == Reason.STREAM_ENDED else operator.ge
    part = replace(
        line,
        blocks=tuple(each for each in line.blocks if side(each.stamp, middle)),
        edges=tuple(each for each in line.edges if side(each.stamp, middle)),
    )
    (mark,) = [each for each in marks_of(part, reason) if each.text == text]
    assert mark.begin == pytest.approx(middle, abs=20 * MS)


def test_an_edge_that_came_late_is_marked(line: Recording):
    edges = edges_of(line, BROKEN)
    lane, late = Lane('a'), edges['t2']
    fault = Verdict(7, edges['t3'].stamp, Decision.FAULT, ('LateEdge',), t1=edges['t1'].stamp)
    for record in (line.load_cell, *line.blocks, edges['t1'], edges['t3'], late, fault):
        lane.take(record)
    item = lane.with_signals(lane.items()[0])
    (mark,) = fault_marks(Scene(item, item.stretch, line.load_cell))
    assert mark.begin == late.stamp
    assert mark.text.startswith('infeed eye')


def test_a_missing_edge_without_any_known_speed_is_said_without_a_place(line: Recording):
    edges = edges_of(line, 0)
    marks = marks_of(without_edges(line, edges['t3']), Reason.MISSING_EDGE)
    (mark,) = [each for each in marks if 't3' in each.text]
    assert mark.edge == ''
    assert 'after this' in mark.text


@pytest.mark.parametrize('reason', list(Reason))
def test_any_reason_on_any_stretch_gives_marks_within_it_or_none(line: Recording, reason: Reason):
    """An item with a reason may have only one known edge."""
    lane = lane_of(line)
    for t1, t3 in ((None, edges_of(line, 2)['t3'].stamp), (edges_of(line, 2)['t1'].stamp, None)):
        lane.take(Verdict(50, t3, Decision.FAULT, (reason.value,), t1=t1))
        item = lane.with_signals(lane.items()[0])
        for mark in fault_marks(Scene(item, item.stretch, line.load_cell)):
            assert item.stretch.time[0] <= mark.begin <= mark.end <= item.stretch.time[-1]
        assert signal_chart(item, line.load_cell)[0]['series']
