# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Translations of the messages of nodes, and instructions that replace messages."""

from collections.abc import Iterable
import math
import re

from checkweigher_core.records import GRAMS
from checkweigher_web.languages.findings import HINTS, REASONS, TEXTS
from checkweigher_web.languages.language import Mass, Number, Text

_MASS = re.compile(r'(-?\d+(?:\.\d+)?) kg\b')
_NUMBER = re.compile(r'[-+]?\d+\.\d+')
# Instructions for a technician, by regular expressions for messages. An instruction replaces each
# message in which its regular expression finds a match.
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


# Messages of nodes that can be translated, besides their findings.
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
    Text('{word} ({mass})'),  # name and mass of a load
    Text('Leave the belt empty'),
    Text('Leave the belt empty while the line is zeroed'),
    Text('Take off all loads and leave the belt empty'),
    Text('Stop the belt and put {load} on its middle'),
    Text('Run the belt at {speed} m/min'),
    Text(
        'Run the belt at {speed} m/min and let one product pass, because the first one after a '
        'change of speed is a FAULT'
    ),
    Text('{belt}; once the step has begun, let {load} pass'),
    Text('{belt}; once the step has begun, let {load} pass; each of these passes must be a FAULT'),
    Text('{belt}; once the step has begun, let {load} pass, lane {lane}'),
    Text('{done_count} of {count} passes: {mass}, {error_mass}'),
    Text('{done_count} of {count} passes: no mass, {reasons}'),
    # Departures of a verification plan from the rules
    Text('The plan has no test of {name}.'),
    Text('zero'),
    Text('eccentricity'),
    Text('range of dynamic setting'),
    Text('repeatability'),
    Text('loads at rest'),
    Text('Step {name} has {count} weighings, {required_count} are required.'),
    Text('The warm-up is read at {minutes} min, not at 0, 5, 15 and 30 min.'),
    Text('No load {where} is close to Min, {mass}.'),
    Text('No load {where} is close to Max, {mass}.'),
    Text('in motion'),
    Text('at rest'),
    Text('The eccentricity load is {percent} % of Max, not about a third.'),
    Text(
        'Reference {name} has an uncertainty of {mass} (k = 2), above a third of the limit, '
        '{limit_mass}.'
    ),
    Text('The line has {device}, but the plan has load cell {cell} and amplifier {amplifier}.'),
    Text('a device without a serial number'),
    # Further departures of a verification from the rules
    Text('Step {name} was not made.'),
    Text('Step {name} has {count} attempts; the last that was made counts.'),
    Text('Step {name} had no zeroing before it; it was compared with the calibrated zero.'),
    Text('No audit log was read, so changes between the steps may be unknown.'),
    Text('Parameters and audit log were not read again after the last step.'),
    Text('The samples have another calibration than the audit log of the machine.'),
    Text('skipped: {reason}'),
    Text('in progress'),
    Text('{name}: passed'),
    Text('{name}: failed'),
    Text('{name}: incomplete'),
    Text('{name}: undecided'),
    Text('the report is being written'),
    Text('the verification ends; its report contains the completed steps'),
    Text('nothing to cancel'),
)


_REASON_HINT = '|'.join(re.escape(each) for each in REASONS)
# Regular expressions for the values of placeholders, by the last word of the placeholder name. The
# value of a placeholder with another name may be any text.
_VALUES = {
    'mass': r'[-+]?\d+(?:\.\d+)? k?g|none',
    'count': r'\d+',
    'word': r'\S+',
    'topic': r'/\S+',
    'hint': _REASON_HINT,
    'advice': f'(?:{_REASON_HINT})(?:: .+)?',
}


class _Table:
    """Table of texts that can be translated, in which `find` looks up a message."""

    def __init__(self, texts: Iterable[Text]) -> None:
        # The texts with the most letters are first, because a message may match several of them.
        by_letters = sorted(texts, key=lambda each: -len(re.sub(r'{\w+}', '', each.template)))
        self._patterns = {each: _pattern(each) for each in by_letters if '{' in each.template}
        self._others: dict[str, Text] = {
            each: each for each in by_letters if each not in self._patterns
        }

    def find(self, message: str) -> Text | None:
        """Return the `Text` of a message, or None if the message matches no pattern."""
        if message in self._others:
            return self._others[message]
        for words, pattern in self._patterns.items():
            if found := pattern.fullmatch(message):
                values = {name: _value(name, value) for name, value in found.groupdict().items()}
                return Text(words.template, **values)
        return None


def _pattern(text: Text) -> re.Pattern[str]:
    """Return the regular expression of a text, with a group for each placeholder."""

    def group(found: re.Match[str]) -> str:
        kind = found[1].rpartition('_')[2]
        return f'(?P<{found[1]}>{_VALUES.get(kind, ".+?")})'

    return re.compile(re.sub(r'\\{(\w+)\\}', group, re.escape(text.template)))


def _value(name: str, text: str) -> str | Mass:
    """Return the value of the placeholder `name` for a `Text`, from its text in a message.

    The value is a `Mass` if the name ends with 'mass', a `Number` for a decimal number, and
    otherwise the result of `from_node`.
    """
    if name.endswith('mass'):
        number, _, unit = text.partition(' ')
        return Mass(float(number) / (GRAMS if unit == 'g' else 1) if unit else math.inf)
    return Number(text) if _NUMBER.fullmatch(text) else from_node(text)


_KNOWN_TEXTS, _KNOWN_HINTS = _Table((*_MESSAGES, *TEXTS)), _Table(HINTS)


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
    """Return a message of a node as a `Text` if it can be translated, otherwise unchanged.

    The message may be a text, a hint, or a text and a hint. If only the hint can be translated, the
    text stays as it is.
    """
    if isinstance(text, Text):
        return text
    if hint := _KNOWN_HINTS.find(text):
        return hint
    for found in re.finditer('; ', text):  # A text or a hint may also contain '; '.
        if hint := _KNOWN_HINTS.find(text[found.end() :]):
            return Text('{text}; {hint}', text=from_node(text[: found.start()]), hint=hint)
    return _KNOWN_TEXTS.find(text) or text
