# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Latest records of a lane, and its PackML state."""

from dataclasses import dataclass, field
from enum import IntEnum
import math
from typing import Any

from checkweigher_core.records import (
    GRAMS,
    Alarm,
    Alarms,
    LoadCell,
    ProductOnLine,
    Statistics,
    StopRequest,
    Verdict,
)
from checkweigher_core.records.reasons import StopReason
from checkweigher_core.ros.ports import DIAGNOSTICS, STOP_REQUEST
from checkweigher_core.ros.status_board import number_of
from checkweigher_gateways.listening import Taken


class PackState(IntEnum):
    """Machine state, with the numbers of PackML (ISA-TR88.00.02)."""

    STOPPED = 2
    EXECUTE = 6
    ABORTED = 9
    HELD = 11

    @property
    def word(self) -> str:
        """Name of the state in PackML."""
        return self.name.capitalize()


@dataclass
class LaneState:
    """Latest records and diagnostics of a lane.

    A record is None until it is received. `stop` is also None while no stop is requested. `alarms`
    is empty until the first alarms are received. `zero` is the zero of the belt relative to the
    calibration, in kg. `zero` is NaN before the first diagnostics of the segmenter, and if the
    latest diagnostics do not contain the zero. `is_active` is false if the latest diagnostics of
    the driver report that the driver is inactive, and true before the first diagnostics.
    """

    name: str
    verdict: Verdict | None = None
    stop: StopRequest | None = None
    product: ProductOnLine | None = None
    statistics: Statistics | None = None
    load_cell: LoadCell | None = None
    alarms: tuple[Alarm, ...] = field(default=())
    zero: float = math.nan
    is_active: bool = True

    @property
    def pack_state(self) -> PackState:
        """PackML state of the lane.

        The state is STOPPED if the lane is not active. Otherwise, the state is EXECUTE without a
        stop request, ABORTED if the stop request has the reason DRIVER_TROUBLE, and HELD for any
        other stop request.
        """
        if not self.is_active:
            return PackState.STOPPED
        if self.stop is None:
            return PackState.EXECUTE
        trouble = self.stop.reason == StopReason.DRIVER_TROUBLE
        return PackState.ABORTED if trouble else PackState.HELD

    def deviation(self, verdict: Verdict) -> float:
        """Return the mass of an item minus the nominal mass in kg, or NaN if a mass is unknown.

        The nominal mass is known if the product of the item is still on the line and has a nominal
        mass.
        """
        product = self.product
        if product is None or product.product != verdict.product or not product.nominal > 0:
            return math.nan
        return verdict.mass - product.nominal

    def _take(self, record: Any) -> None:
        match record:
            case Verdict():
                self.verdict = record
            case ProductOnLine():
                self.product = record
            case Statistics():
                self.statistics = record
            case LoadCell():
                self.load_cell = record
            case Alarms():
                self.alarms = record.alarms


class LaneStates:
    """States of the lanes by namespace."""

    def __init__(self) -> None:
        self.lanes: dict[str, LaneState] = {}

    def of(self, lane: str) -> LaneState:
        """Return the state of a lane, which is created if the lane is new."""
        return self.lanes.setdefault(lane, LaneState(lane))

    def take(self, taken: Taken) -> None:
        """Update the states with a record of a lane, or with diagnostics."""
        if taken.port is DIAGNOSTICS:
            self._note(taken.record)
        elif taken.port is STOP_REQUEST:
            self.of(taken.lane).stop = taken.record
        else:
            self.of(taken.lane)._take(taken.record)

    def _note(self, message: Any) -> None:
        for status in message.status:
            lane, _, aspect = status.name.strip('/').rpartition('/')
            if (state := self.lanes.get(lane)) is None:
                continue
            values = {each.key: each.value for each in status.values}
            if aspect == 'driver: Source':
                state.is_active = values.get('state') != 'inactive'
            elif aspect == 'segmenter: Zero':
                state.zero = number_of(values.get('from_calibration_g', '')) / GRAMS
