# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from xml.etree import ElementTree

from checkweigher_core.ros.graph.policy import enclaves, policy, rights
from checkweigher_core.ros.ports import NODES

SHARED = ('/rosout', '/parameter_events', '/diagnostics')


def test_reject_may_judge_and_no_more():
    its = rights('reject', 'lane1')
    assert '/lane1/verdict' in its.publish
    assert '/lane1/mass_estimate' in its.subscribe - its.publish
    assert its.request == {'/lane1/record_change'}
    assert '/lane1/select_product' not in its.reply


def test_each_topic_has_one_maker():
    published = [name for node in NODES for name in rights(node).publish if '*' not in name]
    own = [name for name in published if name not in SHARED]
    assert sorted(own) == sorted(set(own))


def test_who_looks_on_may_publish_and_call_nothing_of_the_line():
    for node in ('status', 'echo', 'record', 'page', 'page_results', 'page_signals'):
        its = rights(node, 'lane1')
        assert its.publish == {'/rosout', '/parameter_events'}
        assert not its.request


def test_lanes_are_apart():
    for node in NODES:
        its = rights(node, 'lane1')
        for name in its.publish | its.subscribe | its.reply | its.request:
            assert name.startswith('/lane1/') or name in SHARED


def test_each_node_has_an_enclave():
    root = ElementTree.fromstring(policy(['lane1', 'lane2']))
    assert root.tag == 'policy'
    assert root.attrib == {'version': '0.2.0'}
    paths = [enclave.attrib['path'] for enclave in root.iter('enclave')]
    assert paths == list(enclaves(['lane1', 'lane2']))
    assert {f'/{lane}/{node}' for lane in ('lane1', 'lane2') for node in NODES} < set(paths)


def test_a_profile_has_what_its_node_may_do():
    root = ElementTree.fromstring(policy(['']))
    (enclave,) = (each for each in root.iter('enclave') if each.attrib['path'] == '/denoise')
    (profile,) = enclave.iter('profile')
    assert profile.attrib == {'ns': '/', 'node': 'denoise'}
    found = {
        (rule, name.text)
        for group in profile
        for rule, allowed in group.attrib.items()
        for name in group
        if allowed == 'ALLOW'
    }
    its = rights('denoise')
    kinds = ('publish', 'subscribe', 'reply', 'request')
    assert found == {(kind, name) for kind in kinds for name in getattr(its, kind)}


def test_who_verifies_reads_zeroes_and_records_and_no_more():
    its = rights('verify', 'lane1')
    assert its.publish == {'/rosout', '/parameter_events', '/lane1/verification'}
    services = {name for name in its.request if name.count('/') == 2}
    assert services == {'/lane1/zero'}
    assert enclaves(['lane1'])['/lane1/verifier'] == [('lane1', 'verifier'), ('lane1', 'verify')]
    assert '/lane1/begin_verification' in rights('verifier', 'lane1').reply


def test_a_technician_at_the_terminal_may_what_the_commands_do():
    its = rights('technician', 'lane1')
    assert {'/lane1/read_load/_action/send_goal', '/lane1/record_change'} < its.request
    assert '/lane1/run_verification/_action/feedback' in its.subscribe
    assert '/lane1/reset_stop_request' not in its.request
    assert enclaves(['lane1'])['/lane1/technician'] == [('lane1', 'technician')]
