# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The items that wait for the broker."""

import os
from pathlib import Path
import signal
import subprocess
import sys

from checkweigher_gateways.store import Store


def numbers(store: Store) -> list[int]:
    return [number for number, _, _ in store.after(0, 1000)]


def test_an_item_is_kept_once_until_it_was_sent(tmp_path: Path):
    store = Store(tmp_path / 'items.sqlite', 100)
    for key in ('a', 'b', 'a', 'c'):
        store.add(key, 'lane1', key)
    assert [(lane, body) for _, lane, body in store.after(0, 2)] == [('lane1', 'a'), ('lane1', 'b')]
    *_, last = numbers(store)
    store.have_sent(last - 1)
    store.add('a', 'lane1', 'a')
    assert numbers(store) == [last]
    assert store.waiting == 1


def test_the_oldest_items_are_dropped_when_too_many_wait(tmp_path: Path):
    store = Store(tmp_path / 'items.sqlite', 3)
    for key in 'abcde':
        store.add(key, '', key)
    assert [body for *_, body in store.after(0, 9)] == ['c', 'd', 'e']
    assert (store.waiting, store.dropped) == (3, 2)


def test_items_numbers_and_identity_outlast_a_kill(tmp_path: Path):
    path = tmp_path / 'items.sqlite'
    code = (
        'import os, sys, signal; from pathlib import Path;'
        'from checkweigher_gateways.store import Store;'
        'store = Store(Path(sys.argv[1]), 9); store.add("a", "", "a"); store.commit();'
        'print(store.identity, store.next_number("n", 256), flush=True);'
        'os.kill(os.getpid(), signal.SIGKILL)'
    )
    done = subprocess.run([sys.executable, '-c', code, path], capture_output=True, text=True)
    assert done.returncode == -signal.SIGKILL, done.stderr
    store = Store(path, 9)
    assert done.stdout.split() == [store.identity, '0']
    assert (store.next_number('n', 256), store.waiting) == (1, 1)
    assert Store(tmp_path / 'other.sqlite', 9).identity != store.identity
    assert [store.next_number('m', 2) for _ in range(3)] == [0, 1, 0]
    assert os.path.getsize(path) < 1e5
