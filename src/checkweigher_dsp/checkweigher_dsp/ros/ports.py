"""The topics of a lane: name, type and quality of service, in one place for nodes and docs.

All names are relative, so that a namespace makes a lane.
"""

from dataclasses import dataclass

from checkweigher_msgs.msg import (
    DynamicSetting,
    LoadCellInfo,
    LoadCellSamples,
    MassEstimate,
    PhotoEyeEvent,
    ReferenceMass,
    Statistics,
    StopRequest,
    StreamStatus,
    Verdict,
    WeighWindow,
    ZeroSetting,
)
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.qos import (
    DurabilityPolicy,
    HistoryPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)


@dataclass(frozen=True)
class Topic:
    """A topic with the profile that its publisher offers.

    ``stage_qos`` is what the stages ask for: never messages from before they were there.
    """

    name: str
    type: type
    qos: QoSProfile
    stage_qos: QoSProfile


def fits(offered: QoSProfile, asked: QoSProfile) -> bool:
    """Tell whether a publisher and a subscription of these profiles connect."""
    compatibility, _ = qos_check_compatible(offered, asked)
    return bool(compatibility != QoSCompatibility.ERROR)


def _topic(name: str, message: type, qos: QoSProfile, stage_qos: QoSProfile | None = None) -> Topic:
    return Topic(name, message, qos, stage_qos or qos)


def _reliable(depth: int, durability: DurabilityPolicy = DurabilityPolicy.VOLATILE) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE,
        durability=durability,
    )


def _kept(depth: int) -> QoSProfile:
    return _reliable(depth, DurabilityPolicy.TRANSIENT_LOCAL)


_STREAM = _reliable(1000)

LOAD_CELL_INFO = _topic('load_cell/info', LoadCellInfo, _kept(1))
# Ten seconds of 10 ms blocks: a lost block is noticed by its index, but should not happen.
LOAD_CELL_SAMPLES = _topic('load_cell/samples', LoadCellSamples, _STREAM)
PHOTO_EYES = _topic('photo_eyes', PhotoEyeEvent, _STREAM)
REFERENCE_MASS = _topic('reference_mass', ReferenceMass, _STREAM)
WEIGH_WINDOW = _topic('weigh_window', WeighWindow, _STREAM)
DENOISED_WINDOW = _topic('denoised_window', WeighWindow, _STREAM)
# Results are kept for whoever looks later and asks for them; the stages do not.
MASS_ESTIMATE = _topic('mass_estimate', MassEstimate, _kept(1000), _STREAM)
VERDICT = _topic('verdict', Verdict, _kept(1000), _STREAM)
REJECT_EYE = _topic('reject_eye', PhotoEyeEvent, _STREAM)
STOP_REQUEST = _topic('stop_request', StopRequest, _kept(1))
STATISTICS = _topic('statistics', Statistics, _kept(1))
DRIVER_STATUS = _topic('load_cell/status', StreamStatus, _kept(1))
ZERO_SETTING = _topic('zero_setting', ZeroSetting, _kept(1))
SEGMENTER_STATUS = _topic('segmenter/status', StreamStatus, _kept(1))
# Of type std_srvs/srv/Trigger.
RESET_STOP_REQUEST = 'reset_stop_request'
RESET_OUTPUTS = 'reset_outputs'
CALIBRATE_ZERO = 'calibrate_zero'
CANCEL_CALIBRATION = 'cancel_calibration'
# Of types of their own names.
CALIBRATE_SPAN = 'calibrate_span'
FINISH_CALIBRATION = 'finish_calibration'
# Of type LineHistory.
LINE_HISTORY = 'line_history'
DIAGNOSTICS = _topic('/diagnostics', DiagnosticArray, _reliable(10))

# Of the node dynamic_setting, which is no part of the line.
DYNAMIC_SETTING = _topic('dynamic_setting', DynamicSetting, _kept(1))
RECORD_PASSES, TUNE_PASSES, CANCEL_PASSES = 'record_passes', 'tune_passes', 'cancel_passes'

ALL = (
    LOAD_CELL_INFO, LOAD_CELL_SAMPLES, PHOTO_EYES, REFERENCE_MASS, DRIVER_STATUS, WEIGH_WINDOW,
    SEGMENTER_STATUS, ZERO_SETTING, DENOISED_WINDOW, MASS_ESTIMATE, VERDICT, REJECT_EYE,
    STOP_REQUEST, STATISTICS, DIAGNOSTICS,
)  # fmt: skip
