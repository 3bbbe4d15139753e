"""The stages in one loop: what the graph does, without the graph."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import Future
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self, cast

from checkweigher_dsp.denoising.denoiser import DenoiseParameters
from checkweigher_dsp.estimation.identifier import IdentifierParameters
from checkweigher_dsp.parameters import ParameterError, Parameters, read_parameter_file
from checkweigher_dsp.pipeline.mass_stages import MassStages, estimate_all
from checkweigher_dsp.pipeline.side_processes import ALONE, SideProcesses
from checkweigher_dsp.records import (
    EyeEdge,
    LoadCell,
    MassEstimate,
    SampleBlock,
    Verdict,
    WeighWindow,
)
from checkweigher_dsp.rejection.parameters import SHARED_WITH_SEGMENTER, RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.segmentation.segmenter import Segmenter, SegmenterParameters

# Nodes that a parameter file for the line may address as well, but that are no stages.
_OTHER_NODES = ('product', 'driver', 'dynamic_setting')


@dataclass(frozen=True)
class LineParameters:
    """Parameters of all stages."""

    segmenter: SegmenterParameters = SegmenterParameters()
    denoise: DenoiseParameters = DenoiseParameters()
    identifier: IdentifierParameters = IdentifierParameters()
    reject: RejectParameters = RejectParameters()

    @classmethod
    def from_file(cls, path: Path, lane: str | None = None) -> Self:
        """Read the parameters of the stages from a ROS parameter file.

        Parameters
        ----------
        path : Path
            The file.
        lane : str, optional
            Namespace of the line, where the file addresses several.

        Raises
        ------
        ParameterError
            If the file cannot be read or a value in it cannot be used; nothing is then taken.
        """
        sets = {entry.name: cast(type[Parameters], entry.type) for entry in fields(cls)}
        values = read_parameter_file(path, sets, _OTHER_NODES, lane)
        try:
            _share(values)
            made = {node: sets[node].from_mapping(values[node]) for node in sets}
            return cls(**cast(dict[str, Any], made))
        except ParameterError as error:
            raise ParameterError(f'{path}: {error}') from None

    def with_values(self, changes: Mapping[str, object]) -> Self:
        """Return the same parameters but for some, named as in ``denoise.stretch``.

        Raises
        ------
        ParameterError
            If a parameter does not exist or a value cannot be used.
        """
        nodes = [entry.name for entry in fields(self)]
        by_node: dict[str, dict[str, object]] = {}
        for name, value in changes.items():
            node, _, rest = name.partition('.')
            if node not in nodes:
                raise ParameterError(f'{name!r} addresses none of {", ".join(nodes)}')
            by_node.setdefault(node, {})[rest] = value
        _share(by_node)
        made = {}
        for node, values in by_node.items():
            own: Parameters = getattr(self, node)
            made[node] = own.from_mapping({**own.as_mapping(), **values})
        return replace(self, **cast(dict[str, Any], made))

    def with_estimator(self, name: str) -> Self:
        """Return the same parameters with another estimator."""
        return replace(self, identifier=replace(self.identifier, estimator=name))


def _share(values: dict[str, dict[str, object]]) -> None:
    """Have the reject stage find the same items as the segmenter.

    Raises
    ------
    ParameterError
        If both are given a value and the two differ.
    """
    of_segmenter = values.get('segmenter', {})
    for name in SHARED_WITH_SEGMENTER:
        if name not in of_segmenter:
            continue
        own = values.setdefault('reject', {}).setdefault(name, of_segmenter[name])
        if own != of_segmenter[name]:
            raise ParameterError(
                f'reject.{name}: {own} is not the {of_segmenter[name]} of segmenter; the two count '
                'the same items'
            )


@dataclass(frozen=True, slots=True)
class Weighing:
    """What became of one item."""

    estimate: MassEstimate
    verdict: Verdict


class WeighingLine:
    """Run segmenter, denoise, identifier and reject one after the other.

    The nodes call the same stages with the same values, so both ways give the same masses to the
    last bit.

    Parameters
    ----------
    load_cell : LoadCell
        Calibration, rate and the distance between the eyes.
    parameters : LineParameters
        Of all stages.
    """

    def __init__(self, load_cell: LoadCell, parameters: LineParameters) -> None:
        self._segmenter = Segmenter(load_cell, parameters.segmenter)
        self._stages = MassStages(parameters.denoise, parameters.identifier)
        self._reject_stage = RejectStage(parameters.reject, load_cell.weigh_length)

    def add(self, event: SampleBlock | EyeEdge) -> list[Weighing]:
        """Take a block or an edge and return the items that it completes."""
        if isinstance(event, SampleBlock):
            return self._weigh(self._segmenter.add_samples(event))
        self._reject_stage.add_edge(event)  # gives no verdict: no time runs here
        return self._weigh(self._segmenter.add_edge(event))

    def finish(self) -> list[Weighing]:
        """Return what is still on the belt, as faults: the stream has ended."""
        return self._weigh(self._segmenter.finish())

    def weigh_all(
        self, events: Iterable[SampleBlock | EyeEdge], processes: SideProcesses = ALONE
    ) -> list[Weighing]:
        """Return what `add` makes of events one after the other and `finish` of their end.

        To the last bit, but in less time: the windows are denoised and identified many at once,
        and by the processes beside this one, if there are any, while it goes on to cut windows.
        For a line on which nothing has been added yet.
        """
        batches: deque[_Batch] = deque()
        # What the reject stage is to meet, in this order: edges, and windows as they are complete.
        steps: list[EyeEdge | WeighWindow] = []
        weighings: list[Weighing] = []
        for event in events:
            if isinstance(event, SampleBlock):
                steps += self._segmenter.add_samples(event)
            else:
                steps.append(event)
                steps += self._segmenter.add_edge(event)
            if len(steps) >= _STEPS_AT_ONCE:
                free = sum(not batch.done for batch in batches) < _AHEAD * processes.count
                batches.append(self._begin(steps, processes if free else ALONE))
                steps = []
                # Judging waits: the others are to have their windows first, and at the end there
                # is something to do until they are ready.
                if len(batches) > _KEPT:
                    weighings += self._judge_batch(batches.popleft())
        steps += self._segmenter.finish()
        for batch in (*batches, self._begin(steps, ALONE)):
            weighings += self._judge_batch(batch)
        return weighings

    def _begin(self, steps: list[EyeEdge | WeighWindow], processes: SideProcesses) -> '_Batch':
        """Have the windows among some steps weighed: at once, or beside this process."""
        windows = [step for step in steps if isinstance(step, WeighWindow)]
        if not processes.count:
            return _Batch(steps, self._stages.estimate_all(windows))
        return _Batch(steps, [], processes.submit(estimate_all, *self._stages.parameters, windows))

    def _judge_batch(self, batch: '_Batch') -> list[Weighing]:
        found = batch.estimates
        if batch.call is not None:
            try:
                found = batch.call.result()
            # A window that is the reason fails here as well, a process that was killed does not.
            except Exception:
                windows = [step for step in batch.steps if isinstance(step, WeighWindow)]
                found = self._stages.estimate_all(windows)
        estimates = iter(found)
        weighings = []
        for step in batch.steps:
            if isinstance(step, EyeEdge):
                self._reject_stage.add_edge(step)  # gives no verdict: no time runs here
            else:
                weighings += self._judge(next(estimates))
        return weighings

    def _weigh(self, windows: list[WeighWindow]) -> list[Weighing]:
        return [
            weighing
            for window in windows
            for weighing in self._judge(self._stages.estimate(window))
        ]

    def _judge(self, estimate: MassEstimate) -> list[Weighing]:
        verdicts = self._reject_stage.add_estimate(estimate)
        return [Weighing(estimate, verdict) for verdict in verdicts]


# Edges and windows that `weigh_all` collects: what is kept of a long recording stays bounded.
_STEPS_AT_ONCE = 1500
# Batches that each process beside this one has before it; what is more is done in this one. In
# the end it takes about as long to judge all as the others need for so many.
_AHEAD = 4
_KEPT = 16  # batches that are not judged yet


@dataclass(frozen=True, slots=True)
class _Batch:
    """Steps of the reject stage, and the estimates of the windows among them or their call."""

    steps: Sequence[EyeEdge | WeighWindow]
    estimates: list[MassEstimate]
    call: Future[list[MassEstimate]] | None = None

    @property
    def done(self) -> bool:
        return self.call is None or self.call.done()
