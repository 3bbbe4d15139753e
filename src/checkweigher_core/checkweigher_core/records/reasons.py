# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Reasons for faults and rejects of items and for stops of the line, with hints for technicians."""

from enum import StrEnum


class Reason(StrEnum):
    """Reason why an item cannot be weighed, or why a batch rule, a device or a test rejects it.

    ``DistanceFault``, ``MeanValueRequirement`` and ``TU1Quota`` are terms of OPC 40200.
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
    METAL_DETECTED = 'MetalDetected'
    XRAY_DETECTED = 'XrayDetected'
    VISION_REJECTED = 'VisionRejected'
    EXTERNAL_REJECT = 'ExternalReject'
    NOT_INSPECTED = 'NotInspected'
    PERFORMANCE_TEST = 'PerformanceTest'
    STAGE_FAILED = 'StageFailed'

    @property
    def hint(self) -> str:
        """Advice for the technician."""
        return _HINTS[self]


class StopReason(StrEnum):
    """Reason why the line should stop."""

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
        """Advice for the technician."""
        return _STOP_HINTS[self]


def hint_of(reason: str) -> str:
    """Return the hint for a reason in a message, which may come from another version."""
    known = reason in Reason.__members__.values()
    return Reason(reason).hint if known else 'a reason that this version does not know'


_HINTS = {
    Reason.DISTANCE_FAULT: 'two products were on the weigh belt at once; increase their spacing',
    Reason.MISSING_EDGE: 'a photo-eye did not switch, or the product was taken off the belt',
    Reason.CHATTERING_EYE: 'a photo-eye switched too often; check for reflections and loose film',
    Reason.PRODUCT_TOO_LONG: 'longer than the recipe allows, or never fully on the weigh belt',
    Reason.PRODUCT_TOO_SHORT: 'shorter than the recipe or min_product_length allows',
    Reason.BELT_SPEED: 'the belt speed is outside the recipe or min_belt_speed..max_belt_speed',
    Reason.WINDOW_TOO_SHORT: 'the product was fully on the belt for too few samples',
    Reason.SAMPLES_LOST: 'samples are missing; check the load on the machine, cable and network',
    Reason.SATURATION: 'the converter was at its limit; check overload and load-cell wiring',
    Reason.SOURCE_RESTARTED: 'the sample source started again while the product was on the line',
    Reason.STREAM_ENDED: 'the stream ended before the product had left the belt',
    Reason.SPEED_NOT_TRAINED: 'no training passes near this belt speed; run tune at this speed',
    Reason.NO_CONVERGENCE: 'no stable platform or level in this signal; check what shakes the belt',
    Reason.NO_LOAD: 'the load cell saw no weight under the product; check its sign and zero',
    Reason.BAD_WINDOW: 'a weigh window arrived whose fields contradict each other',
    Reason.BAD_SIGNAL: 'the signal stands still, jumps or repeats itself; check the converter',
    Reason.NO_ESTIMATE: 'no mass came in time for the rejector; check that all stages run',
    Reason.UNKNOWN_ITEM: 'a mass came of an item that was never announced; is there a second line?',
    Reason.LATE_EDGE: 'an edge came after younger ones; check the clock and path of the photo-eyes',
    Reason.PRODUCT_ASKEW: 'the length is that of a product that lies askew; check its guidance',
    Reason.BELT_SPEED_CHANGED: 'another speed than the item before; expected once after a change',
    Reason.BELT_STOPPED: 'less than half the speed of the item before: stopped, or edges were lost',
    Reason.START_UP: 'the product was on the line before the first sample; run it again',
    Reason.CLOCK_JUMP: 'stamp and index of the samples disagree; check the clock of the source',
    Reason.ZERO_OUT_OF_RANGE: 'the empty belt is beyond its limits, or jumped; clean it, zero it',
    Reason.EDGE_MISMATCH: 'load and eyes differ in time; check clocks, filter, place of the eyes',
    Reason.MEAN_VALUE_REQUIREMENT: 'the mean of the batch would be below nominal; check the filler',
    Reason.TU1_QUOTA: 'below TU1, and the batch has as many as it may have; check the filler',
    Reason.NO_PRODUCT: 'no product is selected, so nothing says what to accept; check product',
    Reason.OVERLOAD: 'the load was above the capacity of the load cell; check both and calibration',
    Reason.FOREIGN_PUBLISHER: 'a node that is no part of this line publishes its topics; stop it',
    Reason.METAL_DETECTED: 'the metal detector rejected it',
    Reason.XRAY_DETECTED: 'the X-ray inspection rejected it',
    Reason.VISION_REJECTED: 'the vision inspection rejected it',
    Reason.EXTERNAL_REJECT: 'an inspection device rejected it',
    Reason.NOT_INSPECTED: 'an inspection device did not run, or answers too late; see inspections',
    Reason.PERFORMANCE_TEST: 'it passed during a performance test, as a test product does',
    Reason.STAGE_FAILED: 'the program failed on this item; report it with the log and a bag of it',
}
# A separate table, because reasons of both kinds may have the same value.
_STOP_HINTS = {
    StopReason.TOO_MANY_REJECTS: 'max_rejects_in_a_row products were rejected one after the other',
    StopReason.UNCONFIRMED_REJECT: 'a rejected product did not pass reject_eye; check the rejector',
    StopReason.CONFIRMED_ACCEPT: 'an accepted product passed reject_eye; check the actuator delay',
    StopReason.DRIVER_TROUBLE: 'the driver has trouble with load cell, photo-eyes or outputs',
    StopReason.NOT_READY: 'no verdicts come: reject is not active; activate it or start it again',
    StopReason.GUARD_OPEN: 'a guard of the machine is open; close it',
    StopReason.AIR_PRESSURE: 'the rejector has too little air; check the supply',
    StopReason.BIN_FULL: 'a bin for rejected products is full; empty it',
    StopReason.INSPECTION_FAULT: 'an inspection device is not ready; check it',
    StopReason.MISSED_EXTERNAL_REJECT: 'an inspection device rejected what may have passed; look',
    StopReason.PERFORMANCE_TEST: 'the performance test is overdue or failed; make it',
    StopReason.NO_ITEMS: 'items leave the belt and segmenter announces none; start it again',
    StopReason.FOREIGN_PUBLISHER: 'a stranger publishes topics of this line; stop that node',
    StopReason.STAGE_FAILED: 'the program failed on two items in a row; report it with log and bag',
    StopReason.ZERO_STEP: 'something lies on the belt or was taken off; clear it, call zero, reset',
    StopReason.UNKNOWN: 'a stop request came without a reason that this version knows',
}
