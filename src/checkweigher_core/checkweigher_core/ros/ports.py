# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table of the topics of a lane, called ports, each with message, publisher and subscribers.

Nodes, QoS checks, recordings and docs use this table. All names except /diagnostics are relative,
because each lane has its own namespace. The import of this module does not import rclpy, so that
programs without a node can read the table.
"""

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any, NamedTuple

from checkweigher_core import records

if TYPE_CHECKING:
    from rclpy.qos import QoSProfile


# Nodes of the line with their modules, in the order in which they are shut down. Each executable
# has the name of its node.
NODES = {
    'driver': 'checkweigher_driver.driver_node',
    'product': 'checkweigher_production.nodes.product',
    'segmenter': 'checkweigher_dsp.nodes.segmenter',
    'denoise': 'checkweigher_dsp.nodes.denoise',
    'identifier': 'checkweigher_dsp.nodes.identifier',
    'reject': 'checkweigher_dsp.nodes.reject',
}
# Nodes that weigh the items and give the verdicts.
STAGES = ('segmenter', 'denoise', 'identifier', 'reject')


class History(NamedTuple):
    """Number of messages that a publisher keeps, and their availability to late subscribers.

    `depth` is the number of messages. If `latched` is set, late subscribers may request the kept
    messages (durability transient local). If `stage_latched` is set, the nodes of the line request
    the kept messages.
    """

    depth: int
    latched: bool = False
    stage_latched: bool = False


# Samples, edges, windows and other events: no message may be lost. The depth is enough for 10 s of
# blocks that contain 10 ms of signal each.
STREAM = History(1000)
# States: only the latest message is valid.
STATE = History(1, latched=True, stage_latched=True)
# Items: a restarted node needs the earlier messages, whose items may still be on the belt.
ITEM_HISTORY = History(1000, latched=True, stage_latched=True)
# Results: a user may read earlier messages. Of the nodes of the line, only `product` requests
# earlier messages, and only if it records the batches.
RESULTS = History(1000, latched=True)
# Periodic messages: only the latest message is valid.
MOMENT = History(1)
FRESH_TIME = 0.35  # time in s after which a permission to run expires
_PROMISED = 0.75  # deadline and liveliness lease of the publisher, as a fraction of `Port.holds`


@dataclass(frozen=True)
class Port:
    """Topic with its message, publisher and subscribers."""

    name: str  # name relative to the lane, or absolute name with a slash
    message_type: str  # ROS name, such as std_msgs/msg/Empty
    record: type | None  # class of the records; None if the messages themselves are passed
    history: History
    maker: str  # publisher: a node or another party
    takers: tuple[str, ...]  # subscribers: nodes and other parties
    expected: tuple[str, ...]  # nodes whose absence is reported in the diagnostics
    text: str  # purpose of the topic
    holds: float = 0.0  # time in s for which a message is valid; 0 if it does not expire
    recorded: bool = True  # whether a bag of the lane contains the topic

    @cached_property
    def type(self) -> Any:
        """Message class of rclpy."""
        return interface(self.message_type)

    @cached_property
    def qos(self) -> 'QoSProfile':
        """Quality of service of the publisher."""
        return self._profile(latched=self.history.latched, share=_PROMISED)

    @cached_property
    def stage_qos(self) -> 'QoSProfile':
        """Quality of service of the subscriptions of the nodes of the line."""
        from rclpy.qos import ReliabilityPolicy

        profile = self._profile(latched=self.history.stage_latched, share=1.0)
        if self.holds:
            # Do not request that lost messages are sent again, which would delay later messages.
            profile.reliability = ReliabilityPolicy.BEST_EFFORT
        return profile

    def _profile(self, *, latched: bool, share: float) -> 'QoSProfile':
        """Return the profile of this port with the reliability RELIABLE.

        If `latched` is true, the durability is transient local, otherwise volatile. If messages
        expire, the deadline and the liveliness lease are the fraction `share` of `holds`.
        """
        from rclpy.duration import Duration
        from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy

        profile = QoSProfile(
            depth=self.history.depth,
            reliability=ReliabilityPolicy.RELIABLE,
            durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        )
        if self.holds:
            promised = Duration(seconds=share * self.holds)
            profile.deadline = profile.liveliness_lease_duration = promised
            profile.liveliness = LivelinessPolicy.AUTOMATIC
            profile.lifespan = Duration(seconds=self.holds)
        return profile


def interface(name: str) -> Any:
    """Return the Python class of a message, a service or an action by its ROS name."""
    package, folder, kind = name.split('/')
    return getattr(import_module(f'{package}.{folder}'), kind)


def misfit(offered: 'QoSProfile', asked: 'QoSProfile') -> str:
    """Return why two QoS profiles are incompatible, or an empty string if they are compatible."""
    from rclpy.qos import QoSCompatibility, qos_check_compatible

    compatibility, why = qos_check_compatible(
        _with_finite_times(offered), _with_finite_times(asked)
    )
    if compatibility != QoSCompatibility.ERROR:
        return ''
    return ', '.join(
        text.removeprefix('ERROR: ').lower()
        for text in why.strip('; ').split(';')
        if text.startswith('ERROR: ')
    )


def _with_finite_times(profile: 'QoSProfile') -> 'QoSProfile':
    """Return a profile whose infinite times are replaced by 0, which means unspecified.

    DDS reports an unspecified time of an endpoint as infinite. `qos_check_compatible` would treat
    an infinite time as a requirement.
    """
    from rclpy.duration import Duration, Infinite

    stated = copy(profile)
    for name in ('deadline', 'lifespan', 'liveliness_lease_duration'):
        if getattr(profile, name) == Infinite:
            setattr(stated, name, Duration())
    return stated


def fits(offered: 'QoSProfile', asked: 'QoSProfile') -> bool:
    """Return whether two QoS profiles are compatible."""
    return not misfit(offered, asked)


# fmt: off
LOAD_CELL_INFO = Port(
    'load_cell/info', 'checkweigher_msgs/msg/LoadCellInfo', records.LoadCell, STATE,
    'driver', ('segmenter', 'reject', 'product', 'users'), ('driver',),
    'Properties and calibration of the load cell, which also make a bag readable')
LOAD_CELL_SAMPLES = Port(
    'load_cell/samples', 'checkweigher_msgs/msg/LoadCellSamples', records.SampleBlock, STREAM,
    'driver', ('segmenter',), ('driver', 'segmenter'),
    'Blocks of raw readings; a jump of `first_index` means lost samples')
PHOTO_EYES = Port(
    'photo_eyes', 'checkweigher_msgs/msg/PhotoEyeEvent', records.EyeEdge, STREAM,
    'driver', ('segmenter', 'reject'), ('driver', 'segmenter', 'reject'), 'Edges of the photo-eyes')
REFERENCE_MASS = Port(
    'reference_mass', 'checkweigher_msgs/msg/ReferenceMass', records.Reference, STREAM,
    'driver', ('users',), (), 'True masses of the items, if a bag or the simulator provides them')
DRIVER_STATUS = Port(
    'load_cell/status', 'checkweigher_msgs/msg/StreamStatus', records.StreamStatus, STATE,
    'driver', ('segmenter', 'reject'), (),
    'Numbers of samples and edges sent, state of the stream, and faults of the machine')
ITEMS = Port(
    'items', 'checkweigher_msgs/msg/Item', records.Item, ITEM_HISTORY,
    'segmenter', ('reject', 'driver', 'users'), ('segmenter', 'reject'),
    'Each item twice: when its number is final, and when its edges are final')
WEIGH_WINDOW = Port(
    'weigh_window', 'checkweigher_msgs/msg/WeighWindow', records.WeighWindow, STREAM,
    'segmenter', ('denoise',), ('segmenter', 'denoise'),
    'Signal of each item, which is empty if the item cannot be weighed')
ZERO_SETTING = Port(
    'zero_setting', 'checkweigher_msgs/msg/ZeroSetting', records.ZeroChange, STATE,
    'segmenter', ('product', 'reject', 'users'), (),
    'Latest change of the zero by the service `zero`')
SEGMENTER_STATUS = Port(
    'segmenter/status', 'checkweigher_msgs/msg/StreamStatus', records.StreamStatus, STATE,
    'segmenter', ('driver', 'reject'), (),
    'Numbers of samples, edges and items processed, which pace a replay. Sent with the samples, '
    'when an item begins to leave, and in answer to each repeated `load_cell/status`')
DENOISED_WINDOW = Port(
    'denoised_window', 'checkweigher_msgs/msg/WeighWindow', records.WeighWindow, STREAM,
    'denoise', ('identifier',), ('denoise', 'identifier'),
    'Weigh window with raw and denoised signal')
MASS_ESTIMATE = Port(
    'mass_estimate', 'checkweigher_msgs/msg/MassEstimate', records.MassEstimate, RESULTS,
    'identifier', ('reject', 'product', 'users'), ('identifier', 'reject'),
    'Mass and standard deviation of each item, or the reasons why it has no mass')
VERDICT = Port(
    'verdict', 'checkweigher_msgs/msg/Verdict', records.Verdict, RESULTS,
    'reject', ('line', 'driver', 'product'), ('reject',), 'One verdict for each item')
REJECT_EYE = Port(
    'reject_eye', 'checkweigher_msgs/msg/PhotoEyeEvent', records.EyeEdge, STREAM,
    'machine', ('reject',), (),
    'Edges of an eye that only rejected items pass; the field `eye` is ignored')
STOP_REQUEST = Port(
    'stop_request', 'checkweigher_msgs/msg/StopRequest', records.StopRequest, STATE,
    'reject', ('line', 'driver', 'product'), (),
    'Whether the line must stop, and why; `reset_stop_request` clears a request')
PERMISSION = Port(
    'permission', 'checkweigher_msgs/msg/Permission', records.Permission, MOMENT,
    'reject', ('line', 'driver'), (),
    'Permission to run, ten times a second; the line stops if it is false or does not arrive',
    holds=FRESH_TIME, recorded=False)
# Heartbeats of stages. The segmenter needs no heartbeat, because its status serves the same
# purpose.
ALIVE = {
    stage: Port(
        f'{stage}/alive', 'std_msgs/msg/Empty', None, MOMENT, stage, ('reject',), (),
        'Heartbeat every 0.2 s for a `reject` in another process', recorded=False)
    for stage in ('denoise', 'identifier')
}
EXTERNAL_REJECT = Port(
    'external_reject', 'checkweigher_msgs/msg/ExternalReject', records.ExternalReject, STREAM,
    'machine', ('reject',), (),
    'Item that a metal detector, an X-ray or a vision inspection rejects; the driver publishes '
    'the rejects that its inputs show')
MACHINE_CONDITIONS = Port(
    'machine_conditions', 'checkweigher_msgs/msg/MachineConditions', records.MachineConditions,
    STATE, 'driver', ('reject',), (),
    'Faults of guards, air, bins and inspection devices, if the driver reads such inputs')
PRODUCT_ON_LINE = Port(
    'product_on_line', 'checkweigher_msgs/msg/ProductOnLine', records.ProductOnLine, STATE,
    'product', ('reject', 'users'), (),
    'Product, batch, limits and counts for the reject node, if the line has recipes; repeated '
    'with each verdict')
PRODUCT_IN_USE = Port(
    'product_in_use', 'checkweigher_msgs/msg/ProductOnLine', records.ProductOnLine, STATE,
    'reject', ('product', 'users'), (),
    'Limits that the reject node applies, without counts: those of `product_on_line` or, before '
    'its first message, those of the parameters')
PERFORMANCE_TEST = Port(
    'performance_test', 'checkweigher_msgs/msg/PerformanceTest', records.PerformanceTest, STATE,
    'product', ('reject', 'users'), (),
    'Due time of the performance test of the recipe, and result of the last test')
STATISTICS = Port(
    'statistics', 'checkweigher_msgs/msg/Statistics', records.Statistics, STATE,
    'product', ('users',), (),
    'Counts, mean and giveaway of the present product and batch, with each verdict')
VERIFICATION = Port(
    'verification', 'checkweigher_msgs/msg/VerificationStep', records.VerificationStep, STATE,
    'verify', ('users',), (), 'Plan and steps of a running verification')
FILLER_FEEDBACK = Port(
    'filler_feedback', 'checkweigher_msgs/msg/FillerFeedback', records.FillerFeedback, STATE,
    'product', ('filler', 'users'), (),
    'Correction of the filler set point in kg after each subgroup of items, if the recipe '
    'requires it')
BATCH_RESULT = Port(
    'batch_result', 'checkweigher_msgs/msg/BatchResult', records.BatchResult, STATE,
    'product', ('users',), (), 'Latest ended batch, with the path of its record')
ALARMS = Port(
    'alarms', 'checkweigher_msgs/msg/Alarms', records.Alarms, STATE,
    'product', ('users',), (),
    'Alarms whose cause still exists, and alarms that are not acknowledged')
DIAGNOSTICS = Port(
    '/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray', None, History(10),
    'every node', ('users',), (), 'Status once a second; see [Diagnostics](reasons.md#diagnostics)')
# `DYNAMIC_SETTING` is not in `ALL`, because the node `dynamic_setting` runs beside the line.
DYNAMIC_SETTING = Port(
    'dynamic_setting', 'checkweigher_msgs/msg/DynamicSetting', None, STATE,
    'dynamic_setting', ('users',), (),
    'State of the dynamic setting: recorded passes, learned file, or cause of a failure')
# `VERIFICATION_PROGRESS` is not in `ALL`, because it contains questions to an operator. The plan
# and the steps of a verification, which its bag needs, are on the topic `VERIFICATION`.
VERIFICATION_PROGRESS = Port(
    'verification_progress', 'checkweigher_msgs/msg/VerificationProgress',
    records.VerificationProgress, STATE, 'verifier', ('users',), (),
    'Progress of a verification that the page guides, and its question to the operator')
# All topics of the line, and the plan and steps of a verification. A replay reads only the first
# four topics of `ALL` from its bag.
ALL = (
    LOAD_CELL_INFO, LOAD_CELL_SAMPLES, PHOTO_EYES, REFERENCE_MASS, DRIVER_STATUS, ITEMS,
    WEIGH_WINDOW, SEGMENTER_STATUS, ZERO_SETTING, DENOISED_WINDOW, MASS_ESTIMATE, VERDICT,
    REJECT_EYE, EXTERNAL_REJECT, MACHINE_CONDITIONS, STOP_REQUEST, PERMISSION, *ALIVE.values(),
    PRODUCT_ON_LINE, PRODUCT_IN_USE, PERFORMANCE_TEST, STATISTICS, FILLER_FEEDBACK, BATCH_RESULT,
    ALARMS, VERIFICATION, DIAGNOSTICS,
)
# Topics of a lane to which the page always subscribes (results), and to which it subscribes while a
# viewer is connected (signals).
PAGE_RESULTS = (
    LOAD_CELL_INFO, PHOTO_EYES, REFERENCE_MASS, MASS_ESTIMATE, VERDICT, STATISTICS,
    FILLER_FEEDBACK, STOP_REQUEST, ALARMS, ZERO_SETTING,
)
PAGE_SIGNALS = (LOAD_CELL_SAMPLES, DENOISED_WINDOW)
# Topics of a lane to which the gateways subscribe, in addition to /diagnostics.
GATEWAY_RECORDS = (
    LOAD_CELL_INFO, VERDICT, STOP_REQUEST, PRODUCT_IN_USE, STATISTICS, ALARMS, ZERO_SETTING,
)
# fmt: on
RECORDED = tuple(port for port in ALL if port.recorded)
PLAYED = RECORDED[:4]

# Actions.
READ_LOAD, RUN_VERIFICATION = 'read_load', 'run_verification'
RECORD_PASSES, TUNE_PASSES = 'record_passes', 'tune_passes'
# Services of type std_srvs/srv/Trigger.
ZERO = 'zero'
RESET_STOP_REQUEST = 'reset_stop_request'
RESET_OUTPUTS = 'reset_outputs'
FORGET_LEARNED = 'forget_learned'
CALIBRATE_ZERO = 'calibrate_zero'
CANCEL_CALIBRATION = 'cancel_calibration'
RESTART_LINE = 'restart_line'
CANCEL_PASSES = 'cancel_passes'
SHOW_TUNED, ACCEPT_TUNED = 'show_tuned', 'accept_tuned'
CANCEL_VERIFICATION = 'cancel_verification'
# Services with other types, except acknowledge_alarms, which has the type std_srvs/srv/Trigger.
CALIBRATE_SPAN = 'calibrate_span'
FINISH_CALIBRATION = 'finish_calibration'
BEGIN_VERIFICATION, ANSWER_VERIFICATION = 'begin_verification', 'answer_verification'
RECORD_CHANGE = 'record_change'
SELECT_PRODUCT, NEW_BATCH = 'select_product', 'new_batch'
RESET_STATISTICS = 'reset_statistics'
BEGIN_TEST = 'begin_test'
ACKNOWLEDGE_ALARMS = 'acknowledge_alarms'
