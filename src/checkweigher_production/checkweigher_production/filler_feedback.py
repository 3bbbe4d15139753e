# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Integral controller of the set point of a filler, with a dead band.

The median mass of a subgroup of items is compared with the target. If the difference exceeds the
dead band, the set point is changed by a fraction of the difference. Some items that were filled
before the change have not reached the scale yet. The next `delay` items are therefore ignored;
otherwise the same difference would be corrected twice.
"""

from dataclasses import dataclass
import math
from statistics import median
from typing import ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, parameter
from checkweigher_core.records import Decision, FillerFeedback, Verdict
from checkweigher_core.records.reasons import Reason


@dataclass(frozen=True)
class FillerParameters(Parameters):
    """Parameters of the controller. A mass is the mass of the contents without packaging.

    Raises `ParameterError` if `max_correction` is not above 0 and finite.
    """

    node: ClassVar[str] = 'filler'

    target: float = parameter(
        0.0, 'target mass of the contents; 0 for the nominal quantity', unit='kg', minimum=0
    )
    subgroup: int = parameter(
        10,
        'number of items whose median mass is compared with the target',
        minimum=1,
        maximum=1_000,
    )
    delay: int = parameter(
        0,
        'number of items between filler and scale, which are ignored after a step',
        minimum=0,
        maximum=10_000,
    )
    gain: float = parameter(
        0.5, 'step as a fraction of the difference from the target', minimum=0, maximum=1
    )
    dead_band: float = parameter(
        0.0, 'largest difference from the target that is not corrected', unit='kg', minimum=0
    )
    max_step: float = parameter(
        math.inf, 'largest magnitude of a step of the set point', unit='kg', minimum=0
    )
    max_correction: float = parameter(
        0.0, 'largest magnitude of the sum of all steps; must be given', unit='kg', minimum=0
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 < self.max_correction < math.inf:
            raise ParameterError(
                f'filler.max_correction: {self.max_correction}, must be above 0 kg and finite'
            )


class FillerController:
    """Controller of one filler for one product.

    `product` is the name of the product, `nominal` is the nominal quantity, and `tare` is the mass
    of the packaging, both in kg. `correction` is the sum of all changes of the set point in kg. The
    initial correction is limited to the range from -`max_correction` to `max_correction`.
    """

    def __init__(
        self,
        parameters: FillerParameters,
        product: str,
        nominal: float,
        tare: float,
        correction: float = 0.0,
    ) -> None:
        self._parameters = parameters
        self._product = product
        self._target = parameters.target or nominal
        self._tare = tare
        self._limit = parameters.max_correction
        self.correction = min(max(correction, -self._limit), self._limit)
        self._masses: list[float] = []
        self._on_the_way = 0

    def add(self, verdict: Verdict) -> FillerFeedback | None:
        """Add an item. Return feedback if the item completes a subgroup, otherwise None.

        Items of a performance test, items with the decision FAULT, items without a valid mass, and
        the `delay` items after a step do not count for the subgroup.
        """
        if Reason.PERFORMANCE_TEST in verdict.reasons:
            return None  # the test product was not filled by the filler
        if self._on_the_way:
            self._on_the_way -= 1
            return None
        # Ignore an item with the decision FAULT, which may have a mass, for example if the metal
        # detector has found metal in the item.
        if verdict.decision != Decision.FAULT and math.isfinite(verdict.mass):
            self._masses.append(verdict.mass - self._tare)
        if len(self._masses) < self._parameters.subgroup:
            return None
        found, items = median(self._masses), len(self._masses)
        self._masses.clear()
        step, limited = self._step(self._target - found)
        self.correction += step
        self._on_the_way = self._parameters.delay if step else 0
        return FillerFeedback(
            stamp=verdict.t3,
            product=self._product,
            item_id=verdict.item_id,
            items=items,
            target=self._target,
            median=found,
            step=step,
            correction=self.correction,
            limited=limited,
        )

    def _step(self, difference: float) -> tuple[float, bool]:
        """Return the change of the set point in kg, and whether a limit has reduced it.

        `difference` is the target minus the median mass of the subgroup in kg. Within the dead
        band, the change is 0.
        """
        known = self._parameters
        if abs(difference) <= known.dead_band:
            return 0.0, False
        wanted = known.gain * difference
        step = min(max(wanted, -known.max_step), known.max_step)
        step = min(max(self.correction + step, -self._limit), self._limit) - self.correction
        return step, step != wanted
