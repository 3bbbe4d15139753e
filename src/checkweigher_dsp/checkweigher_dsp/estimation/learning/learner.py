# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Learning during operation, which updates the learned state with each item."""

from dataclasses import dataclass, replace
from functools import partial
from typing import Any, ClassVar

from checkweigher_core.parameters import ParameterError, Parameters, SettingsError, parameter
from checkweigher_core.records import WeighWindow
from checkweigher_core.settings_files import Settings
from checkweigher_dsp.estimation.estimators.base import LoadEstimate
from checkweigher_dsp.estimation.estimators.learned import PARTS
from checkweigher_dsp.estimation.learning.change import RECENT, Change, find_change, is_comparable
from checkweigher_dsp.estimation.learning.passage import PassParts, passage_of, rise_parts_of
from checkweigher_dsp.estimation.learning.regression import Fit, fit
from checkweigher_dsp.signal import Array

# Largest relative differences of belt speed and length between an item and its kind.
_SAME_SPEED, _SAME_LENGTH = 0.05, 0.1
_STEP = 5  # number of items from one fit to the next

_items = partial(parameter, minimum=20, maximum=300)


@dataclass(frozen=True)
class LearningParameters(Parameters):
    """Parameters of learning from products of unknown mass, which `identifier.learn` enables.

    Raises `ParameterError` if a value is not allowed, or if ``most`` is below ``fewest``.
    """

    node: ClassVar[str] = 'identifier.learning'

    fewest: int = _items(
        30, 'number of items of one belt speed and length from which weights are first learned'
    )
    most: int = _items(
        120,
        'largest number of items of one belt speed and length from which weights are learned; '
        'later items only show whether the machine has changed',
    )
    kinds: int = parameter(
        8,
        'number of combinations of belt speed and item length whose learned state is kept; if '
        'there are more, the one that was not seen for the longest time is discarded',
        minimum=1,
        maximum=32,
    )
    relearn: bool = parameter(
        False,
        'whether to discard the learned weights and learn again as soon as a change of the machine '
        'is noticed; otherwise, the weights are not used until the service `forget_learned` is '
        'called',
    )
    record: str = parameter(
        '',
        'file in which the learned state is kept for the next start; empty: a file that is named '
        'after the node, in $XDG_STATE_HOME/checkweigher or else in ~/.local/state/checkweigher; '
        '-: no file',
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.most < self.fewest:
            raise ParameterError(
                f'{self.node}.most: {self.most} must not be below fewest, which is {self.fewest}'
            )


@dataclass(frozen=True, eq=False)
class ItemKind(Settings):
    """State that was learned from one kind of items, whose belt speeds and lengths are similar.

    The method `has` defines the tolerances of speed and length. `passages` is emptied when learning
    is complete, and when a change of the machine is noticed. `recent` contains the residuals, (k,)
    each, of at most `RECENT` items whose loads were comparable with the learned loads. `recent` is
    emptied when the number of weights changes, and when a change of the machine is noticed. Raises
    `SettingsError` if the residuals and the weights differ in length.
    """

    speed: float = parameter(text='belt speed', unit='m/s', minimum=0)
    length: float = parameter(text='length of the item', unit='m', minimum=0)
    rise: int = parameter(text='parts from t1 to t2', minimum=0, maximum=PARTS - 1)
    items: int = parameter(0, 'number of items that were seen', minimum=0)
    passages: tuple[PassParts, ...] = parameter((), 'passes from which weights are learned')
    fit: Fit | None = parameter(None, 'learned weights')
    recent: tuple[Array, ...] = parameter((), 'residuals of the last items', unit='kg')
    change: Change | None = parameter(None, 'change of the machine since the weights were learned')

    def __post_init__(self) -> None:
        if self.fit and {len(each) for each in self.recent} - {len(self.fit.weights)}:
            raise SettingsError('the residuals and the weights differ in length', 'recent')

    @property
    def weighs(self) -> bool:
        """Whether items are weighed by the learned weights."""
        return self.fit is not None and self.fit.trusted and self.change is None

    def has(self, window: WeighWindow) -> bool:
        """Return whether the item of a window is of this kind."""
        return (
            abs(window.belt_speed - self.speed) <= _SAME_SPEED * self.speed
            and abs(window.product_length - self.length) <= _SAME_LENGTH * self.length
        )


@dataclass(frozen=True, eq=False)
class LearnedKinds(Settings):
    """State that was learned from all kinds of items, in the order in which they were last seen.

    The state belongs to the estimator and the parameters that `basis` describes.
    """

    basis: str = parameter(text='estimator with its parameters')
    kinds: tuple[ItemKind, ...] = parameter((), 'kinds of items')

    @classmethod
    def prepared(cls, content: Any) -> Any:
        """Return the content of a file without the entry `version`, which older files have.

        A content that is not a mapping is returned unchanged.
        """
        if not isinstance(content, dict):
            return content
        return {key: value for key, value in content.items() if key != 'version'}


def learned_load(known: LearnedKinds, window: WeighWindow, load: LoadEstimate) -> LoadEstimate:
    """Return the load in a window by the learned weights, or `load` if they are not used.

    `load` is the result of the estimator. The weights are not used if the item is of an unknown
    kind, `ItemKind.weighs` is False, or the signal before t1 is too short for them.
    """
    kind = _kind_of(known, window)
    if kind is None or kind.fit is None or not kind.weighs:
        return load
    passage = passage_of(window, load, kind.rise)
    if passage is None or passage.lead < kind.fit.lead:
        return load
    mass, worse = kind.fit.mass(passage), max(passage.zero_variance - kind.fit.zero_variance, 0.0)
    variance, b1 = kind.fit.variance + worse, load.b1 * (mass / load.mass)
    return replace(load, mass=mass, variance=variance, b1=b1, measured=True)


def learn(
    known: LearnedKinds, window: WeighWindow, load: LoadEstimate, parameters: LearningParameters
) -> LearnedKinds:
    """Return the learned state after an item, or `known` if its pass cannot be divided into parts.

    `load` is the load that the estimator found in the window of the item.
    """
    kind = _kind_of(known, window) or ItemKind(
        window.belt_speed, window.product_length, rise_parts_of(window)
    )
    passage = passage_of(window, load, kind.rise) if kind.rise else None
    if passage is None:
        return known
    taught = _taught(_compared(kind, passage, window.item_id, parameters), passage, parameters)
    others = tuple(each for each in known.kinds if not each.has(window))
    return replace(known, kinds=(*others, taught)[-parameters.kinds :])


def _kind_of(known: LearnedKinds, window: WeighWindow) -> ItemKind | None:
    return next((each for each in reversed(known.kinds) if each.has(window)), None)


def _compared(
    kind: ItemKind, passage: PassParts, item_id: int, parameters: LearningParameters
) -> ItemKind:
    known = kind.fit
    if known is None or kind.change is not None:
        return kind
    if passage.lead < known.lead or not is_comparable(known, passage.load):
        return kind
    recent = (*kind.recent, known.residual(passage))[-RECENT:]
    change = find_change(known, recent, passage.duration, item_id)
    if change is None:
        return replace(kind, recent=recent)
    if parameters.relearn:
        return ItemKind(kind.speed, kind.length, kind.rise)
    return replace(kind, recent=(), passages=(), change=change)


def _taught(kind: ItemKind, passage: PassParts, parameters: LearningParameters) -> ItemKind:
    """Return the state of a kind of items after one more item.

    Weights are learned from item ``fewest`` to item ``most``, at every fifth item (`_STEP`) and at
    item ``most``. After item ``most`` or a change of the machine, the item is only counted.
    """
    if kind.change is not None or kind.items >= parameters.most:
        return replace(kind, items=kind.items + 1)
    items, passages = kind.items + 1, (*kind.passages, passage)
    late = items - parameters.fewest
    if late < 0 or (late % _STEP and items != parameters.most):
        return replace(kind, items=items, passages=passages)
    taught = fit(passages, kind.rise)
    if items == parameters.most:
        passages = ()
    recent = kind.recent if taught and kind.fit and taught.lead == kind.fit.lead else ()
    return replace(kind, items=items, passages=passages, fit=taught, recent=recent)
