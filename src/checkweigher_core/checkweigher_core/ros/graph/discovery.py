# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""How the nodes find and hear each other: profiles for Fast DDS, made for each environment.

Nodes receive by UDP alone, on one computer too. With the shared memory of Fast DDS 2.14.5, the
largest messages of a node no longer arrived after processes that read them had been killed some 30
times (compare eProsima/Fast-DDS issue 5469).

Without multicast, Fast DDS contacts only the ports of the first four participants of an address. A
fifth and a sixth process on one computer would never find each other.
"""

from collections.abc import Mapping
from hashlib import blake2b
import ipaddress
import os
from pathlib import Path
import stat

PARTICIPANTS = 64  # processes of an address that are called on
_PORT_BASE, _DOMAIN_GAIN, _UNICAST, _PARTICIPANT_GAIN = 7400, 250, 10, 2  # RTPS 2.5, 9.6.2.3
# Files of Fast DDS for its shared memory are there, too, and gone when the computer starts again.
_FOLDER = Path(f'/dev/shm/checkweigher-{os.geteuid()}')
_PACKAGED = Path(__file__).parent.with_name('fastdds_profiles.xml')
_FILE, _QOS_FROM_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_PLACE = '      <!-- peers -->\n'


def set_profiles() -> None:
    """Have Fast DDS read the profiles made here, unless the user has set some."""
    given = [os.environ.get(name, '') for name in ('FASTDDS_DEFAULT_PROFILES_FILE', _FILE)]
    ours = (str(_PACKAGED), f'{_FOLDER}/')
    if any(each and not each.startswith(ours) for each in given):
        return
    os.environ[_FILE] = str(_written(profiles(os.environ)))
    os.environ[_QOS_FROM_FILE] = '1'


def _written(text: str) -> Path:
    """Return a file with profiles, which all processes of a user share.

    Where there can be none, it is the file of the package: no more than four processes of a
    computer are sure to find each other then.
    """
    path = _FOLDER / f'{blake2b(text.encode(), digest_size=8).hexdigest()}.xml'
    try:
        _FOLDER.mkdir(mode=0o700, exist_ok=True)
        found = _FOLDER.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            return _PACKAGED  # another user was there first
        if not path.exists():
            own = path.with_suffix(f'.{os.getpid()}')
            own.write_text(text, encoding='utf-8')
            own.replace(path)
    except OSError:
        return _PACKAGED
    return path


def profiles(environment: Mapping[str, str]) -> str:
    """Return the profiles as XML, with the ports to be called on where there is no multicast."""
    text = _PACKAGED.read_text(encoding='utf-8')
    return text.replace(_PLACE, _initial_peers(peers(environment)))


def peers(environment: Mapping[str, str]) -> list[tuple[str, int]]:
    """Return address and port of each participant to be called on, of this computer and others."""
    if environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') != 'LOCALHOST':
        return []
    named = environment.get('ROS_STATIC_PEERS', '').split(';')
    addresses = dict.fromkeys(['127.0.0.1', *filter(_is_ipv4, named)])
    domain = environment.get('ROS_DOMAIN_ID', '')
    number = int(domain) if domain.isdecimal() else 0
    first = _PORT_BASE + _DOMAIN_GAIN * number + _UNICAST
    ports = range(first, first + _PARTICIPANT_GAIN * PARTICIPANTS, _PARTICIPANT_GAIN)
    return [(address, port) for address in addresses for port in ports]


def _is_ipv4(text: str) -> bool:
    try:
        return bool(ipaddress.IPv4Address(text))
    except ValueError:
        return False


def _initial_peers(called: list[tuple[str, int]]) -> str:
    if not called:
        return ''
    locators = ''.join(
        f'        <locator><udpv4><port>{port}</port><address>{address}</address></udpv4>'
        '</locator>\n'
        for address, port in called
    )
    return f'      <builtin><initialPeersList>\n{locators}      </initialPeersList></builtin>\n'
