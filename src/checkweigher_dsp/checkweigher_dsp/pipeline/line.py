# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Offline line, which runs all stages in one loop with the same results as the nodes."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Self, cast

from checkweigher_core.parameters import ParameterError, Parameters, by_node, in_section
from checkweigher_core.records import (
    EyeEdge,
    Item,
    LoadCell,
    MassEstimate,
    SampleBlock,
    Verdict,
    WeighWindow,
)
from checkweigher_core.yaml_files import opened
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.rejection.parameters import RejectParameters
from checkweigher_dsp.rejection.reject_stage import RejectStage
from checkweigher_dsp.segmentation.parameters import SegmenterParameters
from checkweigher_dsp.segmentation.segmenter import Segmenter

# Other nodes whose parameters may be in a parameter file of the line.
_OTHER_NODES = ('product', 'driver', 'dynamic_setting', 'verifier')


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

        `lane` is the namespace of the line, if the file contains several lines.

        Raises
        ------
        ParameterError
            If the file cannot be read or a value is not valid.
        """
        sets = {entry.name: cast(type[Parameters], entry.type) for entry in fields(cls)}
        with opened(path) as sections:
            values = by_node(sections, sets, _OTHER_NODES, lane)
            try:
                made = {node: sets[node].from_mapping(values[node]) for node in sets}
                return cls(**cast(dict[str, Any], made))
            except ParameterError as error:
                raise in_section(error, sections) from None

    def with_values(self, changes: Mapping[str, object]) -> Self:
        """Return a copy with the values in `changes`, by names such as ``denoise.stretch``.

        Raises
        ------
        ParameterError
            If a parameter does not exist or a value is not valid.
        """
        stages: dict[str, Parameters] = vars(self)
        given: dict[str, dict[str, object]] = {}
        for name, value in changes.items():
            node, _, rest = name.partition('.')
            if node not in stages:
                raise ParameterError(f'{name!r} addresses none of {", ".join(stages)}')
            given.setdefault(node, stages[node].as_mapping())[rest] = value
        made: dict[str, Any] = {n: stages[n].from_mapping(values) for n, values in given.items()}
        return replace(self, **made)

    def with_estimator(self, name: str) -> Self:
        """Return a copy that uses the estimator `name`.

        Raises
        ------
        ParameterError
            If there is no such estimator, or a Python package that it needs is missing.
        """
        return replace(self, identifier=replace(self.identifier, estimator=name))


@dataclass(frozen=True, slots=True)
class Weighing:
    """Estimate and verdict of an item, with its window if the window was cut in this process."""

    estimate: MassEstimate
    verdict: Verdict
    window: WeighWindow | None = None


class WeighingLine:
    """Line of the four stages, from samples and edges to verdicts.

    The nodes call the same stages with the same values, so their masses are equal to the masses of
    this line to the last bit. Raises `ParameterError` if the windows need too many samples at the
    sample rate of the load cell.
    """

    def __init__(self, load_cell: LoadCell, parameters: LineParameters) -> None:
        self._segmenter = Segmenter(load_cell, parameters.segmenter)
        self._denoiser = Denoiser(parameters.denoise)
        self._identifier = Identifier(parameters.identifier)
        self._reject_stage = RejectStage(parameters.reject, load_cell.weigh_length)

    def add(self, event: SampleBlock | EyeEdge) -> list[Weighing]:
        """Process a block of samples or an edge, and return the completed items."""
        return self._judge(self._with_announced(self._segmenter.take(event)))

    def finish(self) -> list[Weighing]:
        """End the stream, and return the remaining items.

        The items that are still on the belt, or whose samples have not arrived, are faults.
        """
        return self._judge(self._with_announced(self._segmenter.finish()))

    def weigh_all(self, events: Iterable[SampleBlock | EyeEdge]) -> Iterator[Weighing]:
        """Yield the items of a whole stream, with the same results as `add` but faster."""
        steps: list[Item | WeighWindow] = []
        samples = 0
        for event in events:
            windows = self._segmenter.take(event)
            steps += self._with_announced(windows)
            samples += sum(len(window.counts) for window in windows)
            if len(steps) >= _STEPS_AT_ONCE or samples >= _SAMPLES_AT_ONCE:
                yield from self._judge(steps)
                steps, samples = [], 0
        yield from self._judge(steps)
        yield from self.finish()

    def _with_announced(self, windows: list[WeighWindow]) -> list[Item | WeighWindow]:
        return [*self._segmenter.take_announced(), *windows]

    def _judge(self, steps: Sequence[Item | WeighWindow]) -> list[Weighing]:
        windows = [step for step in steps if isinstance(step, WeighWindow)]
        estimates = iter(estimate_masses(windows, self._denoiser, self._identifier))
        weighings = []
        for step in steps:
            if isinstance(step, Item):
                # Ignore the result, because without a clock an announcement causes no verdict.
                self._reject_stage.take(step)
            else:
                estimate = next(estimates)
                verdicts = self._reject_stage.take(estimate)
                weighings += [Weighing(estimate, verdict, step) for verdict in verdicts]
        return weighings


def estimate_masses(
    windows: Sequence[WeighWindow], denoiser: Denoiser, identifier: Identifier
) -> list[MassEstimate]:
    """Return the estimate of each window, which is denoised first if the estimator requires it."""
    if identifier.needs_denoised:
        windows = denoiser.denoise_all(windows)
    return identifier.estimate_all(windows)


# Largest numbers of records and samples that `weigh_all` collects, to limit the memory.
_STEPS_AT_ONCE = 1500
_SAMPLES_AT_ONCE = 2**20
