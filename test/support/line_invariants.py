# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Properties that hold on every spoilt line, and counts of what came of it."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
import heapq
import math

from spoilt_lines import CELL, EDGES, LENGTH, MS, START, Event, SpoiltLine

from checkweigher_core.records import (
    NANOSECONDS,
    Decision,
    EyeEdge,
    Item,
    MassEstimate,
    SampleBlock,
    StreamState,
    StreamStatus,
    Verdict,
)
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.pipeline.line import LineParameters, Weighing, WeighingLine
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

# Of the mass. The masses and their sums differ by more; without disturbances a window that is
# whole is far better.
TOLERANCE = {'mean': 0.01, 'iswd_eksi': 0.03}


def parameters(estimator: str, *, length_known: bool) -> LineParameters:
    """Return the parameters of all stages."""
    return LineParameters(
        segmenter=SegmenterParameters(product_length=LENGTH if length_known else 0.0),
        identifier=IdentifierParameters(estimator=estimator),
    )


_FAR_OFF = 0.03  # of the mass
STALL_TIME = 100 * MS  # ns, after which the segmenter node goes by the eyes alone
_NAMES = {edge: name for name, edge in EDGES.items()}


@dataclass
class Tally:
    """Counts over many lines."""

    lines: int = 0
    products: int = 0
    heard: int = 0
    entries: int = 0
    verdicts: int = 0
    no_estimate: int = 0
    unseen: int = 0
    misweighed: int = 0
    in_time: Counter[str] = field(default_factory=Counter)
    decisions: Counter[str] = field(default_factory=Counter)
    reasons: Counter[str] = field(default_factory=Counter)

    def add(
        self, line: SpoiltLine, verdicts: Sequence[Verdict], in_time: Sequence[Verdict]
    ) -> None:
        """Count a line: what all stages made of it, and the reject stage on a clock."""
        self.in_time.update(verdict.decision.name for verdict in in_time)
        for verdict in verdicts:
            number = _sound_product(line, verdict)
            if verdict.decision is not Decision.FAULT and number is not None:
                mass = line.products[number].mass
                self.unseen += not line.alone[number]
                self.misweighed += abs(verdict.mass - mass) > _FAR_OFF * mass
        self.no_estimate += sum('NoEstimate' in verdict.reasons for verdict in in_time)
        self.lines += 1
        self.products += len(line.products)
        self.heard += sum(line.heard)
        self.entries += len(line.entries)
        self.verdicts += len(verdicts)
        self.decisions.update(verdict.decision.name for verdict in verdicts)
        self.reasons.update(reason for verdict in verdicts for reason in verdict.reasons)

    def __str__(self) -> str:
        decisions, in_time = (
            ', '.join(f'{count} {name}' for name, count in sorted(counts.items()))
            for counts in (self.decisions, self.in_time)
        )
        reasons = ', '.join(f'{name} {count}' for name, count in self.reasons.most_common())
        return (
            f'{self.lines} lines, {self.products} products, {self.heard} of them heard of, '
            f'{self.entries} seen to enter, '
            f'{self.verdicts} verdicts: {decisions}, '
            f'{self.unseen} of them accepted with a neighbour whose t1 was lost or late, '
            f'{self.misweighed} more than {_FAR_OFF:.0%} off; '
            f'reasons: {reasons}; '
            f'on a clock: {in_time}, {self.no_estimate} of these NoEstimate'
        )


def weigh(line: SpoiltLine, known: LineParameters) -> list[tuple[int, Weighing]]:
    """Run the stages over a line; return what they give and when, ns since the line began."""
    stages = WeighingLine(CELL, known)
    weighed, now = [], 0
    for now, event in line.events:
        weighed += [(now, weighing) for weighing in stages.add(event)]
    return weighed + [(now, weighing) for weighing in stages.finish()]


def verdicts_in_time(
    line: SpoiltLine, known: LineParameters, weighed: Sequence[tuple[int, Weighing]],
    delays: Sequence[int | None],
) -> list[Verdict]:  # fmt: skip
    """Run the reject stage alone, on a clock, with estimates that come late or never.

    Parameters
    ----------
    line : SpoiltLine
        Its edges, and its items as a segmenter announces them, come when they happen.
    known : LineParameters
        Those of the segmenter.
    weighed : sequence of (int, Weighing)
        Their estimates come by ``delays``.
    delays : sequence of int or None
        ns after they were made, None for never; taken in turn.
    """
    stage = RejectStage(RejectParameters(), CELL.weigh_length)
    late: list[tuple[int, Item | EyeEdge | MassEstimate | StreamStatus]] = []
    for number, (when, weighing) in enumerate(weighed):
        delay = delays[number % len(delays)]
        if delay is not None:
            late.append((when + delay, weighing.estimate))
    edges = [(when, e) for when, e in with_last(line) if not isinstance(e, SampleBlock)]
    verdicts: list[Verdict] = []
    records = heapq.merge(edges, _announcements(line, known), sorted(late, key=_when), key=_when)
    for now, record in records:
        while stage.due is not None and stage.due < now:
            verdicts += stage.advance(stage.due)
        verdicts += stage.take(record, now)
    while stage.due is not None:
        verdicts += stage.advance(stage.due)
    return verdicts


def _announcements(
    line: SpoiltLine, known: LineParameters
) -> list[tuple[int, Item | StreamStatus]]:
    """Return what the segmenter says and when: items, and how far it is.

    It goes by the eyes alone where samples stall.
    """
    segmenter = Segmenter(CELL, known.segmenter)
    said: list[tuple[int, Item | StreamStatus]] = []

    def say(now: int) -> None:
        said.extend((now, item) for item in segmenter.take_announced())
        if segmenter.last_edge is not None:
            counts = segmenter.samples, segmenter.edges
            status = StreamStatus(0, 0, StreamState.RUNNING, *counts, last_edge=segmenter.last_edge)
            said.append((now, status))

    stalled = math.inf  # when the segmenter goes by the eyes alone
    for now, event in with_last(line):
        if stalled <= now:
            segmenter.go_by_edges()
            say(round(stalled))
            stalled = math.inf
        segmenter.take(event)
        say(now)
        waits = segmenter.edges_wait and not isinstance(event, SampleBlock)
        stalled = min(stalled, now + STALL_TIME) if waits else math.inf
    segmenter.finish()
    say(now + STALL_TIME)
    return said


def with_last(line: SpoiltLine) -> list[tuple[int, Event]]:
    """Return the events with one more product behind, which brings to light what was missed."""
    arrival = max(when for when, _ in line.events) + 4 * NANOSECONDS
    newest = max(event.stamp for _, event in line.events) + 4 * NANOSECONDS
    edges = [EyeEdge(newest + k * 100 * MS, *EDGES[name]) for k, name in enumerate(sorted(EDGES))]
    return [*line.events, *((arrival + k * 100 * MS, edge) for k, edge in enumerate(edges))]


def _when(pair: tuple[int, object]) -> int:
    return pair[0]


def violations(
    line: SpoiltLine, verdicts: Sequence[Verdict], estimates: Iterable[MassEstimate]
) -> Iterator[str]:
    """Say what is wrong with the verdicts on a line: nothing, if all is well.

    An item may be any of the products that its edges are of: more than one where edges in between
    were lost, and it is a fault then. With each item assigned to one product of its own, none must
    be left over: neither an item, nor a product that entered.

    Parameters
    ----------
    line : SpoiltLine
        What really happened.
    verdicts : sequence of Verdict
        Of all items that the stages found.
    estimates : iterable of MassEstimate
        What they rest on.

    Yields
    ------
    str
        - an item number that was given twice
        - an item that is a further one, or none
        - a product that has no verdict although the infeed eye saw it
        - an accepted item that is no product which was whole and alone on the belt
    """
    numbers = Counter(verdict.item_id for verdict in verdicts)
    for number, count in numbers.items():
        if count > 1:
            yield f'number {number} was given {count} times'
    t2s = {estimate.item_id: estimate.t2 for estimate in estimates}
    newest = max(stamp for stamps in line.truth for stamp in stamps.values())
    of_line = [v for v in verdicts if v.t1 is None or v.t1 <= newest]  # not that of `with_last`
    products = _products_of_edges(line)
    candidates = [_candidates(products, v, t2s.get(v.estimate_id)) for v in of_line]
    for item in _without_partner(candidates):
        yield f'doubled, or no product: {of_line[item]}'
    entries = [
        {item for item, numbers in enumerate(candidates) if numbers & set(entry)}
        for entry in line.entries
    ]
    for entry in _without_partner(entries):
        yield f'products {line.entries[entry]} have no verdict'
    for verdict in verdicts:
        if verdict.decision is Decision.FAULT or _sound_product(line, verdict) is not None:
            continue
        if _alone_in_window(line, t2s.get(verdict.estimate_id), verdict.t3) is None:
            yield f'accepted, but no sound product: {verdict}'


def _products_of_edges(line: SpoiltLine) -> dict[tuple[str, int], set[int]]:
    """Return which products the edges that came are of, those of flickers included."""
    came = {event for _, event in line.events if isinstance(event, EyeEdge)}
    products: dict[tuple[str, int], set[int]] = {}
    for number, stamps in enumerate(line.truth):
        edges = [EyeEdge(stamp, *EDGES[name]) for name, stamp in stamps.items()]
        for flickering, name, flickers, width in line.plan.chatter:
            if flickering == number and name in stamps:
                eye, blocked = EDGES[name]
                edges += [
                    EyeEdge(stamps[name] + (k + 1) * width * MS, eye, blocked ^ (k % 2 == 0))
                    for k in range(2 * flickers)
                ]
        for edge in edges:
            if edge in came:
                products.setdefault((_NAMES[edge.eye, edge.blocked], edge.stamp), set()).add(number)
    return products


def _candidates(
    products: dict[tuple[str, int], set[int]], verdict: Verdict, t2: int | None
) -> set[int]:
    """Return which products an item may be."""
    known = {'t1': verdict.t1, 't2': t2, 't3': verdict.t3}
    numbers: set[int] = set()
    for name, stamp in known.items():
        if stamp is not None:
            numbers |= products.get((name, stamp), set())
    if verdict.t1 is None and not verdict.estimate_id:
        # A verdict does not tell t2; without an estimate it may be any.
        numbers |= {n for (name, _), of_it in products.items() if name == 't2' for n in of_it}
    if verdict.t1 is None and t2 is None:
        # Which of those that left had been seen to enter is not known.
        shown = {n for (name, _), of_it in products.items() if name in ('t1', 't2') for n in of_it}
        numbers |= set().union(*products.values()) - shown
    return numbers


def _without_partner(candidates: Sequence[set[int]]) -> list[int]:
    """Return what is left over if each gets a candidate of its own, as many as can (Kuhn)."""
    taken: dict[int, int] = {}

    def find(one: int, tried: set[int]) -> bool:
        for candidate in candidates[one] - tried:
            tried.add(candidate)
            if candidate not in taken or find(taken[candidate], tried):
                taken[candidate] = one
                return True
        return False

    return [one for one in range(len(candidates)) if not find(one, set())]


def _sound_product(line: SpoiltLine, item: Verdict | MassEstimate) -> int | None:
    """Return the number of the sound product that left at t3, None if it did not enter at t1.

    Without a known length a long product looks like one that was taken off with its t2 lost and a
    next one with its t1 lost. What is weighed is the next one, and right.
    """
    for number, (truth, sound) in enumerate(zip(line.truth, line.sound, strict=True)):
        if not sound or truth.get('t3') != item.t3:
            continue
        if item.t1 == truth['t1']:
            return number
        before = line.truth[number - 1] if number else {}
        known = {event for _, event in _until(line, EyeEdge(truth['t3'], *EDGES['t3']))}
        lost = [(truth, 't1'), (before, 't2')]
        heard = any(EyeEdge(of.get(name, 0), *EDGES[name]) in known for of, name in lost)
        return number if item.t1 == before.get('t1') and not heard else None
    return None


def _alone_in_window(line: SpoiltLine, t2: int | None, t3: int | None) -> int | None:
    """Return which product left at t3 and really was alone and wholly on the belt since t2.

    Where edges are lost its window may begin by that of one that was taken off: it is whole and
    holds nothing else, and its mass has to be right.
    """
    for number, product in enumerate(line.products):
        if t2 is None or product.t3 is None or line.plan.jump or product.t3 + START != t3:
            continue
        begin, others = t2 - START, [other for other in line.products if other is not product]
        alone = not any(each.t1 < product.t3 and each.gone > begin for each in others)
        return number if alone and product.t2 is not None and product.t2 <= begin else None
    return None


def _until(line: SpoiltLine, last: EyeEdge) -> Iterator[tuple[int, EyeEdge]]:
    """Yield the edges that came up to the first of `last`."""
    for when, event in line.events:
        if isinstance(event, EyeEdge):
            yield when, event
            if event == last:
                return


def wrong_masses(line: SpoiltLine, weighings: Sequence[Weighing], estimator: str) -> Iterator[str]:
    """Say which accepted items have not t2, t3 and the mass of the product that they are of."""
    for weighing in weighings:
        estimate = weighing.estimate
        if not estimate.weighed:
            continue
        within = _alone_in_window(line, estimate.t2, estimate.t3)
        number = _sound_product(line, estimate) if within is None else within
        if number is None:
            continue  # told by `violations`
        mass = line.products[number].mass
        if within is None and estimate.t2 != line.truth[number]['t2']:
            yield f'stamps of another product: {estimate}'
        if abs(estimate.mass - mass) > max(TOLERANCE[estimator] * mass, 4 * estimate.std_dev):
            yield f'{estimate.mass:.5f} kg +- {estimate.std_dev:.5f} is accepted for {mass:g} kg'
