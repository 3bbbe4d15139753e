# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The committed bags: small, remade to the byte, and of the message types that are here."""

from collections import Counter
import filecmp
from pathlib import Path
import re
import subprocess

from ament_index_python.packages import get_package_share_directory
from here import run_here
from mcap.reader import make_reader
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from running import BAGS, ROOT, read_rows
import yaml

NAMES = ('paper_30', 'paper_45', 'paper_60', 'paper_75', 'paper_90')
MAX_SIZE = 5_000_000  # bytes, of all bags


def test_there_is_one_bag_for_each_speed_of_the_paper_and_no_other():
    assert sorted(path.name for path in BAGS.iterdir() if path.is_dir()) == list(NAMES)


def test_bags_are_small():
    assert sum(path.stat().st_size for path in BAGS.rglob('*') if path.is_file()) < MAX_SIZE


def test_each_bag_has_its_provenance():
    text = (BAGS / 'README.md').read_text()
    for name in NAMES:
        assert f'`{name}`' in text


@pytest.mark.parametrize('name', NAMES)
def test_each_mass_is_there_at_least_four_times(name: str, tmp_path: Path):
    assert run_here('weigh', BAGS / name, '--csv', tmp_path / 'masses.csv').returncode == 0
    weighed = read_rows(tmp_path / 'masses.csv')
    counts = Counter(row['reference_g'] for row in weighed)
    assert len(counts) == 5
    assert min(counts.values()) >= 4
    speed = float(name.removeprefix('paper_')) / 60
    assert all(
        float(row['belt_speed_m_per_s']) == pytest.approx(speed, rel=0.01) for row in weighed
    )


def test_remaking_gives_the_same_bytes(tmp_path: Path):
    subprocess.run([BAGS / 'remake', tmp_path / 'bags'], check=True, timeout=600)
    for name in NAMES:
        files = sorted(path.name for path in (BAGS / name).iterdir())
        assert sorted(path.name for path in (tmp_path / 'bags' / name).iterdir()) == files
        _, different, unreadable = filecmp.cmpfiles(
            BAGS / name, tmp_path / 'bags' / name, files, shallow=False
        )
        assert (different, unreadable) == ([], [])


def hashes_of_messages() -> dict[str, str]:
    """Return the type hashes of the .msg files in the source tree."""
    store = get_typestore(Stores.EMPTY)
    needed = [('builtin_interfaces', 'Time'), ('std_msgs', 'Header')]
    for package, name in needed:
        path = Path(get_package_share_directory(package), 'msg', f'{name}.msg')
        store.register(get_types_from_msg(path.read_text(), f'{package}/msg/{name}'))
    hashes = {}
    for path in sorted((ROOT / 'src/checkweigher_msgs/msg').glob('*.msg')):
        message_type = f'checkweigher_msgs/msg/{path.stem}'
        store.register(get_types_from_msg(path.read_text(), message_type))
        hashes[message_type] = store.hash_rihs01(message_type)
    return hashes


@pytest.mark.parametrize('name', NAMES)
def test_type_hashes_are_those_of_the_messages(name: str):
    hashes = hashes_of_messages()
    metadata = yaml.safe_load((BAGS / name / 'metadata.yaml').read_text())
    topics = metadata['rosbag2_bagfile_information']['topics_with_message_count']
    assert len(topics) == 4
    for topic in topics:
        entry = topic['topic_metadata']
        assert entry['type_description_hash'] == hashes[entry['type']], entry['name']
    (path,) = (BAGS / name).glob('*.mcap')
    with path.open('rb') as file:
        summary = make_reader(file).get_summary()
        assert summary is not None
        for channel in summary.channels.values():
            message_type = summary.schemas[channel.schema_id].name
            assert channel.metadata['topic_type_hash'] == hashes[message_type], channel.topic


def test_the_type_hashes_are_those_that_rosidl_generates():
    from checkweigher_msgs import msg

    for message_type, digest in hashes_of_messages().items():
        generated = Path(
            get_package_share_directory('checkweigher_msgs'),
            'msg',
            f'{message_type.rsplit("/", 1)[-1]}.json',
        ).read_text()
        assert hasattr(msg, message_type.rsplit('/', 1)[-1])
        assert re.search(rf'"hash_string":\s*"{digest}"', generated), message_type
