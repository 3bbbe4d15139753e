# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reports on batches and verifications: their addresses, and lists of links to them."""

import asyncio
from collections.abc import Iterable
from pathlib import Path
from urllib.parse import quote, unquote, urlencode

from fastapi import FastAPI, HTTPException, Response
from nicegui import ui

from checkweigher_core.input_files import read_input
from checkweigher_production.batch_record import SUFFIX
from checkweigher_validation.verification.plan import VERIFICATIONS
from checkweigher_web.languages.language import Text
from checkweigher_web.work import actions
from checkweigher_web.work.dialogs import Desk, Dialog
from checkweigher_web.work.services import LaneServices, Workshop

BATCH, VERIFICATION = 'batch', 'verification'
_MANY = 20  # maximum number of reports in a list
_KINDS = {'html': 'text/html; charset=utf-8', 'json': 'application/json'}


def add_reports(app: FastAPI, workshop: Workshop, policy: str) -> None:
    """Serve the reports of the lanes in `workshop` with the content security policy `policy`.

    A request is answered with the status 404 if the report does not exist, or if its lane is not in
    `workshop`. Batch reports of a lane are served only after a user has opened the list of the
    batch reports.
    """

    @app.get('/reports/{kind}/{name}.{ending}')
    async def answer(kind: str, name: str, ending: str, lane: str = '') -> Response:
        services = workshop.lanes.get(lane)
        file = _file(services, kind, name, ending) if services and ending in _KINDS else None
        try:
            text = None if file is None else await asyncio.to_thread(read_input, file)
        except OSError:
            text = None
        if text is None:
            raise HTTPException(404, 'there is no such report')
        headers = {'Content-Security-Policy': policy}
        return Response(text, headers=headers, media_type=_KINDS[ending])


def _file(services: LaneServices, kind: str, name: str, ending: str) -> Path | None:
    if '/' in name or '\0' in name:
        return None
    if kind == BATCH and services.batch_folder is not None:
        beside = services.batch_folder / f'{name}{SUFFIX}'
        return services.batch_folder / f'{name}.{ending}' if beside.is_file() else None
    # Refuse '.' and '..', because the name of a verification is the name of its folder.
    if kind == VERIFICATION and services.verification is not None and name not in ('.', '..'):
        return Path(services.verification.folder) / VERIFICATIONS / name / f'report.{ending}'
    return None


def list_reports(lane: str, kind: str, reports: Iterable[tuple[str, str]]) -> None:
    """Show links to the HTML version and the JSON version of reports of a lane.

    `kind` is `BATCH` or `VERIFICATION`. `reports` contains the name of each report, which is a part
    of the address of the report, and the text before its links.
    """
    for name, text in reports:
        with ui.element('li'):
            ui.label(f'{text}: ')
            for ending in _KINDS:
                address = f'/reports/{kind}/{quote(name, safe="")}.{ending}'
                ui.link(ending.upper(), f'{address}?{urlencode({"lane": lane})}', new_tab=True)


def latest_records(folder: Path) -> list[Path]:
    """Return the batch records in a folder, the most recently changed record first."""
    records = folder.glob(f'*{SUFFIX}')
    return sorted(records, key=lambda path: path.stat().st_mtime_ns, reverse=True)


async def batch_reports(desk: Desk, services: LaneServices) -> None:
    """Open a dialog with links to the latest `_MANY` batch reports of a lane, the latest first.

    Raises `ActionRefusedError` if the lane has no folder for batch records.
    """
    services.batch_folder = folder = await actions.batch_folder(services)
    records = [each for each in latest_records(folder) if each.with_suffix('.html').is_file()]
    dialog = Dialog(Text('Batch reports'), desk.say)
    with dialog.body:
        ui.label(
            desk.say(
                '{count} in {folder}. A batch has one when it has ended and the node '
                'batch_reporter runs, as with run --folder.',
                count=len(records),
                folder=folder,
            )
        )
        with ui.element('ol').classes('reports'):
            stems = (path.stem for path in records[:_MANY])
            list_reports(desk.lane.name, BATCH, ((stem, unquote(stem)) for stem in stems))
