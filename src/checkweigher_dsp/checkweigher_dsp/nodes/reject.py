"""The reject node: mass_estimate to verdict."""

from collections.abc import Sequence
from typing import Any

from checkweigher_dsp.nodes import topics
from checkweigher_dsp.nodes.conversion import estimate_from, verdict_to
from checkweigher_dsp.nodes.shell import HeldPublisher, StageNode, run
from checkweigher_dsp.rejection import RejectParameters, RejectStage


class RejectNode(StageNode[RejectParameters]):
    """Judge every item by the limits of the product."""

    def __init__(self, overrides: dict[str, object] | None = None) -> None:
        super().__init__(RejectParameters, overrides=overrides)
        self._verdicts = HeldPublisher(self, topics.VERDICT)
        self._stage = RejectStage(self.parameters)
        self.subscribe(topics.MASS_ESTIMATE, self._on_estimate)

    def on_parameters(self) -> None:
        """Begin to use changed limits."""
        self._stage.parameters = self.parameters

    def _on_estimate(self, message: Any) -> None:
        verdict = self._stage.judge(estimate_from(message))
        self.count(verdict.decision.name)
        self._verdicts.publish(verdict_to(verdict))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the node."""
    run(RejectNode, arguments)


if __name__ == '__main__':
    main()
