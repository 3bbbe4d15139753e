# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""A locked line: what changes it needs its key; and services that are called too often."""

import asyncio
from pathlib import Path
import time
from typing import Any

from checkweigher_msgs.srv import SelectProduct
from graph import call, wait_for
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
import pytest
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
import rclpy
from rclpy.parameter import Parameter
from running import ROOT
from std_srvs.srv import Trigger

from checkweigher_bringup.line import STAGE_NODES
from checkweigher_bringup.spinning import spinning
from checkweigher_dsp.nodes.product import ProductNode
from checkweigher_dsp.nodes.reject import RejectNode
from checkweigher_dsp.parameters import ParameterError
from checkweigher_dsp.production.recipes import read_recipes
from checkweigher_dsp.ros.access.call_limit import BURST
from checkweigher_dsp.ros.access.key import KEY_FILE, Key, own_key
from checkweigher_dsp.ros.access.permissions import announcement
from checkweigher_dsp.ros.services import SETTER
from checkweigher_web.work.services import LaneServices, RefusedError

RECIPES = ROOT / 'src/checkweigher_bringup/config/recipes.yaml'
DEPTH = 10  # requests that DDS keeps for a service
LOCKED: dict[str, object] = {'locked': True}


@pytest.fixture
def key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Key:
    path = tmp_path / 'key'
    path.write_text('00' * 32)
    path.chmod(0o600)
    monkeypatch.setenv(KEY_FILE, str(path))
    own = own_key()
    assert own is not None
    return own


def limit(value: float) -> list[Any]:
    return [Parameter('upper_limit', value=value).to_parameter_msg()]


def test_a_locked_node_needs_a_key(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.delenv(KEY_FILE, raising=False)
    with spinning(), pytest.raises(ParameterError, match=KEY_FILE):
        RejectNode(LOCKED)


def test_a_limit_is_changed_with_the_key_alone(key: Key):
    with spinning() as spinner:
        reject, other = RejectNode(LOCKED), rclpy.create_node('other')
        spinner.add(reject, other)
        setter = f'reject/{SETTER}'
        before = reject.parameters.upper_limit
        request = SetParametersAtomically.Request(parameters=limit(0.1))

        (answer,) = call(other, SetParameters, 'reject/set_parameters', parameters=limit(9)).results
        assert not answer.successful
        assert 'the line is locked' in answer.reason
        assert not call(
            other, SetParametersAtomically, setter, parameters=limit(9)
        ).result.successful
        assert reject.parameters.upper_limit == before

        signed = announcement(key, f'/{setter}', request).parameters
        changed = [*limit(9.0), signed[-1]]  # the permission of another change
        assert not call(
            other, SetParametersAtomically, setter, parameters=changed
        ).result.successful
        assert reject.parameters.upper_limit == before
        assert call(other, SetParametersAtomically, setter, parameters=signed).result.successful
        assert reject.parameters.upper_limit == 0.1
        again = call(other, SetParametersAtomically, setter, parameters=signed).result
        assert not again.successful
        wait_for(lambda: 'turned away' in finding(reject))


def finding(node: Any) -> str:
    return str(node.diagnostics.connections.finding(time.monotonic()).text)


def test_a_service_of_a_locked_node_is_called_with_the_key_alone(key: Key):
    with spinning() as spinner:
        reject, other = RejectNode(LOCKED), rclpy.create_node('other')
        spinner.add(reject, other)
        refused = call(other, Trigger, 'reset_stop_request')
        assert not refused.success
        assert 'the line is locked' in refused.message
        stop = Transition(id=Transition.TRANSITION_DEACTIVATE)
        assert not call(other, ChangeState, 'reject/change_state', transition=stop).success
        assert reject.state == 'active'

        permit(other, key, '/reset_stop_request', Trigger.Request())
        assert call(other, Trigger, 'reset_stop_request').success
        assert not call(other, Trigger, 'reset_stop_request').success  # it counts once

        asked = ChangeState.Request(transition=stop)
        permit(other, key, '/reject/change_state', asked)
        assert call(other, ChangeState, 'reject/change_state', transition=stop).success
        assert reject.state == 'inactive'


def permit(node: Any, key: Key, service: str, request: Any) -> None:
    signed = announcement(key, service, request).parameters
    answer = call(node, SetParametersAtomically, f'reject/{SETTER}', parameters=signed)
    assert answer.result.successful, answer.result.reason


def test_a_product_is_selected_with_the_key_alone(key: Key, tmp_path: Path):
    with spinning() as spinner:
        stages = [make(LOCKED) for make in STAGE_NODES.values()]
        product = ProductNode(
            {**LOCKED, 'recipes': str(RECIPES), 'audit_log': str(tmp_path / 'audit.log')}
        )
        other = rclpy.create_node('other')
        spinner.add(*stages, product, other)
        reject = next(stage for stage in stages if isinstance(stage, RejectNode))
        name = next(iter(read_recipes(RECIPES)))
        assert not call(other, SelectProduct, 'select_product', product=name).success
        request = SelectProduct.Request(product=name)
        signed = announcement(key, '/select_product', request).parameters
        call(other, SetParametersAtomically, f'product/{SETTER}', parameters=signed)
        # The node product has the key, too: it signs what it sets.
        answer = call(other, SelectProduct, 'select_product', product=name)
        assert answer.success, answer.message
        assert reject.parameters.product == name


def test_the_page_has_the_key(key: Key):
    with spinning() as spinner:
        reject, work = RejectNode(LOCKED), LaneServices('')
        spinner.add(reject, work)
        answer = asyncio.run(work.call('reset_stop_request'))
        assert answer.success
        deactivate = Transition(id=Transition.TRANSITION_DEACTIVATE)
        asyncio.run(work.call('reject/change_state', transition=deactivate))
        assert reject.state == 'inactive'
        given = limit(0.1)
        answer = asyncio.run(work.call(f'reject/{SETTER}', parameters=given))
        assert answer.result.successful, answer.result.reason
        assert reject.parameters.upper_limit == 0.1


def test_a_page_without_the_key_is_refused(key: Key, monkeypatch: pytest.MonkeyPatch):
    with spinning() as spinner:
        reject = RejectNode(LOCKED)
        monkeypatch.delenv(KEY_FILE)
        work = LaneServices('')
        spinner.add(reject, work)
        with pytest.raises(RefusedError, match='the line is locked'):
            asyncio.run(work.call('reset_stop_request'))


def test_a_service_that_is_called_too_often_answers_no_more():
    with spinning() as spinner:
        reject, other = RejectNode(), rclpy.create_node('other')
        spinner.add(reject, other)
        client = other.create_client(Trigger, 'reset_stop_request')
        wait_for(client.service_is_ready)
        messages = []
        for _ in range(4 * BURST // DEPTH):
            answers = [client.call_async(Trigger.Request()) for _ in range(DEPTH)]
            wait_for(lambda a=answers: all(answer.done() for answer in a))
            messages += [answer.result().message for answer in answers]
        assert sum('too often' in message for message in messages) > BURST
        assert 'too often' in finding(reject)
        # The other services of the node do not suffer.
        values = call(other, GetParameters, 'reject/get_parameters', names=['upper_limit']).values
        assert len(values) == 1
