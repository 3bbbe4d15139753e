# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The identifier node: denoised_window to mass_estimate."""

from functools import partial
import time

from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.health.items import ConvergenceWatch, WorkloadWatch
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.records import WeighWindow, foreign
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.running import run
from checkweigher_dsp.ros.stage_node import StageNode


class IdentifierNode(StageNode[IdentifierParameters]):
    """Make a mass of each denoised window."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(IdentifierParameters, overrides=overrides)
        self._estimates = self.held_output(ports.MASS_ESTIMATE, ports.VERDICT)
        self._workload = WorkloadWatch()
        self.on_parameters()
        self.subscribe(ports.DENOISED_WINDOW, self._on_window, doubted=foreign)

    def on_parameters(self) -> None:
        """Begin to use a changed estimator."""
        self._identifier = Identifier(self.parameters)
        # What was usual of the estimator before is not of this one.
        self._convergence = ConvergenceWatch()

    def _on_window(self, window: WeighWindow) -> None:
        began = time.monotonic()
        estimate = self._identifier.estimate(window)
        now = time.monotonic()
        self._workload.add(now, now - began)
        self._estimates.send(estimate)
        self.count('weighed' if estimate.weighed else 'faults')
        if not window.reasons:  # those the segmenter has told already
            self._convergence.add(now, estimate)
            for reason in estimate.reasons:
                self.warn(f'item {estimate.item_id}: {reason}: {Reason(reason).hint}')

    def diagnose(self, now: float) -> list[Finding]:
        """Return how sure the masses are, and how long they take."""
        limit = self.parameters.max_relative_std_dev
        return [self._convergence.finding(now, limit), self._workload.finding(now)]


main = partial(run, IdentifierNode)

if __name__ == '__main__':
    main()
