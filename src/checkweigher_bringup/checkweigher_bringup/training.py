"""Training on passes of known mass in bags, and progress bars for work of minutes."""

from collections.abc import Callable, Sequence
from itertools import chain
from pathlib import Path
from types import TracebackType
from typing import Self

from tqdm import tqdm

from checkweigher_bringup.errors import UserError
from checkweigher_bringup.output import warn_unfinished
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_dsp.segmentation.segmenter import SegmenterParameters
from checkweigher_recording.bags.reading import read_bag
from checkweigher_recording.block_cutting import join_recording
from checkweigher_recording.whole_file import write_whole
from checkweigher_validation.accuracy.passes import KnownPass, group_by_speed, known_passes
from checkweigher_validation.tuning.parameter_file import parameter_file
from checkweigher_validation.tuning.search import BUDGET
from checkweigher_validation.tuning.tuner import tune


def read_passes(
    bags: Sequence[Path], lane: str | None, segmenter: SegmenterParameters
) -> tuple[list[KnownPass], list[str]]:
    """Return the passes of known mass in bags, and a line on each bag.

    Raises
    ------
    UserError
        If a bag has none, or the bags are of different load cells.
    BagError
        If a bag cannot be read.
    """
    passes: list[KnownPass] = []
    lines = []
    rate = None
    for bag in bags:
        recording = read_bag(bag, lane, progress=True)
        warn_unfinished(recording)
        cell = recording.load_cell
        if rate not in (None, cell.sample_rate):
            raise UserError(
                f'{bag}: sampled at {cell.sample_rate:g} Hz, the bags before it at {rate:g} Hz; '
                'bags of one machine belong together'
            )
        rate = cell.sample_rate
        events = chain(recording.references, join_recording(recording))
        found = known_passes(cell, events, segmenter)
        if not found:
            raise UserError(
                f'{bag}: no pass of known mass; the bag needs reference_mass, stamped with t1'
            )
        whole = sum(each.whole for each in found)
        lines.append(
            f'{bag}: {whole} passes of {len({each.mass for each in found})} masses, '
            f'{cell.model} {cell.serial_number}'.rstrip()
        )
        passes += found
    return passes, lines


def train(
    bags: Sequence[Path],
    output: Path,
    estimators: Sequence[str],
    base: LineParameters,
    *,
    budget: int = BUDGET,
    lane: str | None = None,
    jobs: int | None = None,
) -> None:
    """Tune estimators on the passes of known mass in bags, and write the parameter file.

    Parameters
    ----------
    bags : sequence of Path
    output : Path
        The parameter file; one that exists is replaced.
    estimators : sequence of str
        Names; the file selects the first one.
    base : LineParameters
        The parameters that are not tuned.
    budget : int
        Evaluations of each estimator at each speed, at most.
    lane : str or None
        Namespace to take from bags that hold several.
    jobs : int or None
        Processes; None for one on each core.

    Raises
    ------
    BagError, UserError, TuningError, OutputError
        If a bag cannot be read or has too few passes, or the file cannot be written.
    """
    passes, source = read_passes(bags, lane, base.segmenter)
    with ProgressBars() as bars:
        tuned = tune(
            group_by_speed(passes), estimators, base, budget=budget, workers=jobs,
            on_progress=bars.of('tuning'),
        )  # fmt: skip
    text = parameter_file(tuned, source)
    write_whole(output, text)
    comments = (line.removeprefix('# ') for line in text.splitlines() if line.startswith('# '))
    print('\n'.join(line for line in comments if line.split()[0] in ('estimator', *estimators)))


class ProgressBars:
    """One progress bar after the other on a terminal; none where stderr is not a terminal."""

    def __init__(self) -> None:
        self._bar: tqdm[object] | None = None
        self._doing = ''

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._close()

    def of(self, doing: str) -> Callable[[int, int], None]:
        """Return a callback that shows the progress of one piece of work."""
        return lambda done, total: self.show(doing, done, total)

    def show(self, doing: str, done: int, total: int) -> None:
        """Show how many steps of a piece of work are done."""
        if self._bar is None or doing != self._doing:
            self._close()
            self._doing = doing
            self._bar = tqdm(desc=doing, total=total, unit=' steps', leave=False, disable=None)
        self._bar.update(done - self._bar.n)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
