# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = 'checkweigher_core'

setup(
    name=package_name,
    version='1.0.0',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={package_name: ['py.typed', 'ros/*.xml']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='Checkweigher maintainers',
    maintainer_email='maintainers@checkweigher.example',
    description='Shared code of all packages: records, parameters, settings files and ROS layer.',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
)
