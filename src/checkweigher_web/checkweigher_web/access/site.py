# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Address, certificate and users of the page."""

from dataclasses import dataclass, replace
from ipaddress import ip_address
from pathlib import Path
import re
from socket import gethostname
from urllib.parse import urlsplit

from checkweigher_core.whole_file import check_folder_of
from checkweigher_web import ADDRESS, PORT
from checkweigher_web.access.certificate import check_pair
from checkweigher_web.access.users import default_users, read_users


class PageError(ValueError):
    """Raised if the page cannot be served. The message is one line with the reason."""


@dataclass(frozen=True)
class Site:
    """Settings of the web server: address, TLS certificate, users, reverse proxy and idle time.

    Without a certificate and its key, the server uses HTTP. If `users` is None, the users file is
    `default_users()`.
    """

    host: str = ADDRESS
    port: int = PORT
    certificate: Path | None = None
    key: Path | None = None
    users: Path | None = None
    origin: str = ''  # address https://NAME or https://NAME:PORT of a reverse proxy, or ''
    idle: float = 30.0  # time in min without use after which a session ends

    @property
    def loopback(self) -> bool:
        """Whether the server listens on a loopback address, which other machines cannot reach."""
        return self.host == 'localhost' or _is_loopback(self.host)

    @property
    def open(self) -> bool:
        """Whether users of this machine may see the page without a login."""
        return self.loopback and not self.origin

    @property
    def secure(self) -> bool:
        """Whether browsers connect over TLS."""
        return self.certificate is not None or bool(self.origin)

    @property
    def address(self) -> str:
        """Address of the page, followed by its address at the reverse proxy if there is one.

        If the server listens on all addresses of the machine, the address contains the name of the
        machine.
        """
        host = gethostname() if self.host in ('0.0.0.0', '::') else self.host
        host = f'[{host}]' if ':' in host else host
        scheme = 'http' if self.certificate is None else 'https'
        proxy = f', as {self.origin}/' if self.origin else ''
        return f'{scheme}://{host}:{self.port}/{proxy}'

    def serves(self, host: str) -> bool:
        """Return whether the page is served under `host`, a host name with or without a port.

        On a loopback address, only `self.host` and localhost are served, because another web site
        could point its own name to this machine. On other addresses, all names are served, because
        the TLS certificate is not valid for the names of other web sites. Behind a reverse proxy,
        only the name of the proxy is served.
        """
        if self.origin:
            return host.lower() == urlsplit(self.origin).netloc
        # Do not compare the port, because an SSH tunnel may use another port, and because browsers
        # leave out the default port of HTTP and HTTPS.
        name = re.sub(r':\d*$', '', host).strip('[]')
        return not self.loopback or name in (self.host, 'localhost')

    def checked(self) -> 'Site':
        """Check the site, and return a copy with the users file and a normalised origin.

        Raises `PageError`, `CertificateError`, `SettingsError` or `OutputError` if the site cannot
        be served.
        """
        if (self.certificate is None) != (self.key is None):
            raise PageError('--certificate and --key: give both options, or neither')
        if not self.idle > 0:
            raise PageError(f'--idle {self.idle:g}: must be above 0')
        users = self.users or default_users()
        if users.exists():
            read_users(users)
        elif users == self.users:
            check_folder_of(users)
        if not self.loopback and not self.certificate:
            raise PageError(
                f'{self.host}: this address needs --certificate and --key; run: checkweigher '
                'certificate'
            )
        if self.certificate is not None and self.key is not None:
            check_pair(self.certificate, self.key)
        return replace(self, users=users, origin=_origin(self.origin))


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _origin(given: str) -> str:
    """Return an origin in the form that browsers send, or '' if none is given.

    Raises `PageError` if the origin is not https://NAME or https://NAME:PORT.
    """
    if not given:
        return ''
    parts = urlsplit(given.lower())
    if parts.scheme != 'https' or not parts.netloc or parts.path not in ('', '/') or parts.query:
        raise PageError(f'--origin {given}: must be https://NAME or https://NAME:PORT')
    return f'https://{parts.netloc.removesuffix(":443")}'
