# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reasons why items are rejected, and why the line stops, with hints for the technician."""

from enum import StrEnum


class Reason(StrEnum):
    """Reason why an item cannot be weighed, or is rejected even if its mass is within the limits.

    The names ``DistanceFault``, ``MeanValueRequirement`` and ``TU1Quota`` are taken from OPC 40200,
    the OPC UA specification for weighing technology.
    """

    DISTANCE_FAULT = 'DistanceFault'
    MISSING_EDGE = 'MissingEdge'
    CHATTERING_EYE = 'ChatteringEye'
    PRODUCT_TOO_LONG = 'ProductTooLong'
    PRODUCT_TOO_SHORT = 'ProductTooShort'
    BELT_SPEED = 'BeltSpeed'
    WINDOW_TOO_SHORT = 'WindowTooShort'
    SAMPLES_LOST = 'SamplesLost'
    SATURATION = 'Saturation'
    SOURCE_RESTARTED = 'SourceRestarted'
    STREAM_ENDED = 'StreamEnded'
    SPEED_NOT_TRAINED = 'SpeedNotTrained'
    NO_CONVERGENCE = 'NoConvergence'
    NO_LOAD = 'NoLoad'
    BAD_WINDOW = 'BadWindow'
    BAD_SIGNAL = 'BadSignal'
    NO_ESTIMATE = 'NoEstimate'
    UNKNOWN_ITEM = 'UnknownItem'
    LATE_EDGE = 'LateEdge'
    PRODUCT_ASKEW = 'ProductAskew'
    BELT_SPEED_CHANGED = 'BeltSpeedChanged'
    BELT_STOPPED = 'BeltStopped'
    START_UP = 'StartUp'
    CLOCK_JUMP = 'ClockJump'
    ZERO_OUT_OF_RANGE = 'ZeroOutOfRange'
    NO_PRODUCT = 'NoProduct'
    OVERLOAD = 'Overload'
    FOREIGN_PUBLISHER = 'ForeignPublisher'
    EDGE_MISMATCH = 'EdgeMismatch'
    MEAN_VALUE_REQUIREMENT = 'MeanValueRequirement'
    TU1_QUOTA = 'TU1Quota'
    GUARD_BAND = 'GuardBand'
    METAL_DETECTED = 'MetalDetected'
    XRAY_DETECTED = 'XrayDetected'
    VISION_REJECTED = 'VisionRejected'
    EXTERNAL_REJECT = 'ExternalReject'
    NOT_INSPECTED = 'NotInspected'
    PERFORMANCE_TEST = 'PerformanceTest'
    STAGE_FAILED = 'StageFailed'

    @property
    def hint(self) -> str:
        """One-line advice for the technician on this reason."""
        return _HINTS[self]


class StopReason(StrEnum):
    """Reason why the reject node requests a stop of the line."""

    TOO_MANY_REJECTS = 'TooManyRejects'
    UNCONFIRMED_REJECT = 'UnconfirmedReject'
    CONFIRMED_ACCEPT = 'ConfirmedAccept'
    DRIVER_TROUBLE = 'DriverTrouble'
    NOT_READY = 'NotReady'
    GUARD_OPEN = 'GuardOpen'
    AIR_PRESSURE = 'AirPressure'
    BIN_FULL = 'BinFull'
    INSPECTION_FAULT = 'InspectionFault'
    MISSED_EXTERNAL_REJECT = 'MissedExternalReject'
    PERFORMANCE_TEST = 'PerformanceTest'
    NO_ITEMS = 'NoItems'
    FOREIGN_PUBLISHER = 'ForeignPublisher'
    STAGE_FAILED = 'StageFailed'
    ZERO_STEP = 'ZeroStep'
    UNKNOWN = 'Unknown'

    @property
    def hint(self) -> str:
        """One-line advice for the technician on this reason."""
        return _STOP_HINTS[self]


def hint_of(reason: str) -> str:
    """Return the hint for a reason why an item was rejected.

    If `reason` is not a `Reason`, because another version sent the message, the hint states that
    this version does not know the reason.
    """
    known = reason in Reason.__members__.values()
    return Reason(reason).hint if known else 'a reason that this version does not know'


_HINTS = {
    Reason.DISTANCE_FAULT: 'two products were on the weigh belt at once; increase their spacing',
    Reason.MISSING_EDGE: 'a photo-eye did not switch, or the product was taken off the belt',
    Reason.CHATTERING_EYE: 'a photo-eye switched too often; check for reflections and loose film',
    Reason.PRODUCT_TOO_LONG: 'the product is longer than the recipe allows or than the belt',
    Reason.PRODUCT_TOO_SHORT: 'the product is shorter than the recipe or min_product_length',
    Reason.BELT_SPEED: 'outside the belt speeds of the recipe or min_belt_speed..max_belt_speed',
    Reason.WINDOW_TOO_SHORT: 'the product was fully on the belt for too few samples',
    Reason.SAMPLES_LOST: 'samples are missing; check processor load, cable and network',
    Reason.SATURATION: 'the converter was at its limit; check the load and the load-cell wiring',
    Reason.SOURCE_RESTARTED: 'the sample source restarted while the product was on the line',
    Reason.STREAM_ENDED: 'the stream ended before the product had left the belt',
    Reason.SPEED_NOT_TRAINED: 'no training passes near this belt speed; run tune at this speed',
    Reason.NO_CONVERGENCE: 'the signal gives no plausible mass; check the belt for vibration',
    Reason.NO_LOAD: 'the load cell measured no load; check the sign of counts_per_kg and the zero',
    Reason.BAD_WINDOW: 'the fields of the weigh window contradict each other',
    Reason.BAD_SIGNAL: 'the signal is constant, jumps or repeats itself; check the converter',
    Reason.NO_ESTIMATE: 'no mass arrived in time for the rejector; check that all stages run',
    Reason.UNKNOWN_ITEM: 'a mass arrived for an unknown item; check for a second line',
    Reason.LATE_EDGE: 'an edge arrived after later edges; check clock and wiring of the photo-eyes',
    Reason.PRODUCT_ASKEW: 'the length is that of an askew product; check the product guides',
    Reason.BELT_SPEED_CHANGED: 'the speed differs from the last item; normal once after a change',
    Reason.BELT_STOPPED: 'below half the speed of the previous item; belt stopped or edges lost',
    Reason.START_UP: 'the product was on the line before the first sample; weigh it again',
    Reason.CLOCK_JUMP: 'stamp and index of the samples disagree; check the clock of the source',
    Reason.ZERO_OUT_OF_RANGE: 'the zero left its range or jumped; clean the belt and set the zero',
    Reason.EDGE_MISMATCH: 'load and edges differ in time; check clocks, filter and eye positions',
    Reason.MEAN_VALUE_REQUIREMENT: 'the mean of the batch would be below nominal; check the filler',
    Reason.GUARD_BAND: 'within the limits, but too uncertain for the guard band of the recipe',
    Reason.TU1_QUOTA: 'below TU1, and the quota of the batch is used up; check the filler',
    Reason.NO_PRODUCT: 'no product is selected, so there are no limits; select a product',
    Reason.OVERLOAD: 'the load exceeded the load-cell capacity; check load and calibration',
    Reason.FOREIGN_PUBLISHER: 'a node outside this line publishes its topics; stop that node',
    Reason.METAL_DETECTED: 'the metal detector rejected the item',
    Reason.XRAY_DETECTED: 'the X-ray inspection rejected the item',
    Reason.VISION_REJECTED: 'the vision inspection rejected the item',
    Reason.EXTERNAL_REJECT: 'an inspection device rejected the item',
    Reason.NOT_INSPECTED: 'an inspection device did not run, or answered too late; see inspections',
    Reason.PERFORMANCE_TEST: 'the item passed during a performance test, as a test product does',
    Reason.STAGE_FAILED: 'the program failed on this item; report the log and a bag of the item',
}
# Stop reasons have a separate table, because a `Reason` and a `StopReason` of the same value would
# be the same key.
_STOP_HINTS = {
    StopReason.TOO_MANY_REJECTS: 'max_rejects_in_a_row consecutive products were rejected',
    StopReason.UNCONFIRMED_REJECT: 'a rejected product did not pass reject_eye; check the rejector',
    StopReason.CONFIRMED_ACCEPT: 'an accepted product passed reject_eye; check the actuator delay',
    StopReason.DRIVER_TROUBLE: 'the driver reports a fault of load cell, eyes, inputs or outputs',
    StopReason.NOT_READY: 'reject is not active and gives no verdicts; activate or restart it',
    StopReason.GUARD_OPEN: 'a guard of the machine is open; close it',
    StopReason.AIR_PRESSURE: 'the air pressure of the rejector is too low; check the supply',
    StopReason.BIN_FULL: 'a bin for rejected products is full; empty it',
    StopReason.INSPECTION_FAULT: 'an inspection device is not ready; check it',
    StopReason.MISSED_EXTERNAL_REJECT: 'an item that a device rejected may have passed; find it',
    StopReason.PERFORMANCE_TEST: 'the performance test is overdue or failed; repeat it',
    StopReason.NO_ITEMS: 'items leave the belt, but segmenter announces none; restart it',
    StopReason.FOREIGN_PUBLISHER: 'a foreign node publishes topics of this line; stop that node',
    StopReason.STAGE_FAILED: 'the program failed on two items in a row; report the log and a bag',
    StopReason.ZERO_STEP: 'the zero has jumped; clear the belt, then set the zero',
    StopReason.UNKNOWN: 'this version does not know the reason of the stop request',
}
