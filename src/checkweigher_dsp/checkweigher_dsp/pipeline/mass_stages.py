"""The stages between window and estimate, all that other processes need of a line."""

from collections.abc import Sequence
from functools import lru_cache

from checkweigher_dsp.denoising.denoiser import DenoiseParameters, Denoiser
from checkweigher_dsp.estimation.identifier import Identifier, IdentifierParameters
from checkweigher_dsp.records import MassEstimate, WeighWindow


class MassStages:
    """Denoise and identifier: what they make of a window depends on no other one.

    Attributes
    ----------
    parameters : (DenoiseParameters, IdentifierParameters)
        Of the two.
    """

    def __init__(self, denoise: DenoiseParameters, identifier: IdentifierParameters) -> None:
        self.parameters = denoise, identifier
        self._denoiser = Denoiser(denoise)
        self._identifier = Identifier(identifier)

    def estimate(self, window: WeighWindow) -> MassEstimate:
        """Return the estimate of a window."""
        if self._identifier.needs_denoised:
            window = self._denoiser.denoise(window)
        return self._identifier.estimate(window)

    def estimate_all(self, windows: Sequence[WeighWindow]) -> list[MassEstimate]:
        """Return what `estimate` makes of each window, to the last bit, in much less time."""
        if self._identifier.needs_denoised:
            windows = self._denoiser.denoise_all(windows)
        return self._identifier.estimate_all(windows)


def estimate_all(
    denoise: DenoiseParameters, identifier: IdentifierParameters, windows: Sequence[WeighWindow]
) -> list[MassEstimate]:
    """Return the estimates of windows, in a process beside that of the line."""
    return _kept_stages(denoise, identifier).estimate_all(windows)


_kept_stages = lru_cache(maxsize=1)(MassStages)
