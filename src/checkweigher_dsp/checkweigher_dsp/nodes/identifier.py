# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node identifier, which converts denoised_window to mass_estimate."""

from functools import partial
import time
from typing import Any

from rclpy.callback_groups import ReentrantCallbackGroup
from std_srvs.srv import Trigger

from checkweigher_core import changes
from checkweigher_core.health.findings import Finding
from checkweigher_core.records import WeighWindow
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros import ports
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.health.items import ConvergenceWatch, WorkloadWatch
from checkweigher_dsp.health.learning import describe, learning_finding
from checkweigher_dsp.items.failures import Failures
from checkweigher_dsp.nodes.learned_record import NONE, LearnedRecord


class IdentifierNode(StageNode[IdentifierParameters]):
    """Node that estimates the mass of the item in each denoised window."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        # Create the record first, because `destroy_node` needs it even if a parameter is invalid.
        self._record = LearnedRecord(NONE)
        super().__init__(IdentifierParameters, overrides=overrides)
        self._estimates = self.held_output(ports.MASS_ESTIMATE, ports.VERDICT)
        self._workload = WorkloadWatch()
        self._identifier = Identifier(self.parameters)
        self._audited: dict[tuple[float, float], tuple[bool, str]] = {}
        self._kept: tuple[object, ...] = ()
        self.on_parameters()
        self.subscribe(ports.DENOISED_WINDOW, self._on_window)
        self.create_service(
            Trigger, ports.FORGET_LEARNED, self._on_forget, callback_group=ReentrantCallbackGroup()
        )

    def start(self) -> None:
        """Start to publish diagnostics, and write the learned state to the audit log.

        A learned state that was read from the file is written to the audit log if it is used for
        weighing, or if a change of the machine was detected.
        """
        super().start()
        self._note_learned()

    def destroy_node(self) -> None:
        """Write the learned state to its file, and destroy the node."""
        self._record.close()
        super().destroy_node()

    def on_parameters(self) -> None:
        """Apply changed parameters, and discard the statistics of the masses.

        If learning is on and nothing has been learned yet, the learned state is read from its file
        first.
        """
        known = self._identifier.learned
        if self.parameters.learn and not known.kinds:
            self._record.close()
            wanted = self.parameters.learning.record
            self._record = LearnedRecord(wanted, self.get_fully_qualified_name())
            known = self._record.read() or known
            if self._record.trouble:
                self.warn(self._record.trouble)
        self._identifier = Identifier(self.parameters, known, Failures(self.item_failed))
        # Reset the statistics, because different estimators cannot be compared.
        self._convergence = ConvergenceWatch()

    def _on_window(self, window: WeighWindow) -> None:
        began = time.monotonic()
        estimate = self._identifier.estimate(window)
        now = time.monotonic()
        self._workload.add(began, now)
        self._estimates.send(estimate)
        self.count('weighed' if estimate.weighed else 'faults')
        if not window.reasons:  # The segmenter has already logged the reasons in a window.
            self._convergence.add(now, estimate)
            for reason in estimate.reasons:
                self.warn(f'item {estimate.item_id}: {reason}: {Reason(reason).hint}')
        if self.parameters.learn:
            self._identifier.learn()
            self._note_learned()

    async def _on_forget(self, request: Any, response: Any) -> Any:
        """Delete the learned state, unless the entry in the audit log cannot be written."""
        name = self.get_fully_qualified_name()
        if reason := await self.change_record.write(changes.LEARNED, name, 'forgotten'):
            response.message = f'{reason}: not forgotten'
            return response
        count = len(self._identifier.learned.kinds)
        self._identifier.forget()
        self._audited.clear()
        self._kept = ()
        self._record.write(self._identifier.learned, now=True)
        response.success, response.message = True, f'{count} speeds and lengths forgotten'
        return response

    def _note_learned(self) -> None:
        """Write a changed learned state to its file, and to the audit log if its use has changed.

        The use changes if the learned weights begin or cease to be used for weighing, or if another
        change of the machine is detected.
        """
        known = self._identifier.learned
        kept = tuple(part for each in known.kinds for part in (each.fit, each.change))
        if kept == self._kept:
            return
        self._kept = kept
        self._record.write(known)
        for kind in known.kinds:
            state = kind.weighs, str(kind.change or '')
            if state == self._audited.get((kind.speed, kind.length), (False, '')):
                continue
            self._audited[kind.speed, kind.length] = state
            value = {'speed': kind.speed, 'length': kind.length, 'learned': describe(kind)}
            self.get_logger().info(f'{kind.speed:.3f} m/s: {describe(kind)}')
            if self.executor is not None:
                self.executor.create_task(self._audit(value))

    async def _audit(self, value: dict[str, object]) -> None:
        """Write a change of the learned state to the audit log. A failure is only logged."""
        name = self.get_fully_qualified_name()
        if reason := await self.change_record.write(changes.LEARNED, name, value):
            self.warn(f'change of the learned state: {reason}')

    def diagnose(self, now: float) -> list[Finding]:
        """Return the findings on convergence, computing time and learning."""
        known = self.parameters
        return [
            self._convergence.finding(now, known.max_relative_std_dev),
            self._workload.finding(now),
            learning_finding(
                self._identifier.learned,
                known.learning,
                on=known.learn,
                trouble=self._record.trouble,
            ),
        ]


main = partial(run, IdentifierNode)

if __name__ == '__main__':
    main()
