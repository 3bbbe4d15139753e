# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""The rim to ROS: ports, stage nodes, outputs, diagnostics. Only this room knows rclpy."""

import os
from pathlib import Path

# Before rclpy makes a context. A node that reaches a line by DDS can stop it and change its limits:
# those of other computers reach it only where that is wanted.
os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
# Who has profiles for Fast DDS keeps them.
if not {'FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE'} & os.environ.keys():
    _profiles = str(Path(__file__).with_name('fastdds_profiles.xml'))
    os.environ['FASTRTPS_DEFAULT_PROFILES_FILE'] = _profiles
    os.environ['RMW_FASTRTPS_USE_QOS_FROM_XML'] = '1'
