# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Report of a verification as JSON values that satisfy `report.schema.json`.

The report is computed only from the bag of the verification. With the same versions of the program
and of its libraries, the same bag gives the same report, byte for byte, at any time and on any
computer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
import hashlib
from importlib.resources import files
import json
import math
from typing import Any

import numpy as np
import yaml

from checkweigher_core.records import GRAMS
from checkweigher_validation.verification.evaluation import Result, minutes_after, outcome_of
from checkweigher_validation.verification.plan import MINUTE, Plan
from checkweigher_validation.verification.procedure import (
    AtRest,
    Attempt,
    ItemPass,
    Procedure,
    digest_of,
)

SCHEMA = 'checkweigher-verification/1'
Values = dict[str, Any]

# Texts of the report: a statement, the tests that software cannot make, and the sources.
_TEXTS = yaml.safe_load((files(__package__) / 'report_texts.yaml').read_text(encoding='utf-8'))


def report_of(procedure: Procedure) -> Values:
    """Return the report of a verification as JSON values. An unknown value is None."""
    found = outcome_of(procedure)
    cell, identity = asdict(procedure.load_cell), procedure.identity
    stamps = [stamp for each in procedure.attempts for stamp in (each.begin, each.end)]
    first = [each for each in found.results if each.attempt.step.minutes is not None][:1]
    return {
        'schema': SCHEMA,
        'statement': _TEXTS['statement'],
        'verdict': found.verdict,
        'counts': {
            'passed': sum(each.passed for each in found.last),
            'failed': sum(bool(each.failures) for each in found.last),
            'not_made': len(found.missing),
        },
        'begin': _time(min(stamps)) if stamps else None,
        'end': _time(max(stamps)) if stamps else None,
        **_plan_values(procedure.plan),
        'steps': [_step(each, *first) for each in found.results],
        'faults_between': [
            _fault_between(each, procedure.attempts) for each in procedure.faults_between
        ],
        'departures': list(found.departures),
        'not_done': _TEXTS['not_done'],
        'sources': _TEXTS['sources'],
        'calibration': cell,
        'identity': dict(identity),
        'digests': {
            'bag': procedure.digest,
            'plan': hashlib.sha256(procedure.plan_text.encode()).hexdigest(),
            'calibration': digest_of(cell),
            'parameters': identity['parameters_sha256'],
            'audit_log': identity['audit_log_sha256'],
            'program': identity['program_sha256'],
        },
    }


def _plan_values(plan: Plan) -> Values:
    own = plan.accuracy_class
    return {
        'machine': dict(plan.machine),
        'load_cell': dict(plan.load_cell),
        'amplifier': dict(plan.amplifier),
        'accuracy': {
            'class': own.name,
            'category': own.category,
            'factor': own.factor,
            'e_g': _grams(own.interval),
            'in_service': own.in_service,
            'min_g': _grams(plan.minimum),
            'max_g': _grams(plan.maximum),
            'text': str(own),
        },
        'prepackages': [
            {
                **_in_grams(each, 'nominal', 'tolerable_negative_error', 'allowed_error'),
                'max_error_in_service_g': _grams(each.max_error),
            }
            for each in plan.prepackages
        ],
        'operator': plan.operator,
        'place': plan.place,
        'environment': plan.environment,
        'references': [
            {
                'name': each.name,
                **_in_grams(each, 'mass', 'uncertainty'),
                'certificate': each.certificate,
                'serial': each.serial,
            }
            for each in plan.references.values()
        ],
    }


def as_json(report: Mapping[str, Any]) -> str:
    """Return a report as the text of its JSON file."""
    return json.dumps(report, indent=1, ensure_ascii=False, allow_nan=False) + '\n'


def _step(result: Result, first: Result | None = None) -> Values:
    """Return the values of an attempt in the report.

    `first` is the first result of the warm-up, or None if there is no warm-up.
    """
    attempt, step = result.attempt, result.attempt.step
    after = None
    if first is not None and step.minutes is not None:
        after = round(minutes_after(result, first), 2)
    return {
        'name': step.name,
        'test': step.kind.value,
        'to_do': step.to_do,
        'load': step.load.name if step.load else None,
        'load_g': _grams(step.load.mass) if step.load else None,
        'speed_m_per_min': round(MINUTE * step.speed, 6) if step.speed else None,
        'position': step.position or None,
        'minutes_after_first': after,
        'begin': _time(attempt.begin),
        'end': _time(attempt.end),
        'attempt': result.number,
        'attempts': result.attempts,
        'verdict': result.verdict,
        'why': [attempt.skipped] if attempt.skipped else list(result.failures),
        'planned': step.count,
        'count': result.count,
        'required': result.required,
        'faults': result.faults,
        **_in_grams(result, 'error', 'max_error', 'worst_error', 'std_dev', 'max_std_dev'),
        **_in_grams(result, 'spread', 'uncertainty'),
        'coverage_95': _number(result.coverage, 4),
        'reading': _reading(attempt.reading) if attempt.reading else None,
        'passes': [_pass(each, step.load.mass) for each in attempt.passes if step.load],
    }


def _reading(reading: AtRest) -> Values:
    return {
        **_in_grams(reading, 'mass', 'std_error', 'noise'),
        'samples': reading.samples,
        'reasons': list(reading.reasons),
    }


def _pass(item: ItemPass, load: float) -> Values:
    return {
        'time': _time(item.stamp),
        'mass_g': _grams(item.mass),
        'error_g': _grams(item.mass - load),
        'std_dev_g': _grams(item.std_dev),
        'speed_m_per_min': _number(MINUTE * item.speed, 3),
        'reasons': list(item.reasons),
    }


def _fault_between(item: ItemPass, attempts: Sequence[Attempt]) -> Values:
    before = [each.step.name for each in attempts if not each.skipped and each.begin <= item.stamp]
    return {
        'time': _time(item.stamp) if item.stamp else None,
        'after': before[-1] if before else None,
        'reasons': list(item.reasons),
    }


def _in_grams(record: object, *names: str) -> Values:
    """Return the fields `names` of a record in g, as a dict.

    Each key is the name of a field followed by ``_g``. The fields of the record are in kg. A value
    that is not finite becomes None.
    """
    return {f'{name}_g': _grams(getattr(record, name)) for name in names}


def _grams(value: float) -> float | None:
    """Return a mass in kg as a value in g with six decimal places, or None if it is not finite."""
    return _number(GRAMS * value, 6)


def _number(value: float, digits: int) -> float | None:
    # Add 0.0, which converts -0.0 to 0.0, because a zero must not have a minus sign in the report.
    return round(value, digits) + 0.0 if math.isfinite(value) else None


def _time(stamp: int) -> str:
    """Return a time in ns since 1970 as ISO 8601 text in UTC with milliseconds."""
    return f'{np.datetime64(stamp // 1_000_000, "ms")}Z'
