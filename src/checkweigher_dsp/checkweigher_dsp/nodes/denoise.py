# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Node denoise, which converts weigh_window to denoised_window."""

from functools import partial
import time

from checkweigher_core.health.findings import Finding
from checkweigher_core.records import WeighWindow
from checkweigher_core.ros import ports
from checkweigher_core.ros.running import run
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.health.items import WorkloadWatch
from checkweigher_dsp.items.failures import Failures


class DenoiseNode(StageNode[DenoiseParameters]):
    """Node that denoises weigh windows by wavelet shrinkage."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(DenoiseParameters, overrides=overrides)
        self._windows = self.held_output(ports.DENOISED_WINDOW, ports.MASS_ESTIMATE)
        self._workload = WorkloadWatch()
        self.on_parameters()
        self.subscribe(ports.WEIGH_WINDOW, self._on_window)

    def on_parameters(self) -> None:
        """Apply changed parameters."""
        self._denoiser = Denoiser(self.parameters, Failures(self.item_failed))

    def _on_window(self, window: WeighWindow) -> None:
        began = time.monotonic()
        denoised = self._denoiser.denoise(window)
        self._workload.add(began, time.monotonic())
        self._windows.send(denoised)

    def diagnose(self, now: float) -> list[Finding]:
        """Return the finding on the computing time of the stage."""
        return [self._workload.finding(now)]


main = partial(run, DenoiseNode)

if __name__ == '__main__':
    main()
