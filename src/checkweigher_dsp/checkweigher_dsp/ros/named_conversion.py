"""Messages to records and back.

Messages are made empty and then filled in: a message that is made of parts makes them all twice.

Reading takes any object with the fields of the message, so that the same functions serve rclpy
and readers of bags. Writing converts every field to the exact Python type: rclpy does not check,
and a numpy scalar in a field aborts the process when the message is serialised.
"""

import array
import math
from typing import Any

from builtin_interfaces.msg import Time
from checkweigher_msgs import msg as messages
import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from checkweigher_dsp.records import (
    NANOSECONDS,
    Decision,
    Eye,
    EyeEdge,
    LineHistory,
    LoadCell,
    MassEstimate,
    Reference,
    SampleBlock,
    StopRequest,
    Verdict,
    WeighWindow,
    ZeroChange,
)

_ESTIMATE_NUMBERS = (
    'mass', 'std_dev', 'zero', 'belt_speed', 'product_length', 'line_speed', 'a1', 'a2', 'b1',
    'natural_frequency', 'damping_ratio',
)  # fmt: skip
_WINDOW_NUMBERS = (
    'belt_speed', 'product_length', 'line_speed', 'sample_rate', 'counts_per_kg', 'zero_counts',
    'zero', 'zero_std_dev',
)  # fmt: skip


def stamp_from(time: Any) -> int:
    """Return a time message in ns."""
    return int(time.sec) * NANOSECONDS + int(time.nanosec)


def known_stamp_from(time: Any) -> int | None:
    """Return a time message in ns, None for the 0 that means it is not known."""
    return stamp_from(time) or None


def _set_time(time: Time, stamp: int | None) -> None:
    """Write a stamp in ns, 0 if it is not known or fits into no time message."""
    sec, nanosec = divmod(int(stamp or 0), NANOSECONDS)
    # An edge may come with a stamp past 2038, and even a good one can put reject_at there.
    if -(2**31) <= sec < 2**31:
        time.sec, time.nanosec = sec, nanosec


def _set_header(header: Header, stamp: int | None, frame_id: str) -> None:
    _set_time(header.stamp, stamp)
    header.frame_id = frame_id


def header_to(stamp: int | None, frame_id: str = '') -> Header:
    """Return a header with a stamp in ns."""
    header = Header()
    _set_header(header, stamp, frame_id)
    return header


def load_cell_from(message: Any) -> LoadCell:
    """Return the load cell of a LoadCellInfo; ValueError if it cannot be one."""
    return LoadCell(
        sample_rate=float(message.sample_rate),
        counts_per_kg=float(message.counts_per_kg),
        zero_counts=float(message.zero_counts),
        min_counts=int(message.min_counts),
        max_counts=int(message.max_counts),
        capacity=float(message.capacity),
        weigh_length=float(message.weigh_length),
        model=str(message.model),
        serial_number=str(message.serial_number),
    )


def load_cell_to(cell: LoadCell, stamp: int) -> messages.LoadCellInfo:
    """Return the LoadCellInfo of a load cell."""
    return messages.LoadCellInfo(
        header=header_to(stamp, 'load_cell'),
        model=cell.model,
        serial_number=cell.serial_number,
        sample_rate=float(cell.sample_rate),
        counts_per_kg=float(cell.counts_per_kg),
        zero_counts=float(cell.zero_counts),
        min_counts=int(cell.min_counts),
        max_counts=int(cell.max_counts),
        capacity=float(cell.capacity),
        weigh_length=float(cell.weigh_length),
    )


def samples_from(message: Any) -> SampleBlock:
    """Return the block of a LoadCellSamples."""
    return SampleBlock(
        stamp_from(message.header.stamp),
        int(message.first_index),
        _shared(message.counts, np.int32),
    )


def samples_to(block: SampleBlock) -> messages.LoadCellSamples:
    """Return the LoadCellSamples of a block."""
    message = messages.LoadCellSamples()
    _set_header(message.header, block.stamp, 'load_cell')
    message.first_index = int(block.first_index)
    message.counts = _array('i', block.counts)
    return message


def edge_from(message: Any) -> EyeEdge:
    """Return the edge of a PhotoEyeEvent; ValueError for an eye that does not exist."""
    return EyeEdge(stamp_from(message.header.stamp), Eye(message.eye), bool(message.blocked))


def edge_to(edge: EyeEdge) -> messages.PhotoEyeEvent:
    """Return the PhotoEyeEvent of an edge."""
    message = messages.PhotoEyeEvent()
    _set_header(message.header, edge.stamp, edge.eye.name.lower())
    message.eye = int(edge.eye)
    message.blocked = bool(edge.blocked)
    return message


def reference_from(message: Any) -> Reference:
    """Return the reference of a ReferenceMass."""
    return Reference(stamp_from(message.header.stamp), float(message.mass))


def reference_to(reference: Reference) -> messages.ReferenceMass:
    """Return the ReferenceMass of a reference."""
    return messages.ReferenceMass(header=header_to(reference.stamp), mass=float(reference.mass))


def window_from(message: Any) -> WeighWindow:
    """Return the window of a WeighWindow message."""
    return WeighWindow(
        item_id=int(message.item_id),
        t1=known_stamp_from(message.t1),
        t2=known_stamp_from(message.t2),
        t3=known_stamp_from(message.t3),
        first_index=int(message.first_index),
        stamp=stamp_from(message.first_stamp),
        empty_begin=int(message.empty_begin),
        window_begin=int(message.window_begin),
        window_end=int(message.window_end),
        counts=_shared(message.counts, np.int32),
        denoised=_shared(message.denoised, np.float64),
        reasons=tuple(message.reasons),
        **{name: float(getattr(message, name)) for name in _WINDOW_NUMBERS},
    )


def window_to(window: WeighWindow) -> messages.WeighWindow:
    """Return the WeighWindow message of a window."""
    message = messages.WeighWindow()
    _set_header(message.header, window.t3, 'weigh_belt')
    message.item_id = int(window.item_id)
    _set_time(message.t1, window.t1)
    _set_time(message.t2, window.t2)
    _set_time(message.t3, window.t3)
    message.first_index = int(window.first_index)
    _set_time(message.first_stamp, window.stamp)
    message.empty_begin = int(window.empty_begin)
    message.window_begin = int(window.window_begin)
    message.window_end = int(window.window_end)
    message.counts = _array('i', window.counts)
    message.denoised = _array('d', window.denoised)
    message.reasons = list(window.reasons)
    for name in _WINDOW_NUMBERS:
        setattr(message, name, float(getattr(window, name)))
    return message


def estimate_from(message: Any) -> MassEstimate:
    """Return the estimate of a MassEstimate message.

    One without a mass and without reasons, as a message that nobody filled in, gets a reason.
    """
    reasons = tuple(message.reasons)
    weighed = message.status == messages.MassEstimate.WEIGHED and not math.isnan(message.mass)
    if not weighed and not reasons:
        reasons = ('Unknown',)
    return MassEstimate(
        item_id=int(message.item_id),
        t1=known_stamp_from(message.t1),
        t2=known_stamp_from(message.t2),
        t3=known_stamp_from(message.t3),
        reasons=reasons,
        estimator=str(message.estimator),
        **{name: float(getattr(message, name)) for name in _ESTIMATE_NUMBERS},
    )


def estimate_to(estimate: MassEstimate) -> messages.MassEstimate:
    """Return the MassEstimate message of an estimate."""
    message = messages.MassEstimate()
    _set_header(message.header, estimate.t3, 'weigh_belt')
    message.item_id = int(estimate.item_id)
    _set_time(message.t1, estimate.t1)
    _set_time(message.t2, estimate.t2)
    _set_time(message.t3, estimate.t3)
    message.status = message.WEIGHED if estimate.weighed else message.FAULT
    message.reasons = list(estimate.reasons)
    message.estimator = estimate.estimator
    for name in _ESTIMATE_NUMBERS:
        setattr(message, name, float(getattr(estimate, name)))
    return message


def verdict_from(message: Any) -> Verdict:
    """Return the verdict of a Verdict message; a decision that is not known is a FAULT."""
    known = message.decision in tuple(Decision)
    return Verdict(
        item_id=int(message.item_id),
        t3=known_stamp_from(message.header.stamp),
        decision=Decision(message.decision) if known else Decision.FAULT,
        reasons=tuple(message.reasons),
        mass=float(message.mass),
        std_dev=float(message.std_dev),
        lower_limit=float(message.lower_limit),
        upper_limit=float(message.upper_limit),
        reject_at=known_stamp_from(message.reject_at),
        t1=known_stamp_from(message.t1),
        estimate_id=int(message.estimate_id),
        late=bool(message.late),
    )


def verdict_to(verdict: Verdict) -> messages.Verdict:
    """Return the Verdict message of a verdict."""
    message = messages.Verdict()
    _set_header(message.header, verdict.t3, 'weigh_belt')
    message.item_id = int(verdict.item_id)
    message.decision = int(verdict.decision)
    message.reasons = list(verdict.reasons)
    message.mass = float(verdict.mass)
    message.std_dev = float(verdict.std_dev)
    message.lower_limit = float(verdict.lower_limit)
    message.upper_limit = float(verdict.upper_limit)
    _set_time(message.reject_at, verdict.reject_at)
    _set_time(message.t1, verdict.t1)
    message.estimate_id = int(verdict.estimate_id)
    message.late = bool(verdict.late)
    return message


def stop_request_to(request: StopRequest | None) -> messages.StopRequest:
    """Return the StopRequest message of a request, or of there being none."""
    message = messages.StopRequest
    if request is None:
        return message(state=message.RUN)
    return message(
        header=header_to(request.stamp, 'rejector'),
        state=message.STOP,
        reason=request.reason.value,
        hint=request.hint,
        item_id=int(request.item_id),
    )


def history_from(response: Any) -> LineHistory:
    """Return the history of a LineHistory response; ValueError for an eye that does not exist."""
    return LineHistory(
        stream=int(response.stream),
        stamp=stamp_from(response.header.stamp),
        first_edge=int(response.first_edge),
        edges=tuple(edge_from(edge) for edge in response.edges),
        verdicts=tuple(verdict_from(verdict) for verdict in response.verdicts),
    )


def fill_history(history: LineHistory, response: Any) -> Any:
    """Write a history into a LineHistory response and return it."""
    response.header = header_to(history.stamp)
    response.stream = int(history.stream)
    response.first_edge = int(history.first_edge)
    response.edges = [edge_to(edge) for edge in history.edges]
    response.verdicts = [verdict_to(verdict) for verdict in history.verdicts]
    return response


def zero_change_from(message: Any) -> ZeroChange:
    """Return the change of a ZeroSetting."""
    return ZeroChange(
        stamp_from(message.header.stamp),
        float(message.zero),
        float(message.previous),
        float(message.std_dev),
    )


def zero_change_to(change: ZeroChange) -> messages.ZeroSetting:
    """Return the ZeroSetting of a change."""
    return messages.ZeroSetting(
        header=header_to(change.stamp, 'load_cell'),
        zero=float(change.zero),
        previous=float(change.previous),
        std_dev=float(change.std_dev),
    )


def _shared(field: Any, kind: type) -> NDArray[Any]:
    """Return the values of a field, not to be written to: other nodes may have the same message."""
    values: NDArray[Any] = np.frombuffer(field, kind)
    values.flags.writeable = False
    return values


def _array(typecode: str, values: NDArray[Any]) -> 'array.array[Any]':
    """Return an array field: twenty times faster to assign than an ndarray."""
    return array.array(typecode, np.ascontiguousarray(values).tobytes())
