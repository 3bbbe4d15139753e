"""The topics of a recording and the definitions of their messages, as they are installed."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from ament_index_python.packages import PackageNotFoundError, get_package_share_directory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


class BagError(ValueError):
    """A bag that cannot be used; one line that says which, where and what to do."""


@dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a lane.

    Attributes
    ----------
    name : str
        Relative to the lane's namespace, unless it begins with a slash.
    message_type : str
        As ROS names it, with ``/msg/``.
    latched : bool
        Whether a late subscriber still gets the last message.
    """

    name: str
    message_type: str
    latched: bool = False


LOAD_CELL_INFO = Topic('load_cell/info', 'checkweigher_msgs/msg/LoadCellInfo', latched=True)
SAMPLES = Topic('load_cell/samples', 'checkweigher_msgs/msg/LoadCellSamples')
PHOTO_EYES = Topic('photo_eyes', 'checkweigher_msgs/msg/PhotoEyeEvent')
REFERENCE_MASS = Topic('reference_mass', 'checkweigher_msgs/msg/ReferenceMass')
INPUT_TOPICS = (LOAD_CELL_INFO, SAMPLES, PHOTO_EYES, REFERENCE_MASS)
OUTPUT_TOPICS = (
    Topic('load_cell/status', 'checkweigher_msgs/msg/StreamStatus', latched=True),
    Topic('segmenter/status', 'checkweigher_msgs/msg/StreamStatus', latched=True),
    Topic('weigh_window', 'checkweigher_msgs/msg/WeighWindow'),
    Topic('denoised_window', 'checkweigher_msgs/msg/WeighWindow'),
    Topic('mass_estimate', 'checkweigher_msgs/msg/MassEstimate'),
    Topic('verdict', 'checkweigher_msgs/msg/Verdict'),
    Topic('reject_eye', 'checkweigher_msgs/msg/PhotoEyeEvent'),
    Topic('stop_request', 'checkweigher_msgs/msg/StopRequest', latched=True),
    Topic('zero_setting', 'checkweigher_msgs/msg/ZeroSetting', latched=True),
    Topic('statistics', 'checkweigher_msgs/msg/Statistics', latched=True),
    Topic('/diagnostics', 'diagnostic_msgs/msg/DiagnosticArray'),
)

TIME, HEADER = 'builtin_interfaces/msg/Time', 'std_msgs/msg/Header'
_INNER = {
    'diagnostic_msgs/msg/DiagnosticArray': (
        'diagnostic_msgs/msg/KeyValue', 'diagnostic_msgs/msg/DiagnosticStatus',
    ),
}  # fmt: skip


@cache
def typestore(topics: Sequence[Topic] = (*INPUT_TOPICS, *OUTPUT_TOPICS)) -> Typestore:
    """Return the definitions of the messages of some topics and of what they are made of.

    They are read from the installed packages, so a bag and the graph have the same types.

    Parameters
    ----------
    topics : tuple of Topic
        All that there are, or fewer: each definition takes its time.

    Raises
    ------
    BagError
        If a package with messages is not installed.
    """
    store = get_typestore(Stores.EMPTY)
    types = dict.fromkeys(topic.message_type for topic in topics)
    inner = [each for message_type in types for each in _INNER.get(message_type, ())]
    for message_type in (TIME, HEADER, *inner, *types):
        package, folder, name = message_type.split('/')
        try:
            share = get_package_share_directory(package)
            text = Path(share, folder, f'{name}.msg').read_text(encoding='utf-8')
        except (PackageNotFoundError, OSError):
            raise BagError(
                f'{message_type}: its definition is not installed; build the workspace and '
                'source its environment'
            ) from None
        store.register(get_types_from_msg(text, message_type))
    return store


def lane_prefix(namespace: str) -> str:
    """Return what stands before the names of a lane's topics, however its slashes were written."""
    return ''.join(f'/{part}' for part in namespace.split('/') if part)
