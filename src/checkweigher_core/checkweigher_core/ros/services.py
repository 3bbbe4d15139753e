# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Table of the services of a lane: each service with its type, server, clients and effect.

The security policy, the page and the docs use this table.
"""

from typing import NamedTuple

from checkweigher_core.ros import ports
from checkweigher_core.ros.ports import NODES

_TRIGGER = 'std_srvs/srv/Trigger'
# Names of nodes that are not part of the line.
PAGE_WORK, SETTING, REPORTER = 'page_work', ports.DYNAMIC_SETTING.name, 'batch_reporter'
VERIFIER, VERIFY = ports.VERIFICATION_PROGRESS.maker, ports.VERIFICATION.maker
# Nodes that publish diagnostics although they are not part of the line.
OF_MACHINE = SETTING, VERIFIER
GATEWAYS = 'gateway_metrics', 'gateway_mqtt', 'gateway_opcua'
# Nodes by which gateways act for persons and hosts, with the clients of the page.
GATEWAY_WORK = 'gateway_mqtt_work', 'gateway_opcua_work'
LIFE_CYCLE_NODES = ('driver', 'reject')

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
    """Service of a lane."""

    name: str  # relative to the namespace of the lane
    kind: str  # ROS name of the type
    server: str  # node with the server
    callers: tuple[str, ...]  # nodes with clients
    text: str  # effect of a call
    condition: str = ''  # parameter that enables the service; empty if it always exists
    changes_line: bool = True  # whether the page logs calls with the name of the user


# fmt: off
SERVICES = (
    Service(ports.ZERO, _TRIGGER, 'segmenter', (PAGE_WORK, VERIFY),
            'takes the next empty belt at rest for the zero'),
    Service(ports.RESET_OUTPUTS, _TRIGGER, 'driver', (),
            'forgets products that the rejector can have missed; `reset_stop_request` does so as '
            'well', 'outputs'),
    Service(ports.FORGET_LEARNED, _TRIGGER, 'identifier', (),
            'forgets what was learned from products of unknown mass; their masses are by the '
            'estimator alone until it is learned again'),
    Service(ports.RESET_STOP_REQUEST, _TRIGGER, 'reject', (PAGE_WORK,),
            'takes a stop request back, unless what is wrong with driver, guards, air, bins, '
            'inspection or performance test lasts; counts rejects from 0 again'),
    Service(ports.CALIBRATE_ZERO, _TRIGGER, 'driver', (PAGE_WORK,),
            'reads the empty belt at rest for a [calibration](#calibration)'),
    Service(ports.CALIBRATE_SPAN, 'checkweigher_msgs/srv/CalibrateSpan', 'driver', (PAGE_WORK,),
            'reads a known mass at rest'),
    Service(ports.FINISH_CALIBRATION, 'checkweigher_msgs/srv/FinishCalibration', 'driver',
            (PAGE_WORK,),
            'zero and sensitivity from what was read: written as the next version of '
            '`calibration.file`, and used at once'),
    Service(ports.CANCEL_CALIBRATION, _TRIGGER, 'driver', (PAGE_WORK,), 'forgets what was read'),
    Service(ports.RECORD_PASSES, 'checkweigher_msgs/srv/RecordPasses', SETTING, (PAGE_WORK,),
            'records passes of a product of known mass, see [Dynamic setting](#dynamic-setting)'),
    Service(ports.TUNE_PASSES, _TRIGGER, SETTING, (PAGE_WORK,), 'trains on all that was recorded'),
    Service(ports.CANCEL_PASSES, _TRIGGER, SETTING, (PAGE_WORK,),
            'ends recording or training, what was weighed is kept; else drops what was learned '
            'and waits'),
    Service(ports.SHOW_TUNED, _TRIGGER, SETTING, (PAGE_WORK,),
            'how accurate what was learned is, on passes that were held out; a line for each '
            'estimator and speed', changes_line=False),
    Service(ports.ACCEPT_TUNED, _TRIGGER, SETTING, (PAGE_WORK,), 'takes over what was learned'),
    Service(ports.RESTART_LINE, _TRIGGER, SETTING, (PAGE_WORK,),
            'ends the nodes of the line in order and starts them again, with the parameter files '
            'as they are then', '`run --folder`'),
    Service(ports.BEGIN_VERIFICATION, 'checkweigher_msgs/srv/BeginVerification', VERIFIER,
            (PAGE_WORK,), 'begins a [verification](verification.md#on-the-page) by a plan'),
    Service(ports.ANSWER_VERIFICATION, 'checkweigher_msgs/srv/AnswerVerification', VERIFIER,
            (PAGE_WORK,), 'make the step that is asked for, skip it, or go on after one that '
            'failed'),
    Service(ports.CANCEL_VERIFICATION, _TRIGGER, VERIFIER, (PAGE_WORK,),
            'breaks the verification off; its report has the steps that were made'),
    Service(ports.SELECT_PRODUCT, 'checkweigher_msgs/srv/SelectProduct', 'product', (PAGE_WORK,),
            'set the parameters of `denoise`, `identifier` and `reject` to those of a product, '
            'all or none'),
    Service(ports.NEW_BATCH, 'checkweigher_msgs/srv/NewBatch', 'product', (PAGE_WORK,),
            'begin a batch of another name; returns the statistics of the one that ends'),
    Service(ports.RESET_STATISTICS, 'checkweigher_msgs/srv/ResetStatistics', 'product', (),
            'count this product in this batch from 0; returns what was counted'),
    Service(ports.BEGIN_TEST, 'checkweigher_msgs/srv/BeginTest', 'product', (PAGE_WORK,),
            'begins the [performance test](production.md#the-performance-test) of the product, or '
            'breaks it off'),
    Service(ports.ACKNOWLEDGE_ALARMS, _TRIGGER, 'product', (PAGE_WORK,),
            'acknowledges all [alarms](topics.md#alarms); those that are over are gone'),
    Service(ports.RECORD_CHANGE, 'checkweigher_msgs/srv/RecordChange', 'product',
            (*NODES, *OF_MACHINE, REPORTER, PAGE_WORK, VERIFY),
            'writes a change into the audit log before it is made; the other nodes of the lane '
            'call it', '`audit_log`', changes_line=False),
)
# fmt: on

_CHANGES = {each.name for each in SERVICES if each.changes_line}


def changes_line(name: str) -> bool:
    """Return whether calls of a service change the line."""
    return name.rpartition('/')[2] in {*_CHANGES, 'change_state', 'set_parameters', SETTER}
