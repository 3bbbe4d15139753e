# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Buttons and menu for the actions on a lane that the role of the user allows."""

from collections.abc import Awaitable, Callable
from functools import partial

from nicegui import ui
from nicegui.element import Element

from checkweigher_web.access.users import Role
from checkweigher_web.elements import menu_entry, named
from checkweigher_web.lane import Lane, ShownItem
from checkweigher_web.languages.language import Text
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
_ZERO = Text('The next empty belt at rest becomes the zero. Stop the feed, and clear the belt.')
_START = Text('Weighing starts. The machine may move. Make sure that nobody reaches into it.')
_STOP = Text(
    'Weighing stops: what is on the belt is a fault, and a line with outputs stands until it is '
    'started and its stop is reset.'
)
_UNTRAINED = Text(
    'This machine was not trained on passes of known mass yet. The steps from zero to a verified '
    'line:'
)
_ACKNOWLEDGE = Text('You have seen all alarms. Those that are over leave the list.')
_Begin = Callable[[Desk, LaneServices], Awaitable[None]]


def work_of(desk: Desk) -> dict[str, Callable[[], Awaitable[None]]]:
    """Return a function for each dialog that the user may open, by its English label."""
    return {
        label: partial(_open, desk, label, role, begin)
        for label, role, begin in _ACTIONS
        if desk.role >= role
    }


def work_bar(look: Look) -> None:
    """Show a button for each main action.

    The button Start is hidden while the lane weighs or the state of its driver is not known. The
    button Stop is hidden while weighing is stopped or has ended.
    """
    with named(ui.element('nav').classes('work'), look.say('Work on the machine')):
        buttons = {each: ui.button(look.say(each), on_click=look.work[each]) for each in _MAIN}
    for button in buttons.values():
        button.props('outline')

    def update() -> None:
        # Show both buttons if nodes of the lane are silent or the driver reports an unknown state,
        # because the user may then need either button.
        stands = standstill(look.nodes())
        buttons['Start'].set_visibility(bool(stands))
        buttons['Stop'].set_visibility(stands not in ENDED.values())

    update()
    ui.timer(_PERIOD, update)


def hint_to_commissioning(desk: Desk) -> None:
    """Show a technician a link to the commissioning page until the machine is trained.

    The link is hidden while no message on the dynamic setting has arrived.
    """
    if desk.role < Role.TECHNICIAN:
        return
    with ui.element('aside').classes('hint') as hint:
        ui.label(desk.say(_UNTRAINED))
        ui.link(desk.say('Commissioning'), f'/commissioning/{desk.lane.name}')
    hint.set_visibility(False)

    async def update() -> None:
        setting = (await desk.services()).setting
        hint.set_visibility(setting is not None and not setting.file)

    ui.timer(_PERIOD, update)


def work_menu(desk: Desk, look: Look) -> None:
    """Add an entry to the enclosing menu for each action that has no button of its own.

    The entry Practice is shown only while the machine is known to be simulated.
    """
    for label, open_dialog in look.work.items():
        if label not in _MAIN:
            entry = menu_entry(look.say(label), open_dialog)
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

        text = Text(
            'Item {number} is written to {folder} as a small bag, with what came before it and its '
            'mass needs.',
            number=number,
            folder=keeper.folder,
        )
        what = Text('keep item {number}', number=number)
        ask(desk, _KEEP, text, Text('Keep'), lambda: (what, keep))

    await _open(desk, _KEEP, Role.OPERATOR, begin)


async def _open(desk: Desk, label: str, role: Role, begin: _Begin) -> None:
    """Open a dialog if the user still has the role, otherwise go to the login.

    If `begin` raises `ActionRefusedError`, a dialog shows the reason.
    """
    if desk.role < role:
        ui.navigate.to('/login')
        return
    try:
        await begin(desk, await desk.begin())
    except ActionRefusedError as error:
        Dialog(label, desk.say).tell(Outcome(False, error.text))


async def _product(desk: Desk, services: LaneServices) -> None:
    known = await actions.products(services)
    now = desk.lane.statistics.product if desk.lane.statistics else ''

    def choice() -> ui.select:
        label, value = desk.say('Product'), now if now in known else None
        return ui.select(list(known), label=label, value=value).props('outlined dense')

    def plan(choice: ui.select) -> tuple[str, Action]:
        name = choice.value
        if name not in known:
            raise ActionRefusedError(Text('choose a product'))
        return Text('select product {name}', name=name), partial(
            actions.select_product, services, name
        )

    text = Text('All parameters of the product are set. Change it while the belt is empty.')
    ask(desk, Text('Product'), text, Text('Select'), plan, choice)


async def _batch(desk: Desk, services: LaneServices) -> None:
    def plan(batch: ui.input) -> tuple[str, Action]:
        name = str(batch.value or '').strip()
        return Text('begin batch {name}', name=name), partial(actions.new_batch, services, name)

    text = Text('The counts of this batch end, and those of the new one begin at 0.')
    ask(desk, _NEW_BATCH, text, Text('Begin'), plan, partial(field, desk.say('Batch')))


_Act = Callable[[LaneServices], Awaitable[str]]


def _confirmed(verb: Text, what: Text, act: _Act, text: Text) -> _Begin:
    """Return a function that opens a dialog to confirm an action."""

    async def begin(desk: Desk, services: LaneServices) -> None:
        ask(desk, verb, text, verb, lambda: (what, partial(act, services)))

    return begin


async def _reset(desk: Desk, services: LaneServices) -> None:
    stop = desk.lane.stop
    why = Text('No stop is requested.')
    if stop is not None:
        hint = Text(stop.reason.hint)
        why = Text('{reason}: {hint}.', reason=str(stop.reason), hint=hint)
    text = Text(
        '{why} Then the machine may run again. Make sure that the cause of the stop is removed.',
        why=why,
    )
    plan = Text('reset stop request'), partial(actions.reset_stop, services)
    ask(desk, Text('Reset stop'), text, Text('Reset'), lambda: plan)


async def _commission(desk: Desk, services: LaneServices) -> None:
    ui.navigate.to(f'/commissioning/{desk.lane.name}')


async def _show_practice(desk: Desk, services: LaneServices) -> None:
    ui.run_javascript('document.querySelector(".practice").scrollIntoView({block: "center"})')


_KEEP, _NEW_BATCH, _PRACTICE = Text('Keep item'), Text('New batch'), Text('Practice')
# Labels of the actions with a button. All other actions are in the menu.
_MAIN = 'Start', 'Stop', 'Product', 'New batch', 'Zero'
# Label, lowest role and function of each dialog. To add a dialog, add a function and a row here.
_ACTIONS: tuple[tuple[Text, Role, _Begin], ...] = (
    (Text('Product'), Role.OPERATOR, _product),
    (_NEW_BATCH, Role.OPERATOR, _batch),
    (
        Text('Zero'),
        Role.OPERATOR,
        _confirmed(Text('Zero'), Text('zero'), actions.zero, _ZERO),
    ),
    (
        Text('Start'),
        Role.OPERATOR,
        _confirmed(Text('Start'), Text('start weighing'), actions.start, _START),
    ),
    (
        Text('Stop'),
        Role.OPERATOR,
        _confirmed(Text('Stop'), Text('stop weighing'), actions.stop, _STOP),
    ),
    (Text('Reset stop'), Role.OPERATOR, _reset),
    (
        Text('Acknowledge alarms'),
        Role.OPERATOR,
        _confirmed(
            Text('Acknowledge alarms'),
            Text('acknowledge alarms'),
            actions.acknowledge_alarms,
            _ACKNOWLEDGE,
        ),
    ),
    (Text('Performance test'), Role.OPERATOR, performance_test),
    (Text('Batch reports'), Role.OPERATOR, batch_reports),
    (Text('Sign'), Role.OPERATOR, sign_records),
    (Text('Audit log'), Role.OPERATOR, audit_log),
    (Text('Commissioning'), Role.TECHNICIAN, _commission),
    (Text('Recipes'), Role.TECHNICIAN, recipes),
    (Text('Users'), Role.TECHNICIAN, users),
    (_PRACTICE, Role.TECHNICIAN, _show_practice),
)
