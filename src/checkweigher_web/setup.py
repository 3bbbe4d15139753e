# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

package_name = 'checkweigher_web'

setup(
    name=package_name,
    version='1.0.0',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={
        package_name: ['py.typed', '*.css', '*.js'],
        f'{package_name}.languages': ['*.po'],
    },
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
    ],
    install_requires=['setuptools'],
    zip_safe=True,
    maintainer='Checkweigher maintainers',
    maintainer_email='maintainers@checkweigher.example',
    description='The page at the line: masses, signals and diagnostics in a browser.',
    license='Apache-2.0',
    extras_require={'test': ['pytest']},
    entry_points={'console_scripts': ['page = checkweigher_web.server:main']},
)
