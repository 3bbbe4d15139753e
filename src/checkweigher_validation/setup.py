# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = 'checkweigher_validation'

setup(
    name=package_name,
    version='1.0.0',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={
        package_name: ['py.typed'],
        f'{package_name}.accuracy': ['*.txt'],
        f'{package_name}.report': ['*.j2', '*.mplstyle'],
        f'{package_name}.verification': ['*.yaml', '*.json'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='Checkweigher maintainers',
    maintainer_email='maintainers@checkweigher.example',
    description='Offline: protocol, tuning, accuracy tables and classes, plots and reports.',
    license='Apache-2.0',
    extras_require={'cluster': ['distributed'], 'test': ['pytest']},
)
