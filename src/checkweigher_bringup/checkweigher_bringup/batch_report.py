# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports on batches as text, HTML and JSON, and texts on single items of batch records."""

from collections.abc import Iterator, Sequence
import hashlib
import json
import math
from pathlib import Path

from checkweigher_bringup.errors import LineError
from checkweigher_core.printable import one_line
from checkweigher_core.records import GRAMS, utc
from checkweigher_core.whole_file import write_whole
from checkweigher_production.batch_record import SUFFIX, read_events
from checkweigher_validation.batch.batch import Batch, InLog, read_recorded
from checkweigher_validation.batch.figures import PartFigures, as_json
from checkweigher_validation.batch.signatures import RELEASE, Signer


def signers_of(users: Path) -> dict[str, Signer]:
    """Return a `Signer` for each user in the file `users`, by user name.

    A `Signer` contains the public keys of the user, and whether the user may release batches.

    Raises `SettingsError` if the file cannot be used.
    """
    from checkweigher_web.access.users import least_role, read_users

    return {
        user.name: Signer(tuple(user.keys.split()), user.role >= least_role(RELEASE))
        for user in read_users(users).values()
    }


def record_files(source: Path) -> list[Path]:
    """Return the paths of the records in the folder `source`, sorted by name.

    If `source` is not a folder, only `source` is returned.
    """
    return sorted(source.glob(f'*{SUFFIX}')) if source.is_dir() else [source]


def item_lines(source: Path, log: Path | None, item: int) -> Iterator[str]:
    """Yield lines of text on the verdicts on an item.

    `source` is a batch record or a folder of batch records. The last line on a verdict states the
    SHA-256 of the record line that contains the verdict. If a record agrees with the audit log, a
    line after its verdicts states this. `log` is the path of the audit log, or None for the log of
    the machine whose folder contains the record.

    Raises `LineError` after the last line if there is no verdict on the item, or if a record that
    contains one cannot be trusted. Raises `RecordError` or `AuditError` if a record or the audit
    log cannot be read.
    """
    found, faults = 0, []
    for record in record_files(source):
        # Do not parse records without the item, because parsing a whole folder takes a long time.
        if b'"item_id":%d,' % item not in record.read_bytes():
            continue
        batch = read_recorded(record, log)
        verdicts = list(_verdicts(record, batch, item))
        found += len(verdicts)
        yield from verdicts
        if verdicts and batch.faults:
            faults.append(f'{record}: NOT trusted: {one_line(batch.faults[0])}')
        elif verdicts:
            yield f'  the record agrees with the audit log {one_line(batch.log)}'
    if not found:
        raise LineError(f'{source}: has no item {item}')
    if faults:
        raise LineError('; '.join(faults))


def _verdicts(record: Path, batch: Batch, item: int) -> Iterator[str]:
    """Yield three lines of text for each verdict on an item in a record."""
    lines = record.read_bytes().splitlines()
    for number, (kind, event) in enumerate(read_events(record), 1):
        if kind == 'verdict' and event.item_id == item:
            mass = f'{GRAMS * event.mass:.3f} g' if math.isfinite(event.mass) else 'no mass'
            reasons = f' ({", ".join(event.reasons)})' if event.reasons else ''
            yield f'batch {one_line(batch.name)}, line {number}: item {item}: {mass} with packaging'
            time = utc(event.t3) if event.t3 else 'no time'
            yield f'  {event.decision.name}{one_line(reasons)}, {time}'
            yield f'  SHA-256 of the line: {hashlib.sha256(lines[number - 1]).hexdigest()}'


def fails(batch: Batch, parts: Sequence[PartFigures]) -> bool:
    """Return whether the record of a batch cannot be trusted, or a product fails 76/211/EEC.

    The statistics of a product in `parts` must meet the rules for packers and pass the reference
    test. A product is not judged if 76/211/EEC has no limits for its nominal weight, or if no item
    was accepted.
    """
    judged = [part for part in parts if part.judgement and part.reference]
    rules = [each for part in judged for each in (part.judgement, part.reference)]
    return bool(batch.faults) or not all(each.passed for each in rules if each)


def write_report(
    batch: Batch, parts: Sequence[PartFigures], html: Path | None, json_file: Path | None
) -> None:
    """Write a report as HTML and as JSON. A format is left out if its path is None.

    Raises `OutputError` if a file cannot be written.
    """
    if html is not None:
        from checkweigher_validation.report.batch_page import render_batch

        write_whole(html, render_batch(batch, parts))
    if json_file is not None:
        content = as_json(batch, list(parts))
        write_whole(json_file, json.dumps(content, indent=2, allow_nan=False) + '\n')


def batch_lines(batch: Batch, parts: Sequence[PartFigures]) -> Iterator[str]:
    """Yield the report as lines of text: the state of the record, then each product.

    `parts` contains the statistics of each product, because a batch may have several products.
    """
    title = f'batch {one_line(batch.name)}'
    yield from _trust_lines(batch, title)
    for part in parts:
        counts = ', '.join(f'{count} {each}' for each, count in part.decisions.items() if count)
        product = one_line(part.product.name or 'no product')
        yield f'{title}, {product}: {part.items} items: {counts or "none"}'
        for why, count in part.reasons.items():
            yield f'  {count:>6} {one_line(why)}'
        if not math.isnan(part.mean):
            yield f'  {_mean(part)}'
            yield from _judgement(part)


def _trust_lines(batch: Batch, title: str) -> Iterator[str]:
    """Yield lines of text on the state of a record. Each line begins with `title`.

    The first line states whether the record agrees with the audit log, and is left out if the
    record was not compared with a log. The other lines state the faults, the signatures, and the
    number of items that belong to another batch.
    """
    if batch.log:
        state = '' if batch.end else '; the batch has not ended yet'
        agrees = 'agrees with' if batch.in_log is InLog.AGREES else 'does NOT agree with'
        yield f'{title}: the record {agrees} the audit log {one_line(batch.log)}{state}'
    for fault in batch.faults:
        yield f'{title}: NOT trusted: {one_line(fault)}'
    for each in batch.signatures:
        yield f'{title}: {one_line(each.meaning)} by {one_line(each.who)}, {one_line(each.time)}'
    if batch.strays:
        yield f'{title}: {batch.strays} items of another batch in the record are not counted'


def _mean(part: PartFigures) -> str:
    mean, nominal = GRAMS * part.mean, GRAMS * part.product.nominal
    spread = ''
    if not math.isnan(part.std_dev):  # The standard deviation of a single item is NaN.
        spread = f'standard deviation {GRAMS * part.std_dev:.3f} g, '
    giveaway = round(GRAMS * part.giveaway, 3) + 0.0  # Adding zero turns -0.0 into 0.0.
    return f'mean {mean:.3f} g of {nominal:g} g, {spread}giveaway {giveaway:+.3f} g'


def _judgement(part: PartFigures) -> Iterator[str]:
    rules, test = part.judgement, part.reference
    if rules is None or test is None:
        yield '  76/211/EEC has no limits for this nominal weight'
        return
    yield (
        f'  rules: mean {_word(rules.mean_passed)}; below TU1 {rules.below_tu1} '
        f'({100 * rules.share_below_tu1:.2f} %) {_word(rules.tu1_passed)}; below TU2 '
        f'{rules.below_tu2} {_word(rules.tu2_passed)}'
    )
    last = test.samples[-1]
    below_tu2 = f', {test.below_tu2} below TU2, none allowed' if test.tu2_decides else ''
    yield (
        f'  reference test, {test.plan.value} sampling: {last.defective} of {last.count} below '
        f'TU1, at most {last.accept}{below_tu2}: {_word(test.contents_passed)}; mean of '
        f'{test.mean_count} {GRAMS * test.mean:.3f} g, at least {GRAMS * test.mean_limit:.3f} g: '
        f'{_word(test.mean_passed)}'
    )


def _word(passed: bool) -> str:
    return 'met' if passed else 'NOT met'
