# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags in folders, and the names of their results."""

from pathlib import Path

import pytest

from checkweigher_recording.archive.finding import find_bags, result_names
from checkweigher_recording.bags.definitions import BagError


@pytest.fixture
def archive(tmp_path: Path) -> Path:
    """Return a folder with four bags, and with what is none."""
    for name in ('a/shift2', 'a/shift1', 'a/deep/er/lane', 'b', '.hidden/bag', 'notes'):
        (tmp_path / name).mkdir(parents=True)
    for name in ('a/shift2', 'a/deep/er/lane', '.hidden/bag'):
        (tmp_path / name / 'metadata.yaml').touch()
    (tmp_path / 'a/shift1/broken_off_0.mcap').touch()
    (tmp_path / 'a/shift1/below').mkdir()
    (tmp_path / 'a/shift1/below/metadata.yaml').touch()
    (tmp_path / 'b/metadata.yaml').touch()
    (tmp_path / 'notes/today.txt').touch()
    return tmp_path


def relative(bags, folder):
    return [str(Path(bag).relative_to(folder)) for bag in bags]


def test_folders_are_searched_in_the_order_of_their_names(archive):
    found = relative(find_bags([str(archive)]), archive)
    assert found == ['a/deep/er/lane', 'a/shift1', 'a/shift2', 'b']


def test_each_bag_is_there_once(archive):
    places = [archive / 'b', archive / 'a', archive]
    found = relative(find_bags(map(str, places)), archive)
    assert found == ['b', 'a/deep/er/lane', 'a/shift1', 'a/shift2']


def test_what_is_no_folder_is_returned_as_it_is(archive):
    places = [str(archive / 'none'), str(archive / 'notes/today.txt'), 'line.mcap']
    assert find_bags(places) == places


def test_a_folder_without_a_bag_is_refused(archive):
    with pytest.raises(BagError, match='notes: no bag in this folder'):
        find_bags([str(archive), str(archive / 'notes')])


def test_bags_of_a_url_are_found_as_those_of_a_path(archive):
    found = find_bags([f'file://{archive}'])
    assert found == [f'file://{bag}' for bag in find_bags([str(archive)])]


def test_names_are_places_below_the_folder_that_all_share():
    names = result_names(['2026/may/shift1', '2026/may/shift2', '2026/june/shift1'])
    assert list(names.values()) == ['may/shift1', 'may/shift2', 'june/shift1']
    assert result_names(['bags/paper_60']) == {'bags/paper_60': 'paper_60'}


def test_names_differ_where_bags_do():
    bags = ['a/b', 'a_b', 'a', 's3://bucket/a', 's3://bucket/a/b', 'a/b.mcap']
    assert len(set(result_names(bags).values())) == len(bags)
