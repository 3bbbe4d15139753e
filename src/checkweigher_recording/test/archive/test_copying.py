# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Bags by URL: found, copied, read and dropped, or one line."""

from collections.abc import Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
import tempfile
import threading

from foreign_bags import same
import fsspec
from lines import write_line
import pytest

from checkweigher_recording.archive.copying import local_bag
from checkweigher_recording.archive.digest import bag_digest
from checkweigher_recording.archive.finding import find_bags
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.reading import read_bag


class Silent(SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def archive(tmp_path: Path, recording, monkeypatch) -> Path:
    """Return a folder with a bag, and have temporary files in one that can be looked into."""
    (tmp_path / 'store/may').mkdir(parents=True)
    write_line(tmp_path / 'store/may/shift1', recording)
    (tmp_path / 'temporary').mkdir()
    monkeypatch.setattr(tempfile, 'tempdir', str(tmp_path / 'temporary'))
    return tmp_path / 'store'


@pytest.fixture
def server(archive: Path) -> Iterator[str]:
    """Have a web server with the folder; return its URL."""
    with ThreadingHTTPServer(('127.0.0.1', 0), partial(Silent, directory=str(archive))) as found:
        thread = threading.Thread(target=found.serve_forever)
        thread.start()
        yield f'http://127.0.0.1:{found.server_address[1]}'
        found.shutdown()
        thread.join()


@pytest.fixture
def urls(archive: Path, server: str) -> dict[str, str]:
    """Return the URLs of the folder by their protocol."""
    memory = fsspec.filesystem('memory')
    if memory.exists('/store'):  # of the test before
        memory.rm('/store', recursive=True)
    memory.put(str(archive), '/store', recursive=True)
    return {'file': f'file://{archive}', 'http': server, 'memory': 'memory://store'}


@pytest.mark.parametrize('protocol', ['file', 'http', 'memory'])
def test_a_bag_is_found_copied_read_and_dropped(urls, archive, recording, protocol):
    (bag,) = find_bags([urls[protocol]])

    assert bag.startswith(f'{protocol}://')
    with local_bag(bag) as copy:
        assert same(read_bag(copy), recording)
        assert bag_digest(copy) == bag_digest(archive / 'may/shift1')
        assert list((archive.parent / 'temporary').iterdir())
    assert not list((archive.parent / 'temporary').iterdir())


@pytest.mark.parametrize('protocol', ['file', 'http'])
def test_a_single_file_is_a_bag(urls, recording, protocol):
    bag = f'{urls[protocol]}/may/shift1/line_0.mcap'

    assert list(find_bags([bag])) == [bag]
    with local_bag(bag) as copy:
        assert same(read_bag(copy), recording)


def test_a_bag_of_this_machine_is_not_copied(archive):
    with local_bag(str(archive / 'may/shift1')) as bag:
        assert bag == archive / 'may/shift1'


@pytest.mark.parametrize('protocol', ['file', 'http', 'memory'])
def test_what_is_not_there_is_one_line(urls, protocol):
    with (
        pytest.raises(BagError, match=r'://.*may/shift7: cannot be read: ') as caught,
        local_bag(f'{urls[protocol]}/may/shift7'),
    ):
        pass
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(
    ('url', 'text'),
    [
        ('nowhere://store/bag', 'nowhere'),
        ('http://127.0.0.1:1/bag', 'annot connect'),
        ('http://127.0.0.1:1/may/line.mcap', r'line\.mcap: .*: .*annot connect'),
        ('{server}/may/line.mcap', 'there is no such file or folder'),
    ],
)
def test_a_store_that_cannot_be_reached_is_one_line(server, url, text):
    url = url.format(server=server)
    with pytest.raises(BagError, match=text) as caught, local_bag(url):
        pass
    assert str(caught.value).startswith(url)
    assert '\n' not in str(caught.value)


def test_a_folder_of_a_store_without_a_bag_is_refused(urls, archive):
    (archive / 'notes').mkdir()
    (archive / 'notes/today.txt').touch()
    bag = f'{urls["http"]}/notes'
    with pytest.raises(BagError, match='notes: no bag in this folder'), local_bag(bag):
        pass


def test_damage_is_told_of_the_url_and_not_of_the_copy(urls, archive):
    file = archive / 'may/shift1/line_0.mcap'
    file.write_bytes(file.read_bytes()[:-100])
    bag = f'{urls["http"]}/may/shift1'

    with pytest.raises(BagError) as caught, local_bag(bag) as copy:
        read_bag(copy)

    assert str(caught.value).startswith(f'{bag}/line_0.mcap: cut off')
    assert str(archive.parent / 'temporary') not in str(caught.value)


def test_a_digest_tells_bags_apart_wherever_they_are(archive, tmp_path):
    whole, moved = archive / 'may/shift1', tmp_path / 'moved'
    digest = bag_digest(whole)
    whole.rename(moved)

    assert bag_digest(moved) == digest
    (moved / 'metadata.yaml').rename(moved / 'metadata.yml')
    assert bag_digest(moved) != digest
    (moved / 'metadata.yml').rename(moved / 'metadata.yaml')
    data = bytearray((moved / 'line_0.mcap').read_bytes())
    data[len(data) // 2] ^= 1
    (moved / 'line_0.mcap').write_bytes(data)
    assert bag_digest(moved) != digest
