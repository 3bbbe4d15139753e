# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Messages of any content, and bytes that are no message."""

import math
import random
from typing import Any

from rclpy.serialization import serialize_message

from checkweigher_core.records.reasons import Reason

INTEGERS = {
    kind: (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) if kind[0] == 'i' else (0, 2**bits - 1)
    for bits in (8, 16, 32, 64)
    for kind in (f'int{bits}', f'uint{bits}')
}
FLOATS = (0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, math.nan, math.inf, -math.inf, 0.2, 960.0, 5e5)
TEXTS = ('', 'a', '\n', 'ß' * 300, '../..', *(reason.value for reason in Reason))


def spoil(message: Any, chance: random.Random) -> Any:
    """Fill a message with any values that its types allow, and sometimes leave a field as it is."""
    for name, kind in message.get_fields_and_field_types().items():
        if chance.random() < 0.1:
            continue
        old = getattr(message, name)
        if kind.startswith('sequence<'):
            inner = kind[len('sequence<') : -1]
            length = chance.choice([0, 1, 2, 20, 20, 200, 3000])
            if '/' in inner:
                continue  # of diagnostics only, which the nodes do not read
            setattr(message, name, [_value(inner, chance) for _ in range(length)])
        elif '/' in kind:
            spoil(old, chance)
        else:
            setattr(message, name, _value(kind, chance))
    return message


def _value(kind: str, chance: random.Random) -> Any:
    if kind == 'boolean':
        return chance.random() < 0.5
    if kind == 'string':
        return chance.choice(TEXTS)
    if kind in ('float', 'double'):
        return chance.choice([*FLOATS, chance.gauss(0, 1)])
    if kind == 'octet':
        return chance.randbytes(1)
    low, high = INTEGERS[kind]
    near = [low, high, 0, 1, 2, 1_700_000_000, chance.randrange(1000), chance.randint(low, high)]
    return min(max(chance.choice(near), low), high)


def garbage_bytes(kind: type, chance: random.Random) -> bytes:
    """Return bytes that are no message: cut, overwritten, random, with senseless lengths."""
    data = bytes(serialize_message(spoil(kind(), chance)))
    begin = chance.randrange(len(data))
    return chance.choice(
        [
            data[:begin],
            data[:begin] + chance.randbytes(8) + data[begin + 8 :],
            data[:4] + chance.randbytes(chance.randrange(80)),
            data[:4] + b'\xff' * 40,
            chance.randbytes(chance.randrange(60)),
        ]
    )
