# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Writer of small bags, each of which contains one item of a running line."""

import asyncio
from datetime import UTC, datetime
from pathlib import Path

from checkweigher_core.recording import Recording
from checkweigher_core.records import NANOSECONDS
from checkweigher_core.whole_file import OutputError
from checkweigher_dsp.pipeline.line import LineParameters
from checkweigher_recording.bags.definitions import BagError
from checkweigher_recording.bags.writing import write_bag
from checkweigher_validation.item_recording import KeepError, keep_item
from checkweigher_web.lane import ShownItem
from checkweigher_web.languages.language import Mass, Text
from checkweigher_web.work.services import ActionRefusedError

HELD = 120.0  # duration in s of the samples that a lane holds if users may keep items
_ELSE = Text('record the line, and cut the item out with checkweigher keep')


class Keeper:
    """Writer of bags to `folder`, each of which contains one item.

    The writer weighs an item again before it writes the bag of the item. Only one item is processed
    at a time.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._turn = asyncio.Lock()

    async def keep(
        self, lane: str, recording: Recording | None, parameters: LineParameters, item: ShownItem
    ) -> str:
        """Write an item with the samples on which its mass depends, and return a text on the bag.

        `recording` contains the samples and edges that the page holds, or is None if the page holds
        no samples. `parameters` are the present parameters of the lane. Raises `ActionRefusedError`
        if the item has no estimate or no times, if the page does not hold the samples of the item,
        or if the bag cannot be written. `ActionRefusedError` is also raised if weighing the
        recording gives another result for the item.
        """
        async with self._turn:
            return await asyncio.to_thread(self._keep, lane, recording, parameters, item)

    def _keep(
        self, lane: str, recording: Recording | None, parameters: LineParameters, item: ShownItem
    ) -> str:
        verdict, estimate = item.verdict, item.estimate
        stamps = [each for each in item.key if each is not None]
        if estimate is None or not stamps:
            raise ActionRefusedError(
                Text(
                    'item {number} has no place in the signal: {advice}',
                    number=verdict.item_id,
                    advice=_ELSE,
                )
            )
        if recording is None:
            raise ActionRefusedError(
                Text('the page has no samples yet: it receives them only while somebody looks')
            )
        begin, end = recording.blocks[0].stamp, recording.blocks[-1].stamp
        seconds = round((end - begin) / NANOSECONDS)
        if min(stamps) < begin:
            raise ActionRefusedError(
                Text(
                    'item {number} came before what the page holds, {seconds} s: {advice}',
                    number=verdict.item_id,
                    seconds=seconds,
                    advice=_ELSE,
                )
            )
        try:
            part, result = keep_item(recording, parameters, estimate, verdict)
            when = datetime.fromtimestamp(min(stamps) / NANOSECONDS, UTC)
            name = f'item{verdict.item_id}_{when:%Y%m%dT%H%M%SZ}'
            path = self.folder / '_'.join([*lane.split('/'), name]).lstrip('_')
            write_bag(path, part.load_cell, part, lane)
        except KeepError:
            raise ActionRefusedError(
                Text(
                    'the page holds {seconds} s, in which item {number} is weighed another way: '
                    'earlier samples are missing, or a parameter was changed since; {advice}',
                    seconds=seconds,
                    number=verdict.item_id,
                    advice=_ELSE,
                )
            ) from None
        except (OutputError, BagError) as error:
            raise ActionRefusedError(str(error)) from None
        found = result.verdict
        return Text(
            '{path}: it is item {number} of this bag, {mass}, {decision} {reasons}',
            path=path,
            number=found.item_id,
            mass=Mass(round(found.mass, 6)),
            decision=Text(found.decision.name),
            reasons=' '.join(found.reasons),
        )
