# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""OPC UA nodes of a lane, which is an instance of the CheckweigherType of OPC 40200."""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Mapping
from datetime import UTC, datetime
import math
from typing import Any

from asyncua import Node, Server, ua
from asyncua.common.manage_nodes import delete_nodes

from checkweigher_core.records import NANOSECONDS, Alarm, Decision, Statistics, Verdict
from checkweigher_core.records.reasons import Reason
from checkweigher_core.ros.ports import VERDICT
from checkweigher_gateways.lane_state import LaneState, PackState
from checkweigher_gateways.nodesets import Namespaces, machines
from checkweigher_production.recipes import Product

Call = Callable[..., Awaitable[Any]]

_CHECKWEIGHER, _PRODUCT, _RANGE, _REJECTED, _EVENT, _ALARM = 45, 46, 23, 1028, 13, 21
_MANUFACTURER = 'Checkweigher maintainers'
# Browse names of the nodes that an instance of a type keeps. The other nodes of the instance, such
# as placeholders, are deleted.
_KEPT = {
    'AvailableStates', 'AvailableTransitions', 'BatchId', 'CurrentProducts', 'CurrentState',
    'CurrentWeight', 'EURange', 'EngineeringUnits', 'ExecuteState', 'Id', 'Identification',
    'ItemCount', 'ItemId', 'LastItem', 'LowerToleranceLimit1', 'LowerToleranceLimit2',
    'MachineState', 'MachineryBuildingBlocks', 'MachineryItemState', 'MachineryOperationMode',
    'Manufacturer', 'MeasuredWeight', 'NominalWeight', 'Overload',
    'PackagesAcceptedWithLowerToleranceLimit1', 'PackagesRejectedByDistanceFault',
    'PackagesRejectedByLength', 'PackagesRejectedByLowerToleranceLimit1',
    'PackagesRejectedByLowerToleranceLimit2', 'PackagesRejectedByMeanValueRequirement',
    'PackagesRejectedByMetal', 'PackagesRejectedByVision', 'PackagesRejectedByXRay',
    'PercentageLowerToleranceLimit', 'PresetLength', 'PresetTare', 'ProductId',
    'ProductInstanceUri', 'ProductName', 'ProductionPreset', 'Products', 'RegisteredWeight',
    'SerialNumber', 'SetZero', 'State', 'Statistic', 'TU1Percent', 'TareMode', 'TotalPackages',
    'TotalPackagesAccepted', 'TotalPackagesRejected', 'TotalPackagesWeighed', 'Underload',
    'Weighed', 'WeightId',
}  # fmt: skip
# Last part of the name of the reject counter (after PackagesRejectedBy), by reason.
_COUNTERS = {
    Reason.DISTANCE_FAULT: 'DistanceFault',
    Reason.MEAN_VALUE_REQUIREMENT: 'MeanValueRequirement',
    Reason.TU1_QUOTA: 'LowerToleranceLimit1',
    Reason.METAL_DETECTED: 'Metal',
    Reason.XRAY_DETECTED: 'XRay',
    Reason.VISION_REJECTED: 'Vision',
}
_KILOGRAM = ua.EUInformation(
    'http://www.opcfoundation.org/UA/units/un/cefact', 4933453, ua.LocalizedText('kg'),
    ua.LocalizedText('kilogram'),
)  # fmt: skip
_METRE = ua.EUInformation(
    _KILOGRAM.NamespaceUri, 5067858, ua.LocalizedText('m'), ua.LocalizedText('metre')
)
# States of the three nested PackML state machines, from the outermost to the innermost. The name of
# a state is empty if the state machine is in no state.
_STATES = {
    PackState.STOPPED: ('Cleared', 'Stopped', ''),
    PackState.EXECUTE: ('Cleared', 'Running', 'Execute'),
    PackState.HELD: ('Cleared', 'Running', 'Held'),
    PackState.ABORTED: ('Aborted', '', ''),
}
_MACHINES = ('State', 3), ('State.MachineState', 2), ('State.MachineState.ExecuteState', 1)
_ITEM_STATES = {
    PackState.STOPPED: ('NotExecuting', 5007),
    PackState.EXECUTE: ('Executing', 5006),
    PackState.HELD: ('NotExecuting', 5007),
    PackState.ABORTED: ('OutOfService', 5004),
}
_MODES = {True: ('Processing', 5026), False: ('None', 5024)}
_SEVERITY = 700
_RECORDED = 'RegisteredWeight', 'RegisteredWeight.WeightId'  # variables with a history


def _time(stamp: int | None) -> datetime | None:
    """Return the time of a stamp in ns in UTC, or None if the stamp is None."""
    return None if stamp is None else datetime.fromtimestamp(stamp / NANOSECONDS, UTC)


class LaneSpace:
    """Nodes of a lane.

    The identifier of a node consists of the lane name and the browse names that lead to the node,
    separated by dots. The lane name is ``lane`` for a lane without a namespace.
    """

    def __init__(self, server: Server, spaces: Namespaces, state: LaneState) -> None:
        self._server, self._spaces, self._state = server, spaces, state
        self.name = state.name or 'lane'
        self._values: dict[str, object] = {}
        self._pack_states: dict[str, ua.NodeId] = {}
        self._products: dict[str, Product] = {}
        self._alarms: dict[str, Alarm] = {}
        self._history = server.iserver.history_manager.storage

    def _id(self, path: str = '') -> ua.NodeId:
        return ua.NodeId(f'{self.name}.{path}' if path else self.name, self._spaces.own)

    def _node(self, path: str = '') -> Node:
        return self._server.get_node(self._id(path))

    async def _add(self, path: str, kind: int) -> None:
        """Add an object of a type in the Scales model.

        Each node of the object is deleted unless its browse name is in `_KEPT`.
        """
        parent, _, name = path.rpartition('.')
        above = self._server.get_node(self._id(parent) if path else machines(self._spaces))
        own = ua.QualifiedName(name or self.name, self._spaces.own)
        kind_id = ua.NodeId(kind, self._spaces.scales)
        made = await above.add_object(self._id(path), own, kind_id, instantiate_optional=True)
        await self._prune(made)
        await asyncio.sleep(0)  # Let the server answer clients between two objects.

    async def _prune(self, node: Node) -> None:
        """Delete each node of the lane below `node`, unless its browse name is in `_KEPT`."""
        for each in await node.get_references(
            ua.ObjectIds.HierarchicalReferences, ua.BrowseDirection.Forward
        ):
            below = self._server.get_node(each.NodeId)
            if each.NodeId.NamespaceIndex == self._spaces.own:
                if each.BrowseName.Name in _KEPT:
                    await self._prune(below)
                else:
                    await node.delete_reference(
                        each.NodeId, each.ReferenceTypeId, bidirectional=False
                    )
                    await self._delete(below)

    async def _delete(self, node: Node) -> None:
        """Delete a node and the nodes of the lane below it.

        The caller must have deleted the reference from the parent to the node.
        """
        for child in await node.get_children():
            if child.nodeid.NamespaceIndex == self._spaces.own:
                await self._delete(child)
        # Do not let the server search all nodes for references to the node, because only the parent
        # refers to the node.
        session = self._server.iserver.isession
        await delete_nodes(session, [node], delete_target_references=False)

    async def build(self) -> None:
        """Add the nodes of the lane to the server, and begin the history of the masses."""
        await self._add('', _CHECKWEIGHER)
        await self._add('WeighingRange1', _RANGE)
        for path, kind in _MACHINES:
            for child in await self._server.get_node(
                ua.NodeId(kind, self._spaces.packml)
            ).get_children():
                name = (await child.read_browse_name()).Name
                self._pack_states[f'{path} {name}'] = child.nodeid
        events = self._server.get_event_generator
        scales, here = self._spaces.scales, self._id()
        self._events = await events(ua.NodeId(_EVENT, scales), here)
        self._conditions = await events(ua.NodeId(_ALARM, scales), here)
        for path in ('CurrentWeight', 'RegisteredWeight'):
            await self._weigh(path, math.nan)
            await self._set(f'{path}.EngineeringUnits', _KILOGRAM)
            await self._set(f'{path}.TareMode', ua.Variant(0, ua.VariantType.Int32))
        await self._set('ProductionPreset.CurrentProducts', [''])
        for path in _RECORDED:
            await self._record(path)
        await self.update()

    async def _record(self, path: str) -> None:
        """Begin the history of a variable, for as many items as the verdict topic keeps."""
        node = self._node(path)
        await node.write_attribute(ua.AttributeIds.Historizing, ua.DataValue(True))
        for attribute in (ua.AttributeIds.AccessLevel, ua.AttributeIds.UserAccessLevel):
            await node.set_attr_bit(attribute, ua.AccessLevel.HistoryRead)
        await self._history.new_historized_node(node.nodeid, None, VERDICT.history.depth)

    async def add_method(
        self, path: str, call: Call, *arguments: str, space: int | None = None
    ) -> None:
        """Use `call` as the method at a path, and add the method if it does not exist.

        A new method has string arguments with the names `arguments`. `space` is the namespace index
        of the browse name of a new method, by default the index of the Scales model.
        """
        parent, _, name = path.rpartition('.')
        if self._id(path) in self._server.iserver.aspace:
            self._server.link_method(self._node(path), call)
            return
        inputs = [
            ua.Argument(each, ua.NodeId(ua.ObjectIds.String), -1, [], ua.LocalizedText())
            for each in arguments
        ]
        await self._node(parent).add_method(
            self._id(path), ua.QualifiedName(name, space or self._spaces.scales), call, inputs, []
        )

    async def _set(self, path: str, value: Any, stamp: int | None = None) -> None:
        """Write the value of a variable, with the time `stamp` in ns or the present time.

        Without a `stamp`, the value is written only if it has changed. With a `stamp`, the value of
        a variable in `_RECORDED` is also added to the history. A variable that does not exist is
        ignored.
        """
        if stamp is None and self._values.get(path) == value:
            return
        self._values[path] = value
        variant = value if isinstance(value, ua.Variant) else ua.Variant(value)
        data = ua.DataValue(variant, SourceTimestamp=_time(stamp) or datetime.now(UTC))
        if self._id(path) in self._server.iserver.aspace:
            await self._server.write_attribute_value(self._id(path), data)
        # Write the history here, because the usual history of asyncua subscribes to the variable,
        # and would miss a mass that equals the previous one.
        if stamp is not None and path in _RECORDED:
            await self._history.save_node_value(self._id(path), data)

    async def _weigh(self, path: str, mass: float, stamp: int | None = None) -> None:
        await self._set(path, ua.WeightType(Gross=mass, Net=mass, Tare=0.0), stamp)

    async def _choose(self, path: str, name: str, state: ua.NodeId) -> None:
        await self._set(f'{path}.CurrentState', ua.LocalizedText(name))
        await self._set(f'{path}.CurrentState.Id', ua.Variant(state, ua.VariantType.NodeId))

    async def update(self) -> None:
        """Update the nodes with the present state of the lane."""
        state = self._state
        pack = state.pack_state
        for (path, _), name in zip(_MACHINES, _STATES[pack], strict=True):
            await self._choose(path, name, self._pack_states.get(f'{path} {name}', ua.NodeId()))
        machinery = self._spaces.machinery
        for block in ('', 'MachineryBuildingBlocks.'):
            for item, (name, number) in (
                ('MachineryItemState', _ITEM_STATES[pack]),
                ('MachineryOperationMode', _MODES[state.is_active]),
            ):
                await self._choose(f'{block}{item}', name, ua.NodeId(number, machinery))
        if (cell := state.load_cell) is not None:
            for own in ('', 'Identification.'):
                await self._set(f'{own}Manufacturer', ua.LocalizedText(_MANUFACTURER))
                await self._set(f'{own}SerialNumber', cell.serial_number)
                uri = f'urn:checkweigher:{cell.model}:{cell.serial_number}:{self.name}'
                await self._set(f'{own}ProductInstanceUri', uri.replace(' ', '_'))
            span = ua.Range(0.0, cell.capacity)
            interval = 1 / abs(cell.counts_per_kg)
            for path, value in (('Range', span), ('ActualScaleInterval', interval)):
                await self._set(f'WeighingRange1.{path}', value)
                await self._set(f'WeighingRange1.{path}.EngineeringUnits', _KILOGRAM)
            # The checkweigher is not type-approved, so it has no verification scale interval.
            await self._set('WeighingRange1.VerificationScaleInterval', math.nan)
            for path in ('CurrentWeight', 'RegisteredWeight'):
                await self._set(f'{path}.EURange', span)
        if state.statistics is not None:
            await self._count(state.statistics)

    async def show_item(self, verdict: Verdict) -> None:
        """Update the masses with an item, and send an event if the item is not accepted.

        The masses are not changed by an item without a mass.
        """
        stamp = verdict.time
        if math.isfinite(verdict.mass):
            item = str(verdict.item_id)
            for path in ('CurrentWeight', 'RegisteredWeight'):
                await self._set(f'{path}.WeightId', item, stamp)
                await self._weigh(path, verdict.mass, stamp)
            if verdict.product in self._products:
                last = f'{self._product(verdict.product)}.Statistic.LastItem'
                await self._set(f'{last}.ItemId', item, stamp)
                await self._weigh(f'{last}.MeasuredWeight', verdict.mass, stamp)
        if verdict.decision != Decision.ACCEPT:
            reasons = ', '.join(verdict.reasons) or verdict.decision.name
            await self.say(f'item {verdict.item_id}: {reasons}', reasons, stamp)

    async def say(self, text: str, reason: str = '', stamp: int | None = None) -> None:
        """Send an event of the lane with a text.

        `reason` contains the reasons of a reject, and is empty for other events. The time of the
        event is `stamp` in ns, or the present time if `stamp` is None.
        """
        event = self._events.event
        event.Message = ua.LocalizedText(text)
        event.VendorNotificationId = reason
        event.SourceName, event.SourceNode = self.name, self._id()
        await self._events.trigger(time_attr=_time(stamp))

    @staticmethod
    def _product(name: str) -> str:
        return f'ProductionPreset.Products.{name}'

    async def show_products(self, products: Mapping[str, Product]) -> None:
        """Update the nodes of the products in the recipe file.

        `products` contains the products in the file by name. The nodes of products that are no
        longer in the file are deleted.
        """
        gone = [self._node(self._product(name)) for name in self._products.keys() - products.keys()]
        await self._server.delete_nodes(gone, recursive=True)
        for name, product in products.items():
            path = self._product(name)
            if name not in self._products:
                await self._add(path, _PRODUCT)
            await self._set(f'{path}.ProductId', name)
            await self._set(f'{path}.ProductName', ua.LocalizedText(name))
            for key, value in (
                ('NominalWeight', product.nominal),
                ('LowerToleranceLimit1', product.tu1),
                ('LowerToleranceLimit2', product.tu2),
                ('PresetTare', product.tare),
            ):
                await self._set(f'{path}.{key}', value)
                await self._set(f'{path}.{key}.EngineeringUnits', _KILOGRAM)
            await self._set(f'{path}.NominalWeight.EURange', ua.Range(0.0, 2 * product.nominal))
            await self._set(f'{path}.PresetLength', product.length[1])
            await self._set(f'{path}.PresetLength.EngineeringUnits', _METRE)
        self._products = dict(products)

    async def _count(self, statistics: Statistics) -> None:
        """Update the name of the product on the line, and the percentage of items below TU1.

        If the product has nodes, its batch name and its counters are also updated.
        """
        await self._set('ProductionPreset.CurrentProducts', [statistics.product])
        await self._set('TU1Percent', 100 * statistics.share_below_tu1)
        if statistics.product not in self._products:
            return
        product = self._product(statistics.product)
        await self._set(f'{product}.BatchId', statistics.batch)
        reasons = dict(zip(statistics.reasons, statistics.reason_counts, strict=True))
        rejected = statistics.items - statistics.accepted
        known = {
            _COUNTERS[Reason(each)]: reasons.pop(each) for each in _COUNTERS if each in reasons
        }
        counts = {f'PackagesRejectedBy{name}': count for name, count in known.items()}
        counts |= {f'PackagesRejectedBy{name}': count for name, count in reasons.items()}
        by_limit = statistics.under - sum(
            known.get(name, 0) for name in ('LowerToleranceLimit1', 'MeanValueRequirement')
        )
        counts |= {
            'PackagesRejectedByLength': statistics.length_faults,
            'PackagesRejectedByLowerToleranceLimit2': by_limit,
            'PackagesRejectedByUpperToleranceLimit': statistics.over,
            'PackagesAcceptedWithLowerToleranceLimit1': statistics.below_tu1,
            'TotalPackages': statistics.items,
            'TotalPackagesAccepted': statistics.accepted,
            'TotalPackagesRejected': rejected,
        }
        for name, count in counts.items():
            path = f'{product}.Statistic.{name}'
            if self._id(path) not in self._server.iserver.aspace:
                await self._add(path, _REJECTED)
            await self._set(f'{path}.ItemCount', ua.Variant(max(count, 0), ua.VariantType.UInt32))

    async def show_alarms(self, alarms: Iterable[Alarm]) -> None:
        """Send a condition event for each alarm that was added, changed or removed."""
        now = {f'{each.source} {each.reason}': each for each in alarms}
        for name in self._alarms.keys() | now.keys():
            if self._alarms.get(name) != now.get(name):
                await self._condition(name, now.get(name) or self._alarms[name], name in now)
        self._alarms = now

    async def refresh(self) -> None:
        """Send the condition events of all alarms again."""
        for name, alarm in self._alarms.items():
            await self._condition(name, alarm, True)

    async def _condition(self, name: str, alarm: Alarm, kept: bool) -> None:
        path = f'Alarms {name}'
        if self._id(path) not in self._server.iserver.aspace:
            await self._node().add_object(self._id(path), ua.QualifiedName(name, self._spaces.own))
        event, acknowledged = self._conditions.event, bool(alarm.acknowledged_by) or not kept
        event.NodeId, event.ConditionName = self._id(path), name
        event.SourceName, event.SourceNode = self.name, self._id()
        event.Message = ua.LocalizedText(alarm.text or alarm.reason)
        event.Severity = _SEVERITY
        event.VendorNotificationId = alarm.reason
        event.Retain = kept
        event.ClientUserId = alarm.acknowledged_by
        for state, holds, words in (
            ('EnabledState', True, ('Enabled', 'Disabled')),
            ('ActiveState', alarm.active and kept, ('Active', 'Inactive')),
            ('AckedState', acknowledged, ('Acknowledged', 'Unacknowledged')),
        ):
            setattr(event, state, ua.LocalizedText(words[not holds]))
            setattr(event, f'{state}/Id', holds)
        await self._conditions.trigger()
