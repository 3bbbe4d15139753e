# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Plain texts for the messages of the nodes."""

import re

from checkweigher_web.work.actions import in_grams

# Texts for the user, by a regular expression that matches a part of the message.
_TEXTS = {
    r'no load was read': 'Read the empty belt and a known mass first.',
    r'a load is being read': 'A load is being read: wait until that has ended.',
    r'only the empty belt was read, and several times': (
        'The empty belt was read several times, and no mass: read a known mass, or begin again.'
    ),
    r'first load was read more than': (
        'The first reading is more than an hour old, and the zero drifts: begin again.'
    ),
    r'eye is blocked': 'An eye is covered: clear the belt, and see that both eyes are free.',
    r'eye has switched': 'Something passed an eye: stop the feed, keep clear, and try again.',
    r'did not come to rest': (
        'The load did not come to rest: look for wind, vibration, and what touches the belt.'
    ),
    r'converter is at its limit': (
        'The load cell is overloaded or not connected: take the load off, and check the cable.'
    ),
    r'samples (were|are) lost|no samples': (
        'The load cell sends nothing or with gaps: check its cable and power, and that the line '
        'weighs.'
    ),
    r'driver (is not active|was deactivated)': 'The line does not weigh: press Start first.',
    r'calibration\.file of the driver is empty': (
        'This line keeps no calibration: start it with a folder (run --folder).'
    ),
    r'its data contain the calibration': 'A recording is being played: it cannot be calibrated.',
    r'readings of the masses hardly differ': (
        'The masses read almost the same: do they rest on the belt, and is the load cell connected?'
    ),
    r'two different masses are needed': 'Read the empty belt and at least one known mass.',
    r'no passes': 'Nothing is recorded yet: record passes of a known mass first.',
    r'^busy': 'Another recording, training or verification is running: wait, or end it.',
    r'no learned parameters': 'There is nothing to take over: train first.',
    r'does not run in this lane': 'This line was started without a folder (run --folder).',
    r'not at rest|belt was not empty': (
        'The belt was not empty and at rest: stop the feed, and clear it.'
    ),
}


def in_words(text: str) -> str:
    """Return the text for a message of a node.

    An unknown message is returned with its masses in g instead of kg.
    """
    known = (words for pattern, words in _TEXTS.items() if re.search(pattern, text))
    return next(known, in_grams(text))
