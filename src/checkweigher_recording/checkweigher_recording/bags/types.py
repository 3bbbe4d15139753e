"""Whether the messages of a bag have the definitions that are installed here."""

from pathlib import Path

from rosbags.interfaces import Connection, MessageDefinition, MessageDefinitionFormat
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from checkweigher_recording.bags.messages import INPUT_TOPICS, BagError, Topic, typestore


def check_type(path: Path, connection: Connection, topic: Topic) -> None:
    """Check that the messages of a connection are those that are installed here.

    Raises
    ------
    BagError
        If they have another type or another definition.
    """
    if connection.msgtype != topic.message_type:
        raise BagError(
            f'{path}: topic {connection.topic} holds {connection.msgtype}, must hold '
            f'{topic.message_type}'
        )
    here = _installed(topic).hash_rihs01(topic.message_type)
    for there in (connection.digest, _type_hash(connection.msgdef, topic)):
        if there and there != here:
            raise BagError(
                f'{path}: topic {connection.topic} was recorded with another definition of '
                f'{topic.message_type} ({there}, here {here}); use the version that recorded it'
            )


def _type_hash(definition: MessageDefinition, topic: Topic) -> str:
    """Return the hash of a definition that a bag brings along, empty if it brings none."""
    known = _installed(topic)
    if definition.data == known.generate_msgdef(topic.message_type, ros_version=2)[0]:
        return known.hash_rihs01(topic.message_type)
    store = get_typestore(Stores.EMPTY)
    if definition.format == MessageDefinitionFormat.MSG:
        store.register(get_types_from_msg(definition.data, topic.message_type))
    elif definition.format == MessageDefinitionFormat.IDL:
        store.register(get_types_from_idl(definition.data))
    else:
        return ''
    return store.hash_rihs01(topic.message_type)


def _installed(topic: Topic) -> Typestore:
    """Return the definitions that are installed: those of all topics only if need be."""
    return typestore(INPUT_TOPICS) if topic in INPUT_TOPICS else typestore()
