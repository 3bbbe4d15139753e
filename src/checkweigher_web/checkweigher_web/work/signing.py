# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Dialog in which a user signs batches, verifications, and changes of recipes and limits."""

import asyncio
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from urllib.parse import unquote

from nicegui import ui

from checkweigher_production.audit_chain import read_chain
from checkweigher_validation.batch.signatures import MEANINGS, Signature, signatures_in
from checkweigher_validation.batch.signing import (
    Signable,
    signable_batch,
    signable_entries,
    signable_entry,
)
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Action, Desk, ask
from checkweigher_web.work.reports import latest_records
from checkweigher_web.work.services import ActionRefusedError, LaneServices

_TEXT = Text(
    'You sign with your name and the time. The signature is void if one byte of what was signed '
    'changes. A release needs a technician and, if the recipe asks for two persons, the signature '
    'of another person before.'
)
_MANY = 20  # maximum number of batches, and of audit log entries, from which the user can choose
Find = Callable[[], Signable]


async def sign_records(desk: Desk, services: LaneServices) -> None:
    """Open a dialog for the record to sign, the meaning of the signature, and the password.

    Raises `ActionRefusedError` if the lane has no audit log or no folder for batch records, or if
    the audit log cannot be read.
    """
    log, folder = await actions.audit_log(services), await actions.batch_folder(services)
    try:
        known = await asyncio.to_thread(_choices, log, folder)
    except (OSError, ValueError) as error:
        raise ActionRefusedError(str(error)) from None

    def choice() -> ui.select:
        return ui.select(list(known), label=desk.say('What')).props('outlined dense')

    def meanings() -> ui.toggle:
        return ui.toggle({each: desk.say(each) for each in MEANINGS}).props('no-caps')

    def password() -> ui.input:
        return ui.input(desk.say('Password'), password=True).props(
            'outlined dense autocomplete=off'
        )

    def plan(what: ui.select, meaning: ui.toggle, password: ui.input) -> tuple[str, Action]:
        if what.value not in known or meaning.value is None:
            raise ActionRefusedError(Text('choose what you sign, and what the signature means'))
        title, find = known[what.value]
        given = str(password.value or '')
        act = partial(_sign, desk, services, find, meaning.value, given)
        return Text('{meaning} of {title}', meaning=Text(meaning.value), title=title), act

    ask(desk, Text('Sign'), _TEXT, Text('Sign'), plan, choice, meanings, password)


async def _sign(desk: Desk, services: LaneServices, find: Find, meaning: str, password: str) -> str:
    """Sign the record that `find` reads, and return a text on the signature.

    Raises `ActionRefusedError` if the record cannot be read or signed.
    """
    try:
        what = await asyncio.to_thread(find)
    except (OSError, ValueError) as error:
        raise ActionRefusedError(str(error)) from None
    made = await desk.sign(what, meaning, password)
    await services.write_signature(what.subject, made.value)
    return Text(
        '{meaning} of {title} signed by {name}, {time}',
        meaning=Text(meaning),
        title=what.title,
        name=made.who,
        time=made.time,
    )


def _choices(log: Path, folder: Path) -> dict[str, tuple[str, Find]]:
    """Return the records that a user may choose to sign, by label.

    Each value contains the title of the record and a function that reads the record. The label
    names the previous signers. The latest `_MANY` batches are first, followed by the latest `_MANY`
    entries of the audit log. In each of the two groups, the latest record is first. Whether a batch
    has ended is checked only when the batch is signed.
    """
    entries = read_chain(log).entries
    found: dict[str, tuple[str, Find]] = {}
    for record in latest_records(folder)[:_MANY]:
        name = unquote(record.stem)
        signed = _signed(signatures_in(entries, name))
        found[f'batch {name}{signed}'] = f'batch {name}', partial(signable_batch, record, log)
    for each in signable_entries(entries)[: -_MANY - 1 : -1]:
        found[f'{each.title}{_signed(each.signatures)}'] = (
            each.title,
            partial(signable_entry, log, each.sha256),
        )
    return found


def _signed(signatures: Sequence[Signature]) -> str:
    """Return a text with the signers, or '' if there are no signatures."""
    names = ', '.join(f'{each.meaning} by {each.who}' for each in signatures)
    return f' ({names})' if names else ''
