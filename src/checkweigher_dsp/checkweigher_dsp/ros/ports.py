"""The ports of a lane: a row for each topic, and how each record stands in its message.

Nodes, QoS checks, recordings and docs read this table. All names are relative, so that a namespace
makes a lane. The module needs no ROS: message classes and QoS profiles are made when they are
asked for.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from importlib import import_module
import math
from typing import TYPE_CHECKING, Any

from checkweigher_dsp.reasons import StopReason
from checkweigher_dsp.records import (
    Decision,
    EyeEdge,
    LineHistory,
    LoadCell,
    MassEstimate,
    Reference,
    SampleBlock,
    StopRequest,
    StreamState,
    StreamStatus,
    Verdict,
    WeighWindow,
    ZeroChange,
)

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile


@dataclass(frozen=True)
class Form:
    """How a record stands in its message, where that is not field by field under the same names.

    Attributes
    ----------
    message_type : str
        As ROS names it, with ``/msg/`` or ``/srv/``.
    stamp : str
        Field of the record that is the stamp of the header; ``''`` where the caller gives the
        stamp. The field stands in the header alone unless `names` has it.
    frame : str or callable
        ``frame_id`` of the header, or how it follows from the record.
    names : mapping of str to str
        Field of the message by field of the record, where the names differ.
    lacks : tuple of str
        Fields of the record that the message does not have; a record that is read has the default.
    derived : mapping of str to callable
        Fields of the message that follow from the record.
    unknown : mapping of str to object
        What is taken for a value that an enumeration does not have, by field; without an entry
        such a message is refused.
    absent : mapping of str to object
        Fields of the message that says that there is no such record; empty if there is none.
    amend : callable, optional
        Takes the message and the fields of the record that is read, and corrects these.
    """

    message_type: str
    stamp: str = 'stamp'
    frame: str | Callable[[Any], str] = ''
    names: Mapping[str, str] = field(default_factory=dict)
    lacks: tuple[str, ...] = ()
    derived: Mapping[str, Callable[[Any], object]] = field(default_factory=dict)
    unknown: Mapping[str, object] = field(default_factory=dict)
    absent: Mapping[str, object] = field(default_factory=dict)
    amend: Callable[[Any, dict[str, Any]], None] | None = None


def _give_reason(message: Any, values: dict[str, Any]) -> None:
    """Give an estimate without a mass a reason, as that of a message that was not filled in."""
    weighed = message.status == _WEIGHED and not math.isnan(values['mass'])
    if not weighed and not values['reasons']:
        values['reasons'] = ('Unknown',)


_WEIGHED = 1  # of MassEstimate.status
_STOP, _RUN = 0, 1  # of StopRequest.state

FORMS: dict[type, Form] = {
    LoadCell: Form('checkweigher_msgs/msg/LoadCellInfo', stamp='', frame='load_cell'),
    SampleBlock: Form('checkweigher_msgs/msg/LoadCellSamples', frame='load_cell'),
    EyeEdge: Form('checkweigher_msgs/msg/PhotoEyeEvent', frame=lambda edge: edge.eye.name.lower()),
    Reference: Form('checkweigher_msgs/msg/ReferenceMass'),
    StreamStatus: Form('checkweigher_msgs/msg/StreamStatus', unknown={'state': StreamState.FAILED}),
    WeighWindow: Form(
        'checkweigher_msgs/msg/WeighWindow',
        stamp='t3',
        frame='weigh_belt',
        names={'t3': 't3', 'stamp': 'first_stamp'},
    ),
    MassEstimate: Form(
        'checkweigher_msgs/msg/MassEstimate',
        stamp='t3',
        frame='weigh_belt',
        names={'t3': 't3'},
        derived={'status': lambda estimate: int(estimate.weighed)},
        amend=_give_reason,
    ),
    Verdict: Form(
        'checkweigher_msgs/msg/Verdict',
        stamp='t3',
        frame='weigh_belt',
        unknown={'decision': Decision.FAULT},
    ),
    ZeroChange: Form('checkweigher_msgs/msg/ZeroSetting', frame='load_cell'),
    StopRequest: Form(
        'checkweigher_msgs/msg/StopRequest',
        frame='rejector',
        unknown={'reason': StopReason.UNKNOWN},
        lacks=('text',),
        derived={'state': lambda _: _STOP, 'hint': lambda request: request.hint},
        absent={'state': _RUN},
    ),
    LineHistory: Form('checkweigher_msgs/srv/LineHistory_Response'),
}


@dataclass(frozen=True)
class Port:
    """A topic with what passes there, who makes it and who takes it.

    Attributes
    ----------
    name : str
        Relative to the lane's namespace, unless it begins with a slash.
    record : type or None
        What passes; None if the message itself is all there is.
    makers, takers : tuple of str
        Nodes, and others outside the line.
    text : str
        What it is for, for the docs.
    expected : tuple of str
        Those of `makers` and `takers` that have to be there: the other end reports their absence.
    depth : int
        Of the queue.
    latched : bool
        Whether a late subscriber that asks for it (transient local) gets the last messages.
    stage_latched : bool
        Whether the stages ask for it: never where messages are from before they were there.
    message_type : str
        Of the form of `record`.
    """

    name: str
    record: type | None
    makers: tuple[str, ...]
    takers: tuple[str, ...]
    text: str
    expected: tuple[str, ...] = ()
    depth: int = 1000
    latched: bool = False
    stage_latched: bool = False
    message_type: str = ''

    def __post_init__(self) -> None:
        if self.record is not None:
            object.__setattr__(self, 'message_type', FORMS[self.record].message_type)

    @property
    def type(self) -> Any:
        """Class of the message in rclpy."""
        return message_class(self.message_type)

    @cached_property
    def qos(self) -> 'QoSProfile':
        """Profile that the publisher offers."""
        return _reliable(self.depth, latched=self.latched)

    @cached_property
    def stage_qos(self) -> 'QoSProfile':
        """Profile that the stages ask for."""
        return _reliable(self.depth, latched=self.stage_latched)


Topic = Port  # until no caller is left


def message_class(message_type: str) -> Any:
    """Return the class of a message in rclpy, by its name as ROS writes it."""
    package, folder, name = message_type.split('/')
    return getattr(import_module(f'{package}.{folder}'), name)


def _reliable(depth: int, *, latched: bool) -> 'QoSProfile':
    from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def fits(offered: 'QoSProfile', asked: 'QoSProfile') -> bool:
    """Tell whether a publisher and a subscription of these profiles connect."""
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    compatibility, _ = qos_check_compatible(offered, asked)
    return bool(compatibility != QoSCompatibility.ERROR)


def _state(
    name: str, record: type | None, makers: tuple[str, ...], takers: tuple[str, ...], text: str,
    expected: tuple[str, ...] = (), message_type: str = '',
) -> Port:  # fmt: skip
    """Return the port of something of which the last value counts."""
    return Port(name, record, makers, takers, text, expected, 1, True, True, message_type)


LOAD_CELL_INFO = _state(
    'load_cell/info', LoadCell, ('driver',), ('all',),
    'What the load cell is; a bag describes itself by it', ('driver',),
)  # fmt: skip
# Ten seconds of 10 ms blocks: a lost block is noticed by its index, but should not happen.
LOAD_CELL_SAMPLES = Port(
    'load_cell/samples', SampleBlock, ('driver',), ('segmenter',),
    'Blocks of raw readings; a jump of `first_index` means lost samples', ('driver', 'segmenter'),
)  # fmt: skip
PHOTO_EYES = Port(
    'photo_eyes', EyeEdge, ('driver',), ('segmenter', 'reject'),
    'Edges of the two eyes', ('driver', 'segmenter', 'reject'),
)  # fmt: skip
REFERENCE_MASS = Port(
    'reference_mass', Reference, ('driver',), ('users',),
    'True masses, where a bag or the simulator knows them',
)  # fmt: skip
DRIVER_STATUS = _state(
    'load_cell/status', StreamStatus, ('driver',), ('segmenter', 'reject'),
    'How much has been sent, how the stream ended, and what is wrong with the machine while it '
    'runs',
)  # fmt: skip
WEIGH_WINDOW = Port(
    'weigh_window', WeighWindow, ('segmenter',), ('denoise',),
    'One for each item, without signal if it cannot be weighed', ('segmenter', 'denoise'),
)  # fmt: skip
ZERO_SETTING = _state(
    'zero_setting', ZeroChange, ('segmenter',), ('product', 'users'),
    'The last change of the zero by the service `zero`',
)  # fmt: skip
SEGMENTER_STATUS = _state(
    'segmenter/status', StreamStatus, ('segmenter',), ('driver',),
    'How much has been taken; paces a replay. Comes with the samples, and whenever the driver asks '
    'by sending its own again',
)  # fmt: skip
DENOISED_WINDOW = Port(
    'denoised_window', WeighWindow, ('denoise',), ('identifier',),
    'The same with the denoised signal beside the raw one', ('denoise', 'identifier'),
)  # fmt: skip
# Results are kept for users who look later and ask for them; the stages do not.
MASS_ESTIMATE = Port(
    'mass_estimate', MassEstimate, ('identifier',), ('reject', 'users'),
    'Mass, standard deviation, or the reasons why there is none', ('identifier', 'reject'),
    latched=True,
)  # fmt: skip
VERDICT = Port(
    'verdict', Verdict, ('reject',), ('line', 'driver'), 'Exactly one for each item', ('reject',),
    latched=True,
)  # fmt: skip
REJECT_EYE = Port(
    'reject_eye', EyeEdge, ('machine',), ('reject',),
    'Edges of an eye that only rejected items pass; `eye` does not matter',
)  # fmt: skip
STOP_REQUEST = _state(
    'stop_request', StopRequest, ('reject',), ('line',),
    'Whether the line should stop, and why; stays until `reset_stop_request`',
)  # fmt: skip
STATISTICS = _state(
    'statistics', None, ('product',), ('users',),
    'Counts, mean, giveaway of this product in this batch, with each verdict',
    message_type='checkweigher_msgs/msg/Statistics',
)  # fmt: skip
DIAGNOSTICS = Port(
    '/diagnostics', None, ('every node',), ('users',),
    'once a second: see [Diagnostics](#diagnostics)', depth=10,
    message_type='diagnostic_msgs/msg/DiagnosticArray',
)  # fmt: skip

PARAMETER_EVENTS = Port(
    '/parameter_events',
    None,
    ('every node',),
    ('product',),
    'Parameters that were set',
    message_type='rcl_interfaces/msg/ParameterEvent',
)

# What a bag of a line holds: the first four are played again, all others follow from them.
ALL = (
    LOAD_CELL_INFO, LOAD_CELL_SAMPLES, PHOTO_EYES, REFERENCE_MASS, DRIVER_STATUS, WEIGH_WINDOW,
    SEGMENTER_STATUS, ZERO_SETTING, DENOISED_WINDOW, MASS_ESTIMATE, VERDICT, REJECT_EYE,
    STOP_REQUEST, STATISTICS, DIAGNOSTICS,
)  # fmt: skip
PLAYED = ALL[:4]

# Of the node dynamic_setting, which is no part of the line.
DYNAMIC_SETTING = _state(
    'dynamic_setting', None, ('dynamic_setting',), ('users',), 'Passes, files and failures',
    message_type='checkweigher_msgs/msg/DynamicSetting',
)  # fmt: skip
# The answer of the service of this name.
LINE_HISTORY = Port(
    'line_history', LineHistory, ('driver',), ('reject',),
    'The latest edges and verdicts of this stream',
)  # fmt: skip

# Services of type std_srvs/srv/Trigger.
RESET_STOP_REQUEST = 'reset_stop_request'
RESET_OUTPUTS = 'reset_outputs'
CALIBRATE_ZERO = 'calibrate_zero'
CANCEL_CALIBRATION = 'cancel_calibration'
TUNE_PASSES, CANCEL_PASSES = 'tune_passes', 'cancel_passes'
# Services of types of their own names.
CALIBRATE_SPAN = 'calibrate_span'
FINISH_CALIBRATION = 'finish_calibration'
RECORD_PASSES = 'record_passes'
