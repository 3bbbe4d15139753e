# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags in the readers of Foxglove, with which its app opens them."""

import json
from pathlib import Path
import shutil
import subprocess

import pytest
from running import BAGS, ROOT

from checkweigher_core.records import NANOSECONDS
from checkweigher_recording.bags.reading import read_bag

PACKAGES = (
    '@mcap/core', '@mcap/nodejs', '@mcap/support', '@foxglove/rosmsg',
    '@foxglove/rosmsg2-serialization',
)  # fmt: skip


def _are_installed() -> bool:
    needed = ''.join(f'require.resolve({name!r});' for name in PACKAGES)
    node = shutil.which('node')
    return (
        node is not None
        and not subprocess.run([node, '-e', needed], capture_output=True).returncode
    )


@pytest.mark.skipif(not _are_installed(), reason='NODE_PATH lacks the readers of Foxglove')
@pytest.mark.parametrize('made_now', [True, False])
def test_a_bag_opens_there_by_its_own_definitions(bag: Path, made_now: bool):
    folder = bag if made_now else BAGS / 'paper_60'
    (file,) = folder.glob('*.mcap')
    program = ROOT / 'test/support/mcap_reader.js'
    done = subprocess.run(['node', program, file], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    recording = read_bag(folder)
    (info,) = found['/load_cell/info']
    assert info['sample_rate'] == recording.load_cell.sample_rate
    blocks = [(_stamp(each), each['counts']) for each in found['/load_cell/samples']]
    assert blocks == [(each.stamp, each.counts.tolist()) for each in recording.blocks]
    edges = [(_stamp(each), each['eye'], each['blocked']) for each in found['/photo_eyes']]
    assert edges == [(each.stamp, each.eye, each.blocked) for each in recording.edges]
    masses = [each['mass'] for each in found['/reference_mass']]
    assert masses == [each.mass for each in recording.references]


def _stamp(message: dict[str, dict[str, dict[str, int]]]) -> int:
    stamp = message['header']['stamp']
    return stamp['sec'] * NANOSECONDS + stamp['nanosec']
