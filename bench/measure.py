# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Measuring cases against a reference in the same run, so that the machine does not matter much.

Reference and case take turns, and each turn gives one ratio, because other programs slow both. The
table shows the median and the middle half of the ratios.
"""

import argparse
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
import os
from pathlib import Path
import statistics
import sys
import time

from figures import aligned, write_json

_TURN = 0.02  # s, that a turn of either side takes at least


@dataclass(frozen=True, slots=True)
class Case:
    """Something to measure.

    Attributes
    ----------
    name : str
        What it is.
    run : callable
        Does it once.
    reference : callable
        Does the same in the way it is compared with, once.
    count : int
        Things that one `run` does.
    reference_count : int
        Things that one `reference` does.
    target : float
        Ratio that is aimed at, 0 for none.
    """

    name: str
    run: Callable[[], object]
    reference: Callable[[], object]
    count: int = 1
    reference_count: int = 1
    target: float = 0.0


@dataclass(frozen=True, slots=True)
class Result:
    """What a case came to.

    Attributes
    ----------
    seconds, reference_seconds : float
        For one thing, median.
    ratio, low, high : float
        How many times faster than the reference: median and quartiles.
    """

    name: str
    seconds: float
    reference_seconds: float
    ratio: float
    low: float
    high: float
    target: float
    repetitions: int


def measure(cases: Sequence[Case], repetitions: int) -> list[Result]:
    """Measure cases in turns, each at least twice."""
    turns = [(_turn(case.run), _turn(case.reference)) for case in cases]
    times: list[list[tuple[float, float]]] = [[] for _ in cases]
    for _ in range(max(repetitions, 2)):
        for case, (loops, reference_loops), taken in zip(cases, turns, times, strict=True):
            reference = _time(case.reference, reference_loops) / case.reference_count
            taken.append((_time(case.run, loops) / case.count, reference))
    return [_result(case, taken) for case, taken in zip(cases, times, strict=True)]


def _turn(run: Callable[[], object]) -> int:
    """Return how many calls make a turn; the first one, which fills caches, is not counted."""
    run()
    return max(1, round(_TURN / max(_time(run, 1), 1e-9)))


def _time(run: Callable[[], object], loops: int) -> float:
    """Return what one call takes, s."""
    begin = time.perf_counter()
    for _ in range(loops):
        run()
    return (time.perf_counter() - begin) / loops


def _result(case: Case, taken: Sequence[tuple[float, float]]) -> Result:
    low, ratio, high = statistics.quantiles([other / own for own, other in taken], n=4)
    return Result(
        case.name,
        statistics.median(own for own, _ in taken),
        statistics.median(other for _, other in taken),
        ratio,
        low,
        high,
        case.target,
        len(taken),
    )


def table(results: Sequence[Result]) -> str:
    """Return the results as lines of text."""
    rows = [('case', 'time', 'reference', 'ratio', 'middle half', 'target', '')]
    for each in results:
        verdict = '' if not each.target else 'met' if each.ratio >= each.target else 'MISSED'
        rows.append(
            (
                each.name,
                _duration(each.seconds),
                _duration(each.reference_seconds),
                f'{each.ratio:.1f}',
                f'{each.low:.1f}-{each.high:.1f}',
                f'{each.target:g}' if each.target else '',
                verdict,
            )
        )
    return aligned(rows, left=(0,))


def _duration(seconds: float) -> str:
    return f'{1e6 * seconds:.0f} us' if seconds < 1e-2 else f'{1e3 * seconds:.1f} ms'


def main(describe: str, make_cases: Callable[[], Sequence[Case]]) -> None:
    """Measure the cases of a module as a command.

    Parameters
    ----------
    describe : str
        What the command measures.
    make_cases : callable
        Makes the cases; not called for ``--help``.
    """
    parser = argparse.ArgumentParser(description=describe)
    parser.add_argument('--repetitions', type=int, default=15, help='turns of each case')
    parser.add_argument('--only', default='', help='cases whose name has this in it')
    parser.add_argument('--json', type=Path, help='file to write the results to')
    arguments = parser.parse_args()
    cases = [case for case in make_cases() if arguments.only in case.name]
    if not cases:
        parser.error(f'no case has {arguments.only!r} in its name')
    results = measure(cases, arguments.repetitions)
    print(table(results))
    if arguments.json:
        cases_found = [asdict(each) for each in results]
        try:
            write_json(arguments.json, load=os.getloadavg()[0], cases=cases_found)
        except OSError as error:
            sys.exit(f'{arguments.json}: cannot be written: {error.strerror}')
