# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Translations of the messages of nodes, and instructions that replace messages."""

import re

from checkweigher_core.records import GRAMS
from checkweigher_web.languages.language import Mass, Text

_MASS = re.compile(r'(-?\d+(?:\.\d+)?) kg\b')
# Instructions for a technician, each by a regular expression that matches a part of the message
# that it replaces.
_TEXTS = {
    r'no load was read': Text('Read the empty belt and a known mass first.'),
    r'a load is being read': Text('A load is being read: wait until that has ended.'),
    r'only the empty belt was read, and several times': Text(
        'The empty belt was read several times, and no mass: read a known mass, or begin again.'
    ),
    r'first load was read more than': Text(
        'The first reading is more than an hour old, and the zero drifts: begin again.'
    ),
    r'eye is blocked': Text('An eye is covered: clear the belt, and see that both eyes are free.'),
    r'eye has switched': Text('Something passed an eye: stop the feed, keep clear, and try again.'),
    r'did not come to rest': Text(
        'The load did not come to rest: look for wind, vibration, and what touches the belt.'
    ),
    r'converter is at its limit': Text(
        'The load cell is overloaded or not connected: take the load off, and check the cable.'
    ),
    r'samples (were|are) lost|no samples': Text(
        'The load cell sends nothing or with gaps: check its cable and power, and that the line '
        'weighs.'
    ),
    r'driver (is not active|was deactivated)': Text('The line does not weigh: press Start first.'),
    r'calibration\.file of the driver is empty': Text(
        'This line keeps no calibration: start it with a folder (run --folder).'
    ),
    r'its data contain the calibration': Text(
        'A recording is being played: it cannot be calibrated.'
    ),
    r'readings of the masses hardly differ': Text(
        'The masses read almost the same: do they rest on the belt, and is the load cell connected?'
    ),
    r'two different masses are needed': Text('Read the empty belt and at least one known mass.'),
    r'no passes': Text('Nothing is recorded yet: record passes of a known mass first.'),
    r'^busy': Text('Another recording, training or verification is running: wait, or end it.'),
    r'no learned parameters': Text('There is nothing to take over: train first.'),
    r'does not run in this lane': Text('This line was started without a folder (run --folder).'),
    r'not at rest|belt was not empty': Text(
        'The belt was not empty and at rest: stop the feed, and clear it.'
    ),
}


# Messages of nodes that can be translated. Masses in these messages are in kg.
_MESSAGES = (
    Text('zeroed at {mass} from the zero of calibration'),
    Text('{count} alarms acknowledged'),
    Text('1 alarm acknowledged'),
    Text('{reason} reset'),
    Text('no stop was requested'),
    Text('silent for {seconds} s; its process hangs or has ended; restart it'),
    Text('has sent no diagnostics; start it in this namespace and ROS_DOMAIN_ID'),
    Text('no diagnostics have come; see whether its nodes run'),
    Text('it was started again while the line ran; look into its log'),
    Text('it ended without being stopped: it was killed, it hung, or power was lost'),
    Text('Leave the belt empty'),
    Text('Leave the belt empty while the line is zeroed'),
    Text('Take off all loads and leave the belt empty'),
    Text('Stop the belt and put {load} on its middle'),
    Text('Run the belt at {speed} m/min and let {load} pass'),
    Text('Run the belt at {speed} m/min and let {load} pass; each pass must be a FAULT'),
    Text('Run the belt at {speed} m/min and let {load} pass, lane {lane}'),
    Text('skipped: {reason}'),
    Text('{name}: passed'),
    Text('{name}: failed'),
    Text('{name}: incomplete'),
    Text('{name}: undecided'),
    Text('the report is being written'),
    Text('the verification ends; its report contains the completed steps'),
    Text('nothing to cancel'),
)


def _pattern(text: Text) -> re.Pattern[str]:
    """Return the regular expression of a message, with a group for each placeholder."""
    groups = re.sub(r'\\{(\w+)\\}', r'(?P<\1>.+?)', re.escape(text.template))
    return re.compile(groups.replace('<mass>.+?)', r'<mass>-?[\d.]+) kg'))


_PATTERNS = {text: _pattern(text) for text in _MESSAGES}


def in_grams(text: str) -> str:
    """Return a text with its masses in kg converted to g."""
    # Adding zero turns -0.0 into 0.0.
    return _MASS.sub(lambda found: f'{GRAMS * float(found[1]) + 0.0:g} g', text)


def in_words(text: str) -> str:
    """Return the instruction for a message if there is one, otherwise the result of `from_node`.

    A message without an instruction or a translation is returned with its masses in g.
    """
    known = (words for pattern, words in _TEXTS.items() if re.search(pattern, text))
    found = next(known, from_node(text))
    return found if isinstance(found, Text) else in_grams(found)


def from_node(text: str) -> str:
    """Return a message of a node as a `Text` if it can be translated, otherwise unchanged."""
    for words, pattern in _PATTERNS.items():
        if not isinstance(text, Text) and (found := pattern.fullmatch(text)):
            values = {k: Mass(v) if k == 'mass' else v for k, v in found.groupdict().items()}
            return Text(words.template, **values)
    return text
