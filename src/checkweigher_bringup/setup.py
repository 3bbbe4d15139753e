# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

package_name = 'checkweigher_bringup'

setup(
    name=package_name,
    version='1.0.0',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/launch', sorted(glob('launch/*.launch.py'))),
        ('share/' + package_name + '/config', sorted(glob('config/*'))),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='Checkweigher maintainers',
    maintainer_email='maintainers@checkweigher.example',
    description='Launch files, parameters and recipes, the one-process line and the command line.',
    license='Apache-2.0',
    extras_require={'cluster': ['distributed'], 'test': ['pytest']},
    entry_points={
        'console_scripts': [
            'batch_reporter = checkweigher_bringup.batch_reporter:main',
            'dynamic_setting = checkweigher_bringup.commissioning.dynamic_setting:main',
            'line = checkweigher_bringup.line:main',
            'checkweigher = checkweigher_bringup.cli:main',
            'verifier = checkweigher_bringup.commissioning.verifier:main',
        ]
    },
)
