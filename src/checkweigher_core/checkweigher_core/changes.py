# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Kinds of entries in the audit log of a lane, and conversion of their values to JSON types.

docs/audit_log.md describes the entries of each kind.
"""

from collections.abc import Mapping
import math
from typing import Any

PARAMETER, FOUND, RECIPE, CALIBRATION = 'parameter', 'found', 'recipe', 'calibration'
SELECTION, REFUSED, BATCH, RESET = 'selection', 'refused', 'batch', 'reset'
RESTORED, ZERO, PERSON, LEARNED = 'restored', 'zero', 'person', 'learned'
# RECORD: state of a batch record; REPORT: a report of this record was made.
RECORD, REPORT = 'record', 'report'
TUNED = 'tuned'
TARE = 'tare'  # the tare of a product was checked with a sample of empty packages
ALARM, RUN = 'alarm', 'run'  # RUN: the line was started, or was shut down normally
# TEST: end of a performance test; TEST_BEGUN: beginning or cancellation of a performance test.
TEST, TEST_BEGUN = 'test', 'test_begun'
SIGNATURE = 'signature'  # a person signed a batch record or a log entry electronically
VERIFICATION = 'verification'  # a verification report was written
SOFTWARE = 'software'  # digests of the legally relevant software, written when `product` starts
LOG = 'log'  # first entry of a log, which names the previous log of the lane
CLOCK = 'clock'  # the clock of the computer was set, or its time reference has changed
BACKUP = 'backup'  # the machine folder was restored from a backup


def plain(value: object) -> Any:
    """Convert a value to JSON types.

    Mappings are converted to dicts with strings as keys, and all other iterables except strings to
    lists. The values of mappings and the elements of iterables are converted in the same way. NaN,
    infinities, and values of all other types that JSON does not have are converted to strings.
    Strings, finite numbers, bools and None are unchanged.
    """
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    if isinstance(value, Mapping):
        return {str(name): plain(each) for name, each in value.items()}
    if isinstance(value, (str, bool, int, float)) or value is None:
        return value
    if hasattr(value, '__iter__'):
        return [plain(each) for each in value]
    return str(value)
