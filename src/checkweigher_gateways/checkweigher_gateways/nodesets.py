# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""OPC UA information models that the server loads, as published by the OPC Foundation."""

from pathlib import Path
import sys
from typing import NamedTuple

from asyncua import Server, ua

_DI = 'Opc.Ua.Di.NodeSet2.xml'
# Files of the models in the order of their dependencies.
_FILES = (
    _DI,
    'Opc.Ua.IA.NodeSet2.xml',
    'Opc.Ua.Machinery.NodeSet2.xml',
    'Opc.Ua.PackML.NodeSet2.xml',
    'Opc.Ua.Scales.NodeSet2.xml',
)
OWN = 'urn:checkweigher'


class Namespaces(NamedTuple):
    """Namespace indices of the models and of this server."""

    machinery: int
    packml: int
    scales: int
    own: int


def default_folder() -> Path:
    """Return the folder into which `setup/nodesets` writes the files."""
    return Path(sys.prefix, 'share/checkweigher/nodesets')


def check(folder: Path) -> None:
    """Raise FileNotFoundError if the file of a model is missing."""
    for name in _FILES:
        if not (folder / name).is_file():
            raise FileNotFoundError(f'{folder / name}: there is no such file; run setup/nodesets')


async def load(server: Server, folder: Path) -> Namespaces:
    """Load all models from a folder, and return the namespace indices."""
    for name in _FILES:
        # Load DI without strict mode, because DI refers to a newer core model than asyncua has.
        await server.import_xml(folder / name, strict_mode=name != _DI)
    await server.load_data_type_definitions()
    uris = (f'http://opcfoundation.org/UA/{name}/' for name in ('Machinery', 'PackML', 'Scales/V2'))
    machinery, packml, scales = [await server.get_namespace_index(uri) for uri in uris]
    return Namespaces(machinery, packml, scales, await server.register_namespace(OWN))


def machines(spaces: Namespaces) -> ua.NodeId:
    """Return the node ID of the folder Machines of OPC 40001-1."""
    return ua.NodeId(1001, spaces.machinery)
