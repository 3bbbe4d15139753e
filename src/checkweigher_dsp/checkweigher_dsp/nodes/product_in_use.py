# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Product of the reject node, with its limits and batch."""

from dataclasses import replace

from checkweigher_core.records import ProductOnLine
from checkweigher_core.ros import ports
from checkweigher_core.ros.stage_node import StageNode
from checkweigher_dsp.rejection.batch_rules import BatchTally
from checkweigher_dsp.rejection.parameters import RejectParameters, limits_of
from checkweigher_dsp.rejection.reject_stage import RejectStage


class ProductInUse:
    """Product of the reject stage, or the limits in the parameters until the line has a product."""

    def __init__(self, node: StageNode[RejectParameters], stage: RejectStage) -> None:
        self._node, self._stage = node, stage
        self._output = node.output(ports.PRODUCT_IN_USE)
        self._shown: ProductOnLine | None = None
        node.subscribe(ports.PRODUCT_ON_LINE, self._on_product)

    def use_parameters(self) -> None:
        """Apply the limits in the parameters, which are valid until the next product arrives."""
        if self._stage.product.stamp:
            self._stage.product = replace(self._stage.product, **limits_of(self._node.parameters))
        self.show()

    def show(self) -> None:
        """Publish the current limits if they have changed."""
        shown = replace(self._stage.product, **BatchTally().counts)
        if shown != self._shown:
            self._shown = shown
            self._output.send(shown)

    def _on_product(self, product: ProductOnLine) -> None:
        """Apply the limits of a product, or only its counts if the product is already in use."""
        node, in_use = self._node, self._stage.product
        if not (node.parameters.needs_product or in_use.stamp):
            node.get_logger().warning(
                'reject.needs_product is false: after a start, the limits of the parameter file '
                'are used until a product arrives'
            )
        if product.stamp == in_use.stamp:
            product = replace(in_use, **BatchTally.of(product).counts)
        else:  # Set the parameters, so that later changes are checked together with these limits.
            node.parameters = replace(node.parameters, **limits_of(product))
        self._stage.product = product
        self.show()
