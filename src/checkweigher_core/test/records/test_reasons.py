# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of the reasons: each has its own hint, and is a constant of a message."""

from enum import StrEnum
from typing import Any

from checkweigher_msgs.msg import StopRequest, Verdict
import pytest

from checkweigher_core.records.reasons import Reason, StopReason


def test_every_reason_has_a_hint_of_its_own():
    hints = [reason.hint for reason in (*Reason, *StopReason)]
    assert all(hints)
    assert len(set(hints)) == len(hints)


@pytest.mark.parametrize(
    ('message', 'reasons'),
    [
        (Verdict, list(Reason)),
        # UNKNOWN stands for a reason of another version, so it is not a constant of the message.
        (StopRequest, [reason for reason in StopReason if reason is not StopReason.UNKNOWN]),
    ],
)
def test_the_reasons_are_constants_of_the_message(message: Any, reasons: list[StrEnum]):
    constants = type(message).__prepare__('', ())
    found = {name: value for name, value in constants.items() if isinstance(value, str)}
    assert found == {reason.name: reason.value for reason in reasons}
