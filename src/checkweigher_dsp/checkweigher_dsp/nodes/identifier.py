"""The identifier node: denoised_window to mass_estimate."""

from collections.abc import Sequence
import time
from typing import Any

from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.health.findings import Finding
from checkweigher_dsp.health.items import ConvergenceWatch, WorkloadWatch
from checkweigher_dsp.reasons import Reason
from checkweigher_dsp.ros import ports
from checkweigher_dsp.ros.conversion import estimate_to, window_from
from checkweigher_dsp.ros.held_publisher import HeldPublisher
from checkweigher_dsp.ros.stage_node import StageNode, run


class IdentifierNode(StageNode[IdentifierParameters]):
    """Make a mass of each denoised window."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(IdentifierParameters, overrides=overrides)
        self._estimates = HeldPublisher(self, ports.MASS_ESTIMATE, ports.VERDICT)
        self._workload = WorkloadWatch()
        self.on_parameters()
        self.subscribe(ports.DENOISED_WINDOW, self._on_window)

    def on_parameters(self) -> None:
        """Begin to use a changed estimator."""
        self._identifier = Identifier(self.parameters)
        # What was usual of the estimator before is not of this one.
        self._convergence = ConvergenceWatch()

    def _on_window(self, message: Any) -> None:
        began = time.monotonic()
        window = window_from(message)
        estimate = self._identifier.estimate(window)
        if not window.reasons:  # those the segmenter has told already
            for reason in estimate.reasons:
                self.warn(f'item {estimate.item_id}: {reason}: {Reason(reason).hint}')
        self.count('weighed' if estimate.weighed else 'faults')
        self._estimates.publish(estimate_to(estimate))
        now = time.monotonic()
        self._workload.add(now, now - began)
        if not window.reasons:
            self._convergence.add(now, estimate)

    def diagnose(self, now: float) -> list[Finding]:
        """Return how sure the masses are, and how long they take."""
        limit = self.parameters.max_relative_std_dev
        return [self._convergence.finding(now, limit), self._workload.finding(now)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(IdentifierNode, arguments)


if __name__ == '__main__':
    main()
