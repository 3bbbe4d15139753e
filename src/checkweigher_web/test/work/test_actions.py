# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Outcomes of actions, with the messages of the nodes in g."""

import asyncio
from types import SimpleNamespace

import pytest
from rcl_interfaces.msg import ParameterType, ParameterValue

from checkweigher_core.records import ProductOnLine
from checkweigher_web.work import actions
from checkweigher_web.work.actions import MassLimits
from checkweigher_web.work.services import ActionRefusedError


class Services:
    """Services of a lane that answer with a text, or refuse with this text."""

    product = None  # no message has arrived

    def __init__(self, text: str, *, refuse: bool = False) -> None:
        self._text, self._refuse = text, refuse

    async def message(self, name: str) -> str:
        if self._refuse:
            raise ActionRefusedError(self._text)
        return self._text


def zero(text: str, *, refuse: bool = False) -> str:
    return asyncio.run(actions.zero(Services(text, refuse=refuse)))


@pytest.mark.parametrize(
    ('said', 'read'),
    [
        ('zeroed at 0.000066 kg from the zero', 'zeroed at 0.066 g from the zero'),
        ('zeroed at -0.000000 kg from the zero', 'zeroed at 0 g from the zero'),
        ('zeroed at -1.500000 kg', 'zeroed at -1500 g'),
        ('', 'the zero is set'),
    ],
)
def test_the_zero_is_told_in_grams(said: str, read: str):
    assert zero(said) == read


def test_why_there_is_no_zero_is_told_in_grams():
    with pytest.raises(
        ActionRefusedError, match=r'reads 123\.456 g, beyond zero_range 20 g: not zeroed'
    ):
        zero('the belt reads 0.123456 kg, beyond zero_range 0.02 kg: not zeroed', refuse=True)


def test_limits_the_wrong_way_round_are_refused_in_grams():
    with pytest.raises(
        ActionRefusedError, match='lower limit, 200 g, is above the upper one, 100 g'
    ):
        asyncio.run(actions.set_limits(Services('not asked'), MassLimits(0.2, 0.1)))


def test_the_limits_are_those_in_use_and_not_those_of_the_parameters():
    nuts = ProductOnLine(1, 'nuts', lower_limit=0.19)
    assert actions.limits(SimpleNamespace(product=nuts)).lower == 0.19
    with pytest.raises(ActionRefusedError, match='reject has not said its limits yet'):
        actions.limits(SimpleNamespace(product=None))


def test_a_lane_without_audit_log_says_what_makes_one():
    class Product:
        async def call(self, name: str, *, names: list[str]) -> object:
            assert (name, names) == ('product/get_parameters', ['audit_log'])
            value = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value='')
            return SimpleNamespace(values=[value])

    with pytest.raises(ActionRefusedError, match='no audit log: set its parameter audit_log, or'):
        asyncio.run(actions.audit_log(Product()))
