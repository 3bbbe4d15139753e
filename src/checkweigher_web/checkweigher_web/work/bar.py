# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Buttons and menu for the actions on a lane that the role of the user allows."""

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui
from nicegui.element import Element

from checkweigher_web.access.users import Role
from checkweigher_web.elements import menu_entry
from checkweigher_web.lane import Lane, ShownItem
from checkweigher_web.technician.practice import is_simulated
from checkweigher_web.technician.recipes import recipes
from checkweigher_web.technician.users import users
from checkweigher_web.views.item import ENDED, standstill
from checkweigher_web.views.view import Look
from checkweigher_web.work import actions
from checkweigher_web.work.audit import audit_log
from checkweigher_web.work.dialogs import Action, Desk, Dialog, ask, field
from checkweigher_web.work.keeping import Keeper
from checkweigher_web.work.performance import performance_test
from checkweigher_web.work.reports import batch_reports
from checkweigher_web.work.services import ActionRefusedError, LaneServices, Outcome
from checkweigher_web.work.signing import sign_records

_PERIOD = 1.0  # s
_ZERO = 'The next empty belt at rest becomes the zero. Stop the feed, and clear the belt.'
_START = 'Weighing starts. The machine may move: see that nobody reaches into it.'
_STOP = (
    'Weighing stops: what is on the belt is a fault, and a line with outputs stands until it is '
    'started and its stop is reset.'
)
_ACKNOWLEDGE = 'You have seen all alarms. Those that are over leave the list.'
_Begin = Callable[[Desk, LaneServices], Awaitable[None]]


def work_of(desk: Desk) -> dict[str, Callable[[], Awaitable[None]]]:
    """Return functions that open the dialogs that the role of the user allows, by label."""
    return {
        label: partial(_open, desk, label, role, begin)
        for label, role, begin in _ACTIONS
        if desk.role >= role
    }


def work_bar(look: Look) -> None:
    """Show a button for each main action, with Start or Stop depending on the lane."""
    with ui.element('nav').classes('work').props('aria-label="Work on the machine"'):
        buttons = {label: ui.button(label, on_click=look.work[label]) for label in _MAIN}
    for button in buttons.values():
        button.props('outline')

    def update() -> None:
        stands = standstill(look.nodes())  # A silent or unknown lane shows both.
        buttons['Start'].set_visibility(bool(stands))
        buttons['Stop'].set_visibility(stands not in ENDED.values())

    update()
    ui.timer(_PERIOD, update)


def work_menu(desk: Desk, look: Look) -> None:
    """Add an entry to a menu for each action that has no button of its own."""
    for label, open_dialog in look.work.items():
        if label not in _MAIN:
            entry = menu_entry(label, open_dialog)
            if label == _PRACTICE:
                entry.set_visibility(False)
                ui.timer(_PERIOD, partial(_show_simulated, entry, desk.lane))


def _show_simulated(entry: Element, lane: Lane) -> None:
    entry.set_visibility(is_simulated(lane))


async def keep_item(desk: Desk, keeper: Keeper, item: ShownItem) -> None:
    """Ask for confirmation, and write an item as a small bag."""
    number, recording = item.verdict.item_id, desk.lane.recording()

    async def begin(desk: Desk, services: LaneServices) -> None:
        async def keep() -> str:
            parameters = await actions.line_parameters(services)
            return await keeper.keep(desk.lane.name, recording, parameters, item)

        text = (
            f'Item {number} is written to {keeper.folder} as a small bag, with what came before it '
            'and its mass needs.'
        )
        ask(desk, 'Keep item', text, 'Keep', lambda: (f'keep item {number}', keep))

    await _open(desk, 'Keep item', Role.OPERATOR, begin)


async def _open(desk: Desk, label: str, role: Role, begin: _Begin) -> None:
    """Open a dialog if the user still has the role, otherwise go to the login."""
    if desk.role < role:
        ui.navigate.to('/login')
        return
    try:
        await begin(desk, await desk.begin())
    except ActionRefusedError as error:
        Dialog(label).tell(Outcome(False, str(error)))


async def _product(desk: Desk, services: LaneServices) -> None:
    known = await actions.products(services)
    now = desk.lane.statistics.product if desk.lane.statistics else ''

    def choice() -> ui.select:
        return ui.select(list(known), label='Product', value=now if now in known else None).props(
            'outlined dense'
        )

    def plan(choice: ui.select) -> tuple[str, Action]:
        name = choice.value
        if name not in known:
            raise ActionRefusedError('choose a product')
        return f'select product {name}', partial(actions.select_product, services, name)

    text = 'All parameters of the product are set. Change it while the belt is empty.'
    ask(desk, 'Product', text, 'Select', plan, choice)


async def _batch(desk: Desk, services: LaneServices) -> None:
    def plan(batch: ui.input) -> tuple[str, Action]:
        name = str(batch.value or '').strip()
        return f'begin batch {name}', partial(actions.new_batch, services, name)

    text = 'The counts of this batch end, and those of the new one begin at 0.'
    ask(desk, 'New batch', text, 'Begin', plan, partial(field, 'Batch'))


_Act = Callable[[LaneServices], Awaitable[str]]


def _confirmed(verb: str, what: str, act: _Act, text: str) -> _Begin:
    """Return a function that opens a dialog to confirm an action."""

    async def begin(desk: Desk, services: LaneServices) -> None:
        ask(desk, verb, text, verb, lambda: (what, partial(act, services)))

    return begin


async def _reset(desk: Desk, services: LaneServices) -> None:
    stop = desk.lane.stop
    why = 'No stop is requested. ' if stop is None else f'{stop.reason}: {stop.hint}. '
    text = f'{why}Then the machine may run again. Make sure that the cause of the stop is removed.'
    plan = 'reset stop request', partial(actions.reset_stop, services)
    ask(desk, 'Reset stop', text, 'Reset', lambda: plan)


async def _commission(desk: Desk, services: LaneServices) -> None:
    ui.navigate.to(f'/commissioning/{desk.lane.name}')


async def _show_practice(desk: Desk, services: LaneServices) -> None:
    ui.run_javascript('document.querySelector(".practice").scrollIntoView({block: "center"})')


_PRACTICE = 'Practice'
_MAIN = 'Start', 'Stop', 'Product', 'New batch', 'Zero'  # others are in the menu
# Label, lowest role and function of each dialog. A new dialog is a function and a row here.
_ACTIONS: tuple[tuple[str, Role, _Begin], ...] = (
    ('Product', Role.OPERATOR, _product),
    ('New batch', Role.OPERATOR, _batch),
    ('Zero', Role.OPERATOR, _confirmed('Zero', 'zero', actions.zero, _ZERO)),
    ('Start', Role.OPERATOR, _confirmed('Start', 'start weighing', actions.start, _START)),
    ('Stop', Role.OPERATOR, _confirmed('Stop', 'stop weighing', actions.stop, _STOP)),
    ('Reset stop', Role.OPERATOR, _reset),
    (
        'Acknowledge alarms',
        Role.OPERATOR,
        _confirmed(
            'Acknowledge alarms', 'acknowledge alarms', actions.acknowledge_alarms, _ACKNOWLEDGE
        ),
    ),
    ('Performance test', Role.OPERATOR, performance_test),
    ('Batch reports', Role.OPERATOR, batch_reports),
    ('Sign', Role.OPERATOR, sign_records),
    ('Audit log', Role.OPERATOR, audit_log),
    ('Commissioning', Role.TECHNICIAN, _commission),
    ('Recipes', Role.TECHNICIAN, recipes),
    ('Users', Role.TECHNICIAN, users),
    (_PRACTICE, Role.TECHNICIAN, _show_practice),
)
