# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Layouts of Foxglove and rqt, which show existing topics and fields, and the read-only bridge."""

from ast import literal_eval
from collections.abc import Iterator
import json
import re
from typing import Any

import pytest
from running import ROOT
import yaml

from checkweigher_core.ros import ports

CONFIG = ROOT / 'src/checkweigher_bringup/config'
LAYOUT = json.loads((CONFIG / 'foxglove_layout.json').read_text())
PORTS = {f'/{port.name.lstrip("/")}': port for port in ports.ALL}


def foxglove_paths() -> list[str]:
    """Return the message paths of all panels."""
    found = []
    for panel in LAYOUT['configById'].values():
        found += [each['value'] for each in panel.get('paths', ())]
        found += [panel[key] for key in ('topicPath', 'topicToRender') if key in panel]
    return found


def rqt_fields() -> list[str]:
    """Return topic and field of each curve."""
    groups = json.loads((CONFIG / 'rqt.perspective').read_text())['groups']['pluginmanager']
    running = literal_eval(groups['keys']['running-plugins']['repr'])
    plots = {f'plugin__rqt_plot__Plot__{number}' for number in running['rqt_plot/Plot']}
    assert set(groups['groups']) == plots
    return [
        topic
        for plot in groups['groups'].values()
        for topic in literal_eval(plot['groups']['plugin']['keys']['topics']['repr'])
    ]


def check(topic: str, fields: list[str]) -> None:
    """Check that a topic has a field, which must be an array only if the path has an index."""
    kinds = PORTS[topic].type.get_fields_and_field_types()
    for field in fields:
        name, elements, _ = field.partition('[')
        assert name in kinds, f'{topic}.{field}'
        assert bool(elements) == kinds[name].startswith('sequence<'), f'{topic}.{field}'


@pytest.mark.parametrize('path', foxglove_paths())
def test_a_path_of_the_foxglove_layout_is_a_field_of_a_topic(path: str):
    found = re.fullmatch(r'(/[\w/]+)(\{(\w+)==\d\})?(?:\.([\w[:\]]+))?', path)
    assert found, path
    topic, _, filtered, field = found.groups()
    check(topic, [name for name in (filtered, field) if name])


@pytest.mark.parametrize('name', rqt_fields())
def test_a_curve_of_the_rqt_perspective_is_a_field_of_a_topic(name: str):
    topic, _, field = name.rpartition('/')
    check(topic, [field])


def test_each_panel_has_its_place():
    def places(node: Any) -> Iterator[str]:
        if isinstance(node, str):
            yield node
        else:
            yield from places(node['first'])
            yield from places(node['second'])

    assert sorted(places(LAYOUT['layout'])) == sorted(LAYOUT['configById'])


def test_the_bridge_reads_what_the_layout_shows_and_no_more():
    text = (CONFIG / 'foxglove_bridge.yaml').read_text()
    values = yaml.safe_load(text)['/**']['ros__parameters']
    listed = [re.compile(each) for each in values['topic_whitelist']]

    def is_let_through(name: str) -> bool:
        return any(each.fullmatch(name) for each in listed)

    shown = {re.split(r'[.{]', path)[0] for path in foxglove_paths()}
    for topic in shown:
        assert is_let_through(topic)
        assert is_let_through(f'/hall/lane1{topic}') == (topic != '/diagnostics')
    of_lane = {topic for topic in PORTS if is_let_through(topic)}
    assert shown <= of_lane
    for other in ('/parameter_events', '/rosout', '/load_cell/samples', '/verdicts'):
        assert not is_let_through(other)
    assert values['address'] == '127.0.0.1'
    for name in ('client_topic_whitelist', 'service_whitelist', 'param_whitelist'):
        assert values[name] == ['^$']
    assert values['capabilities'] == ['connectionGraph']
