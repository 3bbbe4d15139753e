# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the verdicts in the bag of a verification with its estimates and its samples.

A person who changes the results in a bag would also have to change the samples, because otherwise
the samples would give other results.
"""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
import hashlib
import math
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from checkweigher_core.parameters import ParameterError
from checkweigher_core.printable import one_line
from checkweigher_core.recording import Recording
from checkweigher_core.records import GRAMS, Decision, MassEstimate, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_validation.accuracy.passes import SAME_ITEM
from checkweigher_validation.accuracy.results import ItemResult, weigh

# Largest difference between the mass in a verdict and the mass that is computed again from the
# samples, in verification scale intervals e.
_TOLERANCE = 0.2
_MOST = 3  # largest number of items that a sentence names


def conflicts(
    recording: Recording,
    estimates: Iterable[MassEstimate],
    verdicts: Sequence[Verdict],
    identity: Mapping[str, object],
    interval: float,
    begins: Sequence[int] = (),
) -> Iterator[str]:
    """Yield a sentence for each kind of conflict between verdicts, estimates and samples.

    A mass in a verdict must equal the mass in its estimate, and may differ by at most 0.2 e from
    the mass that is computed again from the samples. If the samples cannot be weighed again, a
    sentence with the reason is yielded. `identity` is the identity record of the bag, which
    contains the parameters of the nodes. `interval` is the verification scale interval e in kg.
    `begins` contains the start times in ns of the recordings if several recordings were weighed
    separately, and is empty otherwise.
    """
    masses = {(each.item_id, each.t1): each.mass for each in estimates}
    other = [
        f'item {each.item_id}: {_grams(each.mass)}, estimate {_grams(mass)}'
        for each in verdicts
        if is_weighed(each)
        and (mass := masses.get((each.estimate_id, each.t1), math.nan)) != each.mass
    ]
    yield from _counted('verdicts have another mass than their estimate', other)
    text = identity.get('parameters')
    if not isinstance(text, str):
        yield 'The samples were not weighed again: the bag has no parameters of the nodes.'
        return
    if hashlib.sha256(text.encode()).hexdigest() != identity.get('parameters_sha256'):
        yield 'The parameters in the bag do not agree with their digest.'
        return
    try:
        parameters = _parameters(text)
        again = [item for part in _cut(recording, begins) for item in weigh(part, parameters)]
    except ParameterError as error:
        yield f'The samples were not weighed again: {one_line(error)}.'
        return
    yield from _compared(again, verdicts, _TOLERANCE * interval)


def _cut(recording: Recording, begins: Sequence[int]) -> Iterator[Recording]:
    """Yield the parts into which a recording is divided at the times `begins` in ns.

    Parts without sample blocks are left out. If `begins` is empty, the whole recording is yielded.
    """
    if not begins:
        yield recording
        return
    parts: dict[int, list[Any]] = defaultdict(list)
    for event in recording:
        parts[bisect_right(begins, event.stamp)].append(event)
    for events in parts.values():
        part = Recording.from_events(recording.load_cell, events)
        if part.blocks:
            yield part


def is_weighed(verdict: Verdict) -> bool:
    """Return whether an item got a mass.

    An item whose mass is NaN or infinite got no mass. An item with the decision FAULT got no mass
    either, unless NoProduct is the only reason. An item with NoProduct as the only reason was
    weighed, but there were no limits for its mass.
    """
    no_limits = verdict.reasons == (Reason.NO_PRODUCT.value,)
    return math.isfinite(verdict.mass) and (verdict.decision != Decision.FAULT or no_limits)


def _parameters(text: str) -> LineParameters:
    with TemporaryDirectory() as folder:
        path = Path(folder, 'parameters.yaml')
        path.write_text(text, encoding='utf-8')
        return LineParameters.from_file(path)


def _compared(
    again: Sequence[ItemResult], verdicts: Sequence[Verdict], tolerance: float
) -> Iterator[str]:
    """Yield a sentence for each kind of conflict between verdicts and items weighed again.

    The masses of an item may differ by at most `tolerance` in kg. The verdict of an item is the
    first verdict whose t1 differs from t1 of the item by at most `SAME_ITEM` ns.
    """
    known = _known(verdicts)
    times = [t1 for t1, _ in known]
    differ, without, found = [], [], set[int]()
    for item in again:
        t1, mass = item.estimate.t1, item.estimate.mass
        if t1 is None or math.isnan(mass):
            continue
        number = bisect_left(times, t1 - SAME_ITEM)
        if number == len(times) or times[number] > t1 + SAME_ITEM:
            without.append(f'item {item.estimate.item_id} of the samples: {_grams(mass)}')
            continue
        found.add(number)
        # The comparison is False if the mass of the verdict is NaN, which is no conflict.
        if abs(known[number][1] - mass) > tolerance:
            differ.append(f'{_grams(known[number][1])}, weighed again {_grams(mass)}')
    others = [mass for number, (_, mass) in enumerate(known) if number not in found]
    lacking = [_grams(mass) for mass in others if not math.isnan(mass)]
    yield from _counted('masses are not those of the samples', differ)
    yield from _counted('items of the samples have no verdict', without)
    yield from _counted('masses have no item in the samples', lacking)


def _known(verdicts: Sequence[Verdict]) -> list[tuple[int, float]]:
    """Return t1 in ns and the mass in kg of each verdict with a t1, in ascending order of t1.

    The mass is NaN if the item was not weighed.
    """
    masses = [(each.t1, each.mass if is_weighed(each) else math.nan) for each in verdicts]
    return sorted((t1, mass) for t1, mass in masses if t1 is not None)


def _counted(what: str, items: Sequence[str]) -> Iterator[str]:
    if items:
        more = ', ...' if len(items) > _MOST else ''
        yield f'{len(items)} {what}: {"; ".join(items[:_MOST])}{more}.'


def _grams(mass: float) -> str:
    return f'{GRAMS * mass:.3f} g'
