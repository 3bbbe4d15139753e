# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""XML profiles of Fast DDS for the discovery and the transport of the nodes.

Nodes receive messages only by UDP, even on one computer. With the shared memory of Fast DDS 2.14.5,
large messages of a node no longer arrived after about 30 processes that read them had been killed
(see eProsima/Fast-DDS issue 5469).

Without multicast, Fast DDS contacts only the ports of the first four participants (processes) at
each address, so a fifth and a sixth process on one computer would not discover each other. The
profiles therefore list the ports of more participants.
"""

from collections.abc import Mapping
from hashlib import blake2b
import ipaddress
import os
from pathlib import Path
import stat

PARTICIPANTS = 64  # number of processes at each address whose ports are listed
_PORT_BASE, _DOMAIN_GAIN, _UNICAST, _PARTICIPANT_GAIN = 7400, 250, 10, 2  # RTPS 2.5, 9.6.2.3
_PACKAGED = Path(__file__).parent.with_name('fastdds_profiles.xml')
# Folder of the profiles. The folder is in memory, so that old profiles are removed when the
# computer is restarted.
_FOLDER = Path(f'/dev/shm/checkweigher-{os.geteuid()}')
_FILE, _QOS_FROM_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE', 'RMW_FASTRTPS_USE_QOS_FROM_XML'
_PLACE = '      <!-- peers -->\n'


def set_profiles() -> None:
    """Make Fast DDS use the profiles of this module, unless the user has set other profiles."""
    given = [os.environ.get(name, '') for name in ('FASTDDS_DEFAULT_PROFILES_FILE', _FILE)]
    ours = (str(_PACKAGED), f'{_FOLDER}/')
    if any(each and not each.startswith(ours) for each in given):
        return
    os.environ[_FILE] = str(_written(profiles(os.environ)))
    os.environ[_QOS_FROM_FILE] = '1'


def _written(text: str) -> Path:
    """Write profiles to a file that all processes of a user share, and return its path.

    If the file cannot be written, or if its folder belongs to another user, the path of the file in
    the package is returned. With the file in the package, only four processes on a computer
    reliably discover each other.
    """
    path = _FOLDER / f'{blake2b(text.encode(), digest_size=8).hexdigest()}.xml'
    try:
        _FOLDER.mkdir(mode=0o700, exist_ok=True)
        found = _FOLDER.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.geteuid():
            return _PACKAGED  # another user may have created this folder to change the profiles
        if not path.exists():
            own = path.with_suffix(f'.{os.getpid()}')
            own.write_text(text, encoding='utf-8')
            own.replace(path)
    except OSError:
        return _PACKAGED
    return path


def profiles(environment: Mapping[str, str]) -> str:
    """Return the profiles as XML, with the ports to contact if multicast is not used."""
    return _PACKAGED.read_text(encoding='utf-8').replace(_PLACE, _initial_peers(peers(environment)))


def peers(environment: Mapping[str, str]) -> list[tuple[str, int]]:
    """Return the addresses and ports to contact, or an empty list if multicast is used.

    The addresses are 127.0.0.1 and the IPv4 addresses in ROS_STATIC_PEERS. Other entries of
    ROS_STATIC_PEERS are ignored.
    """
    if environment.get('ROS_AUTOMATIC_DISCOVERY_RANGE') != 'LOCALHOST':
        return []
    named = environment.get('ROS_STATIC_PEERS', '').split(';')
    addresses = dict.fromkeys(['127.0.0.1', *filter(_is_ipv4, named)])
    domain = environment.get('ROS_DOMAIN_ID', '')
    first = _PORT_BASE + _DOMAIN_GAIN * int(domain if domain.isdecimal() else 0) + _UNICAST
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
