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
    assert list(find_bags(places)) == places


def test_a_place_without_a_bag_does_not_take_the_others_with_it(archive):
    places = [str(archive / 'notes'), 'http://127.0.0.1:1/', 'nowhere://x', str(archive / 'b')]
    assert list(find_bags(places)) == places


@pytest.mark.parametrize(
    ('place', 'text'),
    [('notes', 'notes: no bag in this folder'), ('closed', 'closed: cannot be read: ')],
)
def test_no_place_with_a_bag_is_an_error(archive, monkeypatch, place, text):
    def listed(folder):
        if Path(folder).name == 'closed':
            raise PermissionError(13, 'Permission denied')
        return ['today.txt']

    (archive / 'closed').mkdir()
    monkeypatch.setattr('os.listdir', listed)
    with pytest.raises(BagError, match=text):
        find_bags([str(archive / place)])


def test_spellings_of_a_bag_are_one_bag(archive, monkeypatch):
    monkeypatch.chdir(archive)
    (archive / 'link').symlink_to(archive / 'b')
    (archive / 'folder').symlink_to(archive / 'a')
    spellings = ['b', './b/', str(archive / 'b'), 'link', f'file://{archive}/b', 'a/../b']
    assert find_bags(spellings) == {'b': 'b'}
    assert len(find_bags(['a', 'folder', str(archive)])) == 4


def test_bags_of_a_url_are_found_as_those_of_a_path(archive):
    found = find_bags([f'file://{archive}'])
    assert list(found) == [f'file://{bag}' for bag in find_bags([str(archive)])]


def names_of(*places):
    return list(result_names(find_bags(map(str, places))).values())


def test_names_stay_when_bags_and_places_are_added(archive, monkeypatch):
    monkeypatch.chdir(archive)
    before = names_of('b')
    assert (before, names_of('a/deep')) == (['b'], ['deep/er/lane'])

    (archive / 'a/deep/more').mkdir()
    (archive / 'a/deep/more/metadata.yaml').touch()

    assert names_of('a/deep', archive / 'b') == ['deep/er/lane', 'deep/more', 'b']
    top = archive.name
    assert names_of('.') == names_of(archive) == names_of(f'file://{archive}')
    assert names_of('.')[0] == f'{top}/a/deep/er/lane'


def test_bags_of_places_with_the_same_name_have_folders_above_in_their_names():
    found = {each: each for each in ('x/may/bag', 'x/june/bag', 'other')}
    assert list(result_names(found).values()) == [
        'may/bag',
        'june/bag',
        result_names(found)['other'],
    ]
    assert result_names({'bags/paper_60': 'bags/paper_60'}) == {'bags/paper_60': 'paper_60'}
    assert result_names({'/bag': '/'}) == {'/bag': 'bag'}


def test_names_differ_where_bags_do():
    bags = ['a/b', 'a_b', 'a', 's3://bucket/a', 's3://bucket/a/b', 'a/b.mcap', '/a/b', '/b']
    assert len(set(result_names({bag: bag for bag in bags}).values())) == len(bags)


def test_bags_that_no_name_tells_apart_are_refused():
    with pytest.raises(BagError, match='weigh the bags one by one'):
        result_names({bag: bag for bag in ('http://host/a/b', 'http://host/a/./b')})
