# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = 'checkweigher_dsp'

setup(
    name=package_name,
    version='1.0.0',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={package_name: ['py.typed']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='Checkweigher maintainers',
    maintainer_email='maintainers@checkweigher.example',
    description='The weighing: stages and estimators free of ROS, and the nodes around them.',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
    entry_points={
        'console_scripts': [
            'segmenter = checkweigher_dsp.nodes.segmenter:main',
            'denoise = checkweigher_dsp.nodes.denoise:main',
            'identifier = checkweigher_dsp.nodes.identifier:main',
            'reject = checkweigher_dsp.nodes.reject:main',
        ],
    },
)
