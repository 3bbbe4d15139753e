# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Lines with all kinds of disturbances: the truth, and the messages that reach the stages.

A line is drawn in two steps: the motion of the products (too close, belt stopped or slower, taken
off), and the fate of the messages (lost, twice, late, in a wrong order, chatter, jumps of clock and
index). The truth is known by construction.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from hypothesis import strategies as st
from lines import EDGES
import numpy as np
from numpy.typing import NDArray

from checkweigher_core.records import NANOSECONDS, Eye, EyeEdge, LoadCell, SampleBlock

MS = NANOSECONDS // 1000
START = 1_700_000_000 * NANOSECONDS
RATE = 960.0
CELL = LoadCell(RATE, 5e5, 1.25e6, -(2**23), 2**23 - 1, 7.2, 0.2)
LENGTH = 0.1  # m, of a product
MASSES = (0.11, 0.23, 0.17, 0.31, 0.13, 0.4)  # kg, none within 3 % of another or of a sum
BLOCK = 96  # samples
DEBOUNCE = 5 * MS  # ns; what comes sooner after another product is one with it
LEAD_IN, RUN_OUT = 1.0, 1.0  # s
LATENESS = 2 * NANOSECONDS  # ns; what comes later is of a stream that starts again
NOISE = 1e-4 * np.random.Generator(np.random.PCG64(1)).standard_normal(1 << 17)  # kg

_NEVER = 1 << 62

Event = SampleBlock | EyeEdge


@dataclass(frozen=True)
class Jump:
    """Before block `block` clock and index of the source jump: `index` None starts again at 0."""

    block: int
    time: int  # ns
    index: int | None


@dataclass(frozen=True)
class Plan:
    """What happens on a line; all that hypothesis draws.

    Products are counted from 0, events by their position in the order of arrival.
    """

    speed: float  # m/s
    gaps: tuple[float, ...]  # m, from leading edge to leading edge
    stops: tuple[tuple[int, float, float], ...] = ()  # product, its way in m, duration in s
    slower: tuple[int, float] | None = None  # from this product on by this factor
    taken_off: tuple[int, float] | None = None  # product, its way in m
    lost: frozenset[tuple[int, str]] = frozenset()
    chatter: tuple[tuple[int, str, int, int], ...] = ()  # product, edge, flickers, ms each
    doubled: tuple[tuple[int, int], ...] = ()  # position, by how much later
    delayed: tuple[tuple[int, int], ...] = ()
    lost_events: frozenset[int] = frozenset()
    jump: Jump | None = None


@dataclass(frozen=True)
class Product:
    """What really became of a product; times in ns since the line began, None if it never came."""

    mass: float
    t1: int
    t2: int | None
    t3: int | None
    t4: int | None
    gone: int  # when nothing of it was on the belt any more

    def at(self, name: str) -> int | None:
        """Return the time of an edge."""
        time: int | None = getattr(self, name)
        return time


@dataclass(frozen=True)
class SpoiltLine:
    """A line as it was, and its messages in the order in which they arrive.

    Attributes
    ----------
    events : tuple of (int, Event)
        Time of arrival in ns since the line began, and what comes.
    truth : tuple of dict of str to int
        Stamps of the edges of each product by the clock of the source.
    heard : tuple of bool
        Of each product, whether any of its edges is among the events.
    entries : tuple of tuple of int
        What the infeed eye has shown to enter, each as the products in it: more than one where the
        edges between them were lost. Edges that came after a younger one of that eye show nothing.
    sound : tuple of bool
        Whether a product was alone on the belt from t2 to t3, by what the eyes could know, and
        the clock was one from t1 to t3.
    alone : tuple of bool
        Whether it really was alone.
    """

    plan: Plan
    products: tuple[Product, ...]
    events: tuple[tuple[int, Event], ...]
    truth: tuple[dict[str, int], ...]
    heard: tuple[bool, ...]
    entries: tuple[tuple[int, ...], ...]
    sound: tuple[bool, ...]
    alone: tuple[bool, ...]


def _travel(plan: Plan) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return knots of time (s) and travel (m) of the belt; product i enters at travel X_i."""
    entries = _entries(plan)
    marks = [(entries[p] + way, duration) for p, way, duration in plan.stops if p < len(entries)]
    if plan.slower is not None and plan.slower[0] < len(entries):
        marks.append((entries[plan.slower[0]], 0.0))
    times, ways, speed = [0.0], [-LEAD_IN * plan.speed], plan.speed
    for way, duration in sorted(marks):
        times.append(times[-1] + (way - ways[-1]) / speed)
        ways.append(way)
        if duration:
            times.append(times[-1] + duration)
            ways.append(way)
        elif plan.slower is not None:
            speed = plan.speed * plan.slower[1]
    end = entries[-1] + CELL.weigh_length + LENGTH + RUN_OUT * plan.speed
    times.append(times[-1] + (end - ways[-1]) / speed)
    ways.append(end)
    return np.array(times), np.array(ways)


def _entries(plan: Plan) -> list[float]:
    return [0.0, *np.cumsum(plan.gaps).tolist()]


def _products(plan: Plan, times: NDArray[np.float64], ways: NDArray[np.float64]) -> list[Product]:
    # While the belt stands it moves on by next to nothing: each way is reached at one time.
    moving = ways + 1e-9 * np.arange(len(ways))

    def when(way: float) -> int:
        return round(NANOSECONDS * float(np.interp(way, moving, times)))

    products = []
    for number, x in enumerate(_entries(plan)):
        t1, t2, t3, t4 = (when(x + way) for way in (0, LENGTH, 0.2, 0.2 + LENGTH))
        taken = plan.taken_off is not None and plan.taken_off[0] == number
        off = when(x + plan.taken_off[1]) if plan.taken_off is not None and taken else _NEVER
        mass, leaves = MASSES[number % len(MASSES)], t3 < off
        # An eye clears when the product in front of it is taken away.
        stamps = min(t2, off) if off > t1 else None, t3 if leaves else None
        gone = min(off, t4)
        products.append(Product(mass, t1, *stamps, gone if leaves else None, gone))
    return products


def _counts(
    plan: Plan, products: list[Product], times: NDArray[np.float64], ways: NDArray[np.float64]
) -> NDArray[np.int32]:
    time = np.arange(int(times[-1] * RATE)) / RATE
    travel = np.interp(time, times, ways)
    load = NOISE[: len(time)].copy()
    for product, entry in zip(products, _entries(plan), strict=True):
        way = travel - entry
        share = np.clip(way / LENGTH, 0, 1) - np.clip((way - CELL.weigh_length) / LENGTH, 0, 1)
        load += product.mass * np.where(time * NANOSECONDS < product.gone, share, 0.0)
    return np.rint(CELL.zero_counts + CELL.counts_per_kg * load).astype(np.int32)


def make_line(plan: Plan) -> SpoiltLine:
    """Let a plan happen."""
    times, ways = _travel(plan)
    products = _products(plan, times, ways)
    counts = _counts(plan, products, times, ways)
    jump_at = plan.jump.block * BLOCK if plan.jump else len(counts)
    jumps = round(jump_at * NANOSECONDS / RATE)

    def stamp(time: int) -> int:
        late = plan.jump.time if plan.jump is not None and time >= jumps else 0
        return START + time + late

    events: list[tuple[int, Event]] = []
    for begin in range(0, len(counts), BLOCK):
        block = counts[begin : begin + BLOCK]
        index = begin
        if plan.jump is not None and begin >= jump_at:
            index = begin - jump_at if plan.jump.index is None else begin + plan.jump.index
        time = round(begin * NANOSECONDS / RATE)
        arrival = time + round(len(block) * NANOSECONDS / RATE)
        events.append((arrival, SampleBlock(stamp(time), index, block)))
    events += _edges(plan, products, stamp)
    events = _disorder(plan, sorted(events, key=lambda pair: pair[0]))
    truth = tuple(
        {name: stamp(time) for name in EDGES if (time := product.at(name)) is not None}
        for product in products
    )
    came = _first_places(events)
    heard = tuple(
        any(EyeEdge(t, *EDGES[name]) in came for name, t in stamps.items()) for stamps in truth
    )
    sound = tuple(_is_sound(i, products, truth, came, jumps) for i in range(len(products)))
    alone = tuple(not _neighbours(products, product) for product in products)
    entries = _entries_shown(truth, came)
    return SpoiltLine(plan, tuple(products), tuple(events), truth, heard, entries, sound, alone)


def _first_places(events: Sequence[tuple[int, Event]]) -> dict[EyeEdge, int]:
    """Return the position at which each edge came first."""
    places: dict[EyeEdge, int] = {}
    for position, (_, event) in enumerate(events):
        if isinstance(event, EyeEdge):
            places.setdefault(event, position)
    return places


def _entries_shown(
    truth: Sequence[dict[str, int]], came: dict[EyeEdge, int]
) -> tuple[tuple[int, ...], ...]:
    """Return the products that the infeed eye has shown, in one where it has shown one."""
    entries: list[tuple[int, ...]] = []
    cleared = True  # behind the product before, by what the eye has shown
    for number, stamps in enumerate(truth):
        edges = [EyeEdge(stamps[name], *EDGES[name]) for name in ('t1', 't2') if name in stamps]
        heard = [edge for edge in edges if edge in came]
        if not heard:
            continue
        in_order = not any(_is_late(edge, came) for edge in heard)
        if heard[0].blocked or cleared:
            if in_order:
                entries.append((number,))
        elif entries:
            entries[-1] = (*entries[-1], number)
        cleared = not heard[-1].blocked and in_order
    return tuple(entries)


def _is_late(edge: EyeEdge, came: dict[EyeEdge, int]) -> bool:
    return any(
        other.eye == edge.eye and other.stamp > edge.stamp and place < came[edge]
        for other, place in came.items()
    )


def _neighbours(products: list[Product], product: Product) -> list[int]:
    """Return which others were on the belt between t2 and t3 of a product."""
    if product.t2 is None or product.t3 is None:
        return []
    return [
        number
        for number, other in enumerate(products)
        if other is not product and other.t1 < product.t3 and other.gone > product.t2
    ]


def _is_sound(
    number: int,
    products: list[Product],
    truth: Sequence[dict[str, int]],
    came: dict[EyeEdge, int],
    jumps: int,
) -> bool:
    """Return whether a product can be weighed, by the edges that came before its window closed."""
    product = products[number]
    if product.t2 is None or product.t3 is None or product.t1 < jumps < product.t3:
        return False

    def place(of: int, name: str) -> int:
        return came.get(EyeEdge(truth[of].get(name, 0), *EDGES[name]), _NEVER)

    # An item that the eye showed as one with another could not be known.
    apart = {entry[0] for entry in _entries_shown(truth, came)}
    return not any(
        min(place(other, 't1'), place(other, 't2')) < place(number, 't3')
        for other in _neighbours(products, product)
        if other in apart
    )


def _edges(
    plan: Plan, products: list[Product], stamp: Callable[[int], int]
) -> list[tuple[int, Event]]:
    edges: list[tuple[int, Event]] = []
    for number, product in enumerate(products):
        for name, (eye, blocked) in EDGES.items():
            time = product.at(name)
            if time is not None and (number, name) not in plan.lost:
                edges.append((time, EyeEdge(stamp(time), eye, blocked)))
    for number, name, flickers, width in plan.chatter:
        time = products[number].at(name) if number < len(products) else None
        # An edge that is lost but for its flicker only comes late, which could not be known.
        if time is None or (number, name) in plan.lost:
            continue
        eye, blocked = EDGES[name]
        begin, end = ('t1', 't2') if eye == Eye.INFEED else ('t3', 't4')
        if any(
            other is not products[number]
            and (other.at(begin) or time) <= time + 2 * flickers * width * MS + DEBOUNCE
            and (other.at(end) or other.gone) >= time
            for other in products
        ):
            continue  # an eye that is covered does not flicker
        last = time + 2 * flickers * width * MS
        jumps = plan.jump.block * BLOCK * NANOSECONDS / RATE if plan.jump else last
        if time < jumps < last or stamp(last) - stamp(time) != last - time:
            continue  # nor does the source start again meanwhile
        for k in range(2 * flickers):
            when = time + (k + 1) * width * MS
            edges.append((when, EyeEdge(stamp(when), eye, blocked ^ (k % 2 == 0))))
    return edges


def _disorder(plan: Plan, events: list[tuple[int, Event]]) -> list[tuple[int, Event]]:
    """Lose, repeat and delay events; what is delayed arrives with what it comes behind."""
    edges = [event for _, event in events if isinstance(event, EyeEdge)]

    # Of chatter all comes, in order: with parts of it missing it looks like anything.
    def flickers(event: Event) -> bool:
        return isinstance(event, EyeEdge) and any(
            event.eye == e.eye and 0 < abs(event.stamp - e.stamp) < DEBOUNCE for e in edges
        )

    events = [e for i, e in enumerate(events) if i not in plan.lost_events or flickers(e[1])]

    # What comes from before a jump of the clock cannot be told from another jump.
    def movable(position: int) -> bool:
        if position >= len(events) or flickers(events[position][1]):
            return False
        is_edge = isinstance(events[position][1], EyeEdge)
        return plan.jump is None or (is_edge and plan.jump.time == 0)

    for position, by in plan.doubled:
        if movable(position):
            _insert(events, position + by, events[position])
    for position, by in plan.delayed:
        if movable(position):
            _insert(events, position + by, events.pop(position))
    return events


def _insert(events: list[tuple[int, Event]], position: int, event: tuple[int, Event]) -> None:
    """Put in an event, with the time of what it comes behind, but no more than LATENESS late."""
    _, what = event
    latest = what.stamp - START + LATENESS
    while position > 0 and events[min(position, len(events)) - 1][0] > latest:
        position -= 1
    position = min(position, len(events))
    events.insert(position, (events[position - 1][0] if position else 0, what))


_GAPS = st.sampled_from([0.6, 0.31, 0.115, 0.15, 0.205, 0.25, 0.36, 0.42, 1.0, 2.5])
_POSITIONS = st.integers(0, 150)
_MOVES = st.lists(st.tuples(_POSITIONS, st.sampled_from([1, 2, 3, 8, 25, 90])), max_size=3)
_WAYS = st.sampled_from([0.02, 0.05, 0.09, 0.12, 0.17, 0.22, 0.28, 0.35])


@st.composite
def plans(draw: st.DrawFn) -> Plan:
    """Draw what happens on a line of three to six products."""
    gaps = draw(st.lists(_GAPS, min_size=2, max_size=5))
    number = st.integers(0, len(gaps))
    edge = st.tuples(number, st.sampled_from(sorted(EDGES)))
    flicker = st.tuples(
        number, st.sampled_from(sorted(EDGES)), st.integers(1, 3), st.sampled_from([1, 2, 4])
    )
    stop = st.tuples(number, _WAYS, st.sampled_from([0.02, 0.1, 0.3, 1.0, 3.0]))
    jump = st.builds(
        Jump,
        st.integers(8, 60),
        st.sampled_from([0, 487 * MS, 30 * MS, 10 * NANOSECONDS, -487 * MS, -5013 * MS]),
        st.sampled_from([0, None, 96, -96, 10_000]),
    ).filter(lambda jump: jump.time or jump.index != 0)
    return Plan(
        draw(st.sampled_from([1.0, 0.5, 1.5])),
        tuple(gaps),
        tuple(draw(st.lists(stop, max_size=1))),
        draw(st.none() | st.tuples(number, st.sampled_from([0.8, 0.5, 1.4]))),
        draw(st.none() | st.tuples(number, _WAYS)),
        frozenset(draw(st.sets(edge, max_size=4))),
        tuple(draw(st.lists(flicker, max_size=1))),
        tuple(draw(_MOVES)),
        tuple(draw(_MOVES)),
        frozenset(draw(st.sets(_POSITIONS, max_size=2))),
        draw(st.none() | jump),
    )
