# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tests of places. Only one process on a computer can hold a place."""

import os
import subprocess
import sys

import pytest

from checkweigher_core.parameters import ParameterError
from checkweigher_core.ros.graph.place import Place, is_held

DOMAIN = 1000 + os.getpid()  # a domain that no line uses
# Program that waits for a line on stdin, so that several processes can try at the same time. It
# then holds its place until it ends.
CONTENDER = f"""
import sys
from checkweigher_core.ros.graph.place import Place
print('ready', flush=True)
sys.stdin.readline()
try:
    place = Place({DOMAIN}, '/lane/driver')
    print('holds it', flush=True)
except ValueError as error:
    print(error, flush=True)
sys.stdin.readline()
"""


def test_a_place_is_held_once_and_free_again():
    place = Place(DOMAIN, '/lane1/reject')
    Place(DOMAIN, '/lane2/reject').free()
    Place(DOMAIN + 1, '/lane1/reject').free()
    with pytest.raises(ParameterError, match=f'/lane1/reject runs here already, .* {DOMAIN}'):
        Place(DOMAIN, '/lane1/reject')
    place.free()
    Place(DOMAIN, '/lane1/reject').free()


def test_a_holder_is_known_by_what_it_signs():
    place = Place(DOMAIN, '/lane1/reject')
    place.sign(b'one')
    assert is_held(DOMAIN, '/lane1/reject')
    assert is_held(DOMAIN, '/lane1/reject', b'one')
    assert not is_held(DOMAIN, '/lane1/reject', b'other')
    place.free()
    assert not is_held(DOMAIN, '/lane1/reject')
    assert not is_held(DOMAIN, '/lane1/reject', b'one')


def test_of_many_that_start_at_once_one_holds_the_place():
    pipe = subprocess.PIPE
    contenders = [
        subprocess.Popen([sys.executable, '-c', CONTENDER], stdin=pipe, stdout=pipe, text=True)
        for _ in range(6)
    ]
    try:
        assert [each.stdout.readline() for each in contenders] == ['ready\n'] * 6
        for each in contenders:
            each.stdin.write('\n')
            each.stdin.flush()
        said = [each.stdout.readline() for each in contenders]
        assert said.count('holds it\n') == 1
        contenders[said.index('holds it\n')].kill()
        contenders[said.index('holds it\n')].wait()
        Place(DOMAIN, '/lane/driver').free()  # the kernel has released the place
    finally:
        for each in contenders:
            each.kill()
            each.communicate()
