# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Comparison of the verdicts in the bag of a verification with its estimates and its samples.

A person who changes the results in a bag would also have to change the samples, because otherwise
the samples would give other results.
"""

from bisect import bisect_left, bisect_right
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
import hashlib
import math
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

from checkweigher_core.block_cutting import join_recording
from checkweigher_core.parameters import ParameterError
from checkweigher_core.printable import one_line
from checkweigher_core.recording import BlockColumns, Recording
from checkweigher_core.records import GRAMS, Decision, MassEstimate, Verdict, WeighWindow
from checkweigher_core.records.reasons import Reason
from checkweigher_dsp.denoising.denoiser import Denoiser
from checkweigher_dsp.estimation.identifier import Identifier
from checkweigher_dsp.pipeline.line import LineParameters, estimate_masses
from checkweigher_dsp.segmentation.segmenter import Segmenter
from checkweigher_validation.accuracy.passes import SAME_ITEM

# Largest difference between the mass in a verdict and the mass that is computed again from the
# samples, in verification scale intervals e.
_TOLERANCE = 0.2
# Largest difference between the recorded zero of an item and its zero by the samples in the bag, in
# standard deviations of the latter.
_FURTHEST_ZERO = 3.0
# Minimum number of items for the comparison of the median of these differences with the tolerance.
# The differences become small after some 50 items, because both zeros then follow the same samples.
_FEWEST_ZEROS = 100
_AT_ONCE = 200  # number of windows that are denoised together, to limit the memory
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
    the mass that is computed again from the samples and the recorded zero. The line has tracked the
    zero since before the bag begins, so the zero cannot be computed exactly. A recorded zero may
    differ from the zero by the samples in the bag by at most three standard deviations of the
    latter, and the median of the differences of at least 100 items may be at most 0.2 e. If the
    samples cannot be weighed again, a sentence with the reason is yielded. `identity` is the
    identity record of the bag, which contains the parameters of the nodes. `interval` is the
    verification scale interval e in kg. `begins` contains the start times in ns of the recordings
    if several recordings were weighed separately, and is empty otherwise.
    """
    known = _Results(verdicts, estimates)
    yield from _counted('Verdicts with another mass than their estimate', known.contradictions)
    text = identity.get('parameters')
    if not isinstance(text, str):
        yield 'The samples were not weighed again: the bag has no parameters of the nodes.'
        return
    if hashlib.sha256(text.encode()).hexdigest() != identity.get('parameters_sha256'):
        yield 'The parameters in the bag do not agree with their digest.'
        return
    try:
        parameters = _parameters(text)
        again = [
            item for part in _cut(recording, begins) for item in _weigh(part, parameters, known)
        ]
    except ParameterError as error:
        yield f'The samples were not weighed again: {one_line(error)}.'
        return
    begin = int(BlockColumns.of(recording.blocks).stamps[0])
    yield from _compared(again, known, _TOLERANCE * interval, begin)


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


class _Result(NamedTuple):
    """Recorded result of an item with a known t1 in ns. Unknown values are NaN."""

    t1: int
    mass: float  # kg, NaN if the item was not weighed
    zero: float  # tracked zero in kg, relative to the calibration


class _Results:
    """Recorded results in ascending order of t1, without those whose t1 is unknown.

    `contradictions` contains a text for each verdict whose mass is not that of its estimate.
    """

    def __init__(self, verdicts: Iterable[Verdict], estimates: Iterable[MassEstimate]) -> None:
        self.contradictions: list[str] = []
        made = {(each.item_id, each.t1): each for each in estimates}
        found = []
        for each in verdicts:
            estimate = made.get((each.estimate_id, each.t1))
            mass, zero = (estimate.mass, estimate.zero) if estimate else (math.nan, math.nan)
            weighed = is_weighed(each)
            if weighed and mass != each.mass:
                self.contradictions.append(
                    f'item {each.item_id}: {_grams(each.mass)}, estimate {_grams(mass)}'
                )
            if each.t1 is not None:
                found.append(_Result(each.t1, each.mass if weighed else math.nan, zero))
        self.all = sorted(found)
        self._times = [each.t1 for each in self.all]

    def at(self, t1: int | None) -> _Result | None:
        """Return the first result whose t1 differs from `t1` by at most `SAME_ITEM` ns."""
        if t1 is None:
            return None
        number = bisect_left(self._times, t1 - SAME_ITEM)
        if number == len(self.all) or self._times[number] > t1 + SAME_ITEM:
            return None
        return self.all[number]


class _Again(NamedTuple):
    """Item of the samples, with its recorded result if there is one."""

    estimate: MassEstimate  # estimate with the recorded zero or, if it is unknown, the own zero
    zero: float  # zero in kg by the samples in the bag, relative to the calibration
    zero_std_dev: float  # kg
    known: _Result | None


def _weigh(recording: Recording, parameters: LineParameters, known: _Results) -> Iterator[_Again]:
    """Weigh the items of a recording again, each with its recorded zero."""
    segmenter = Segmenter(recording.load_cell, parameters.segmenter)
    windows = [each for event in join_recording(recording) for each in segmenter.take(event)]
    windows += segmenter.finish()
    results = [known.at(window.t1) for window in windows]
    given = [_with_zero(*pair) for pair in zip(windows, results, strict=True)]
    denoiser, identifier = Denoiser(parameters.denoise), Identifier(parameters.identifier)
    estimates = [
        estimate
        for begin in range(0, len(given), _AT_ONCE)
        for estimate in estimate_masses(given[begin : begin + _AT_ONCE], denoiser, identifier)
    ]
    for window, estimate, result in zip(windows, estimates, results, strict=True):
        zero = (window.zero - window.zero_counts) / window.counts_per_kg
        yield _Again(estimate, zero, window.zero_std_dev / abs(window.counts_per_kg), result)


def _with_zero(window: WeighWindow, known: _Result | None) -> WeighWindow:
    """Return a window with the recorded zero of its item, if it is known."""
    if known is None or math.isnan(known.zero):
        return window
    return replace(window, zero=window.zero_counts + known.zero * window.counts_per_kg)


def _compared(
    again: Sequence[_Again], known: _Results, tolerance: float, begin: int
) -> Iterator[str]:
    """Yield a sentence for each kind of conflict between recorded results and the samples.

    The masses of an item may differ by at most `tolerance` in kg. An item that entered before the
    first sample at the time `begin` in ns need not be in the samples.
    """
    differ, far, without, off = [], [], [], []
    for item in again:
        mass, result = item.estimate.mass, item.known
        if item.estimate.t1 is None or math.isnan(mass):
            continue
        if result is None:
            without.append(f'item {item.estimate.item_id} of the samples: {_grams(mass)}')
            continue
        # The comparison is False if the recorded mass is NaN, which is no conflict.
        if abs(result.mass - mass) > tolerance:
            differ.append(f'{_grams(result.mass)}, weighed again {_grams(mass)}')
        if math.isnan(result.zero):
            continue
        off.append(abs(result.zero - item.zero))
        if off[-1] > _FURTHEST_ZERO * item.zero_std_dev:
            far.append(f'{_grams(result.zero)}, by the samples {_grams(item.zero)}')
    found = {item.known for item in again if not math.isnan(item.estimate.mass)}
    lacking = [
        _grams(each.mass)
        for each in known.all
        if each.t1 >= begin and each not in found and not math.isnan(each.mass)
    ]
    yield from _counted('Masses that are not those of the samples', differ)
    yield from _counted('Zeros that are not those of the samples', far)
    if len(off) >= _FEWEST_ZEROS and median(off) > tolerance:
        yield f'The zeros differ from those of the samples by {_grams(median(off))} (median).'
    yield from _counted('Items of the samples without a verdict', without)
    yield from _counted('Masses without an item in the samples', lacking)


def _counted(what: str, items: Sequence[str]) -> Iterator[str]:
    if items:
        more = ', ...' if len(items) > _MOST else ''
        yield f'{what} ({len(items)}): {"; ".join(items[:_MOST])}{more}.'


def _grams(mass: float) -> str:
    return f'{GRAMS * mass:.3f} g'
