# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table of the steps on the commissioning page."""

from checkweigher_web.commissioning.dynamic import DynamicStep
from checkweigher_web.commissioning.limits import LimitsStep
from checkweigher_web.commissioning.static import StaticStep
from checkweigher_web.commissioning.step import Step
from checkweigher_web.commissioning.verify import VerifyStep
from checkweigher_web.commissioning.zero import ZeroStep

# Steps in the order of the page.
STEPS: tuple[type[Step], ...] = (ZeroStep, StaticStep, DynamicStep, LimitsStep, VerifyStep)
