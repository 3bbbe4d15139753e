# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Tables of the services and actions of a lane, each with its type, server, clients and effect.

The security policy, the page and the docs use these tables.
"""

from typing import NamedTuple

from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import NODES

_TRIGGER = 'std_srvs/srv/Trigger'
# Names of nodes that are not part of the line.
PAGE_WORK, SETTING, REPORTER = 'page_work', ports.DYNAMIC_SETTING.name, 'batch_reporter'
VERIFIER, VERIFY = ports.VERIFICATION_PROGRESS.maker, ports.VERIFICATION.maker
TECHNICIAN = 'technician'  # node of the commands that call services and actions
AT_WORK = PAGE_WORK, TECHNICIAN  # nodes by which a person works on a machine
OF_MACHINE = SETTING, VERIFIER  # nodes that assist the line and publish diagnostics
GATEWAYS = 'gateway_metrics', 'gateway_mqtt', 'gateway_opcua'
# Nodes by which the gateways call services. These nodes may call the same services as the page.
GATEWAY_WORK = 'gateway_mqtt_work', 'gateway_opcua_work'
LIFE_CYCLE_NODES = ('driver', 'reject')

# Names of the services and topics of an action, in the namespace of the action.
ACTION_SERVICES = 'send_goal', 'cancel_goal', 'get_result'
ACTION_TOPICS = 'feedback', 'status'

# Services that rclpy creates for each node, in the namespace of the node.
SETTER = 'set_parameters_atomically'
PARAMETER_SERVICES = (
    'describe_parameters',
    'get_parameter_types',
    'get_parameters',
    'list_parameters',
    'set_parameters',
    SETTER,
)
NODE_SERVICES = (*PARAMETER_SERVICES, 'get_type_description')
LIFE_CYCLE_SERVICES = (
    'change_state',
    'get_state',
    'get_available_states',
    'get_available_transitions',
    'get_transition_graph',
)


class Service(NamedTuple):
    """Service or action of a lane."""

    name: str  # name relative to the namespace of the lane
    kind: str  # ROS name of the type
    server: str  # node with the server
    callers: tuple[str, ...]  # nodes with clients
    text: str  # effect of a call
    condition: str = ''  # parameter or option that enables the service; empty if always available
    changes_line: bool = True  # whether the audit log names the user who calls the service


# fmt: off
ACTIONS = (
    Service(ports.READ_LOAD, 'checkweigher_msgs/action/ReadLoad', 'driver',
            AT_WORK, 'reads the empty belt, or a known mass on it, at rest for a '
            '[calibration](#calibration)'),
    Service(ports.RECORD_PASSES, 'checkweigher_msgs/action/RecordPasses', SETTING,
            AT_WORK, 'records passes of a product of known mass; see '
            '[Dynamic setting](#dynamic-setting)'),
    Service(ports.TUNE_PASSES, 'checkweigher_msgs/action/TunePasses', SETTING,
            AT_WORK, 'trains the estimators on all recorded passes'),
    Service(ports.RUN_VERIFICATION, 'checkweigher_msgs/action/RunVerification', VERIFIER,
            AT_WORK, 'guides an operator through a '
            '[verification](verification.md#on-the-page) according to a plan'),
)
SERVICES = (
    Service(ports.ZERO, _TRIGGER, 'segmenter', (PAGE_WORK, VERIFY),
            'sets the zero to the reading of the next empty belt at rest'),
    Service(ports.RESET_OUTPUTS, _TRIGGER, 'driver', (),
            'clears the stop after products that the rejector may have missed, as '
            '`reset_stop_request` does', 'outputs'),
    Service(ports.FORGET_LEARNED, _TRIGGER, 'identifier', (),
            'deletes the values learned from products of unknown mass; masses are not corrected by '
            'learned values until enough products have passed again'),
    Service(ports.RESET_STOP_REQUEST, _TRIGGER, 'reject', (PAGE_WORK,),
            'clears the stop request and the count of consecutive rejects; a cause that persists '
            '(driver, input, performance test, publisher, zero step) requests a stop again'),
    Service(ports.CALIBRATE_ZERO, _TRIGGER, 'driver', (),
            'deprecated: use the action `read_load` with the mass 0'),
    Service(ports.CALIBRATE_SPAN, 'checkweigher_msgs/srv/CalibrateSpan', 'driver', (),
            'deprecated: use the action `read_load`'),
    Service(ports.FINISH_CALIBRATION, 'checkweigher_msgs/srv/FinishCalibration', 'driver',
            AT_WORK,
            'computes zero and sensitivity from the readings, writes them as the next version of '
            '`calibration.file`, and applies them'),
    Service(ports.CANCEL_CALIBRATION, _TRIGGER, 'driver', AT_WORK,
            'discards the readings of a calibration'),
    Service(ports.RECORD_PASSES, 'checkweigher_msgs/srv/RecordPasses', SETTING, (),
            'deprecated: begins the same work as the action of this name; use the action'),
    Service(ports.TUNE_PASSES, _TRIGGER, SETTING, (),
            'deprecated: begins the same work as the action of this name; use the action'),
    Service(ports.CANCEL_PASSES, _TRIGGER, SETTING, (PAGE_WORK,),
            'cancels a recording or training that is in progress; otherwise deletes the learned '
            'parameters'),
    Service(ports.SHOW_TUNED, _TRIGGER, SETTING, AT_WORK,
            'returns the accuracy of the learned parameters on held-out passes, one line for each '
            'estimator and speed', changes_line=False),
    Service(ports.ACCEPT_TUNED, _TRIGGER, SETTING, AT_WORK,
            'writes the learned parameters to the parameter file, which the next start reads'),
    Service(ports.RESTART_LINE, _TRIGGER, SETTING, (PAGE_WORK,),
            'ends the nodes of the line in order and starts them again; they then read the '
            'parameter files', '`run --folder`'),
    Service(ports.BEGIN_VERIFICATION, 'checkweigher_msgs/srv/BeginVerification', VERIFIER, (),
            'deprecated: use the action `run_verification`'),
    Service(ports.ANSWER_VERIFICATION, 'checkweigher_msgs/srv/AnswerVerification', VERIFIER,
            AT_WORK, 'performs or skips the requested step, or goes on after a '
            'failed step'),
    Service(ports.CANCEL_VERIFICATION, _TRIGGER, VERIFIER, (),
            'deprecated: cancel the action `run_verification` instead'),
    Service(ports.SELECT_PRODUCT, 'checkweigher_msgs/srv/SelectProduct', 'product', (PAGE_WORK,),
            'sets the parameters of `denoise`, `identifier` and `reject` for a product, all of '
            'them or none'),
    Service(ports.NEW_BATCH, 'checkweigher_msgs/srv/NewBatch', 'product', (PAGE_WORK,),
            'begins a batch with a new name; returns the statistics of the previous batch'),
    Service(ports.RESET_STATISTICS, 'checkweigher_msgs/srv/ResetStatistics', 'product', (),
            'resets the counts of the present product and batch; returns the previous counts'),
    Service(ports.BEGIN_TEST, 'checkweigher_msgs/srv/BeginTest', 'product', (PAGE_WORK,),
            'begins or cancels the [performance test](production.md#the-performance-test) of the '
            'product'),
    Service(ports.ACKNOWLEDGE_ALARMS, _TRIGGER, 'product', (PAGE_WORK,),
            'acknowledges all [alarms](topics.md#alarms), and removes those that have ended'),
    Service(ports.RECORD_CHANGE, 'checkweigher_msgs/srv/RecordChange', 'product',
             (*NODES, *OF_MACHINE, REPORTER, PAGE_WORK, TECHNICIAN),
             'writes an entry to the audit log; a node or the page calls it before it makes a '
             'change', '`audit_log`', changes_line=False),
)
# fmt: on

_CHANGES = {each.name for each in SERVICES if each.changes_line}


def changes_line(name: str) -> bool:
    """Return whether a call of a service changes the line. `name` may contain a namespace."""
    return name.rpartition('/')[2] in {*_CHANGES, 'change_state', 'set_parameters', SETTER}
