"""The verdict on each item, and when it is at the rejector."""

from dataclasses import dataclass
import math
from typing import ClassVar

from checkweigher_dsp.parameters import ParameterError, Parameters, parameter
from checkweigher_dsp.records import NANOSECONDS, Decision, MassEstimate, Verdict


@dataclass(frozen=True)
class RejectParameters(Parameters):
    """Limits of the product on the line, and where the rejector stands."""

    node: ClassVar[str] = 'reject'

    lower_limit: float = parameter(
        -math.inf, 'LowerToleranceLimit: lighter is UNDER; -.inf for none', unit='kg'
    )
    upper_limit: float = parameter(
        math.inf, 'UpperToleranceLimit: heavier is OVER; .inf for none', unit='kg'
    )
    rejector_distance: float = parameter(
        0.5, 'from the outfeed eye to the rejector', unit='m', minimum=0, maximum=1000
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        for name, none in (('lower_limit', -math.inf), ('upper_limit', math.inf)):
            value = getattr(self, name)
            if value != none and not (math.isfinite(value) and value >= 0):
                raise ParameterError(
                    f'reject.{name}: {value} is not a mass in kg (or {none} for no limit)'
                )
        if self.lower_limit > self.upper_limit:
            raise ParameterError(
                f'reject.lower_limit: {self.lower_limit} is above upper_limit {self.upper_limit}'
            )


class RejectStage:
    """Judge mass estimates by the limits of the product. What was not weighed is a FAULT.

    Attributes
    ----------
    parameters : RejectParameters
        May be replaced between two items.
    """

    def __init__(self, parameters: RejectParameters) -> None:
        self.parameters = parameters

    def judge(self, estimate: MassEstimate) -> Verdict:
        """Return the verdict on one item."""
        limits = self.parameters
        return Verdict(
            estimate.item_id,
            estimate.t3,
            decide(estimate, limits.lower_limit, limits.upper_limit),
            estimate.reasons,
            estimate.mass,
            estimate.std_dev,
            limits.lower_limit,
            limits.upper_limit,
            self._reject_at(estimate),
        )

    def _reject_at(self, estimate: MassEstimate) -> int | None:
        """Return when the leading edge, at the outfeed eye at t3, is at the rejector, ns."""
        if estimate.t3 is None or not estimate.line_speed > 0:
            return None
        travel = self.parameters.rejector_distance / estimate.line_speed
        return estimate.t3 + round(NANOSECONDS * travel)


def decide(estimate: MassEstimate, lower_limit: float, upper_limit: float) -> Decision:
    """Compare a mass with its limits; both limits belong to the accepted range.

    Parameters
    ----------
    estimate : MassEstimate
        Its mass in kg.
    lower_limit, upper_limit : float
        kg.
    """
    if not estimate.weighed or not math.isfinite(estimate.mass):
        return Decision.FAULT
    if estimate.mass < lower_limit:
        return Decision.UNDER
    if estimate.mass > upper_limit:
        return Decision.OVER
    return Decision.ACCEPT
