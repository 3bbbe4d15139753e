# Copyright 2026 Checkweigher maintainers
# SPDX-License-Identifier: Apache-2.0
"""Texts and hints of the findings that the nodes publish in diagnostics and alarms.

The value of a placeholder may be another text of this file, such as 'later' or '3 gaps'. The
placeholder `word` stands for a text without spaces, and `topic` for the full name of a topic. The
placeholder `hint` stands for the hint of a reason, and `advice` for the hint of a reason with or
without details. A name that ends with ``count`` stands for a whole number, and a name that ends
with ``mass`` for a mass with its unit.
"""

from checkweigher_core.records.reasons import Reason, StopReason
from checkweigher_web.languages.language import Text

REASONS = tuple(Text(each.hint) for each in (*Reason, *StopReason))
TEXTS = (
    # Texts about the clock, the samples and the photo-eyes
    Text('edges arrive {seconds} s {side} than samples with the same stamp'),
    Text('later'),
    Text('earlier'),
    Text('the stamps drift by {ppm} ppm relative to this machine'),
    Text('5 % of the blocks are at least {time} ms late'),
    Text('chrony does not answer'),
    Text('the clock is not synchronised'),
    Text('accurate to {time} ms according to chrony'),
    Text('no samples have arrived'),
    Text('no samples for {seconds} s'),
    Text('{what} in the last minute'),
    Text('{samples} lost in {gaps}'),
    Text('{blocks} arrived twice or too late'),
    Text('the source restarted {times}'),
    Text('{samples} at the limit of the converter'),
    Text('1 gap'),
    Text('{count} gaps'),
    Text('1 sample'),
    Text('{count} samples'),
    Text('1 block'),
    Text('{count} blocks'),
    Text('1 time'),
    Text('{count} times'),
    Text('{rate} samples/s by their stamps, but {nominal} in load_cell/info'),
    Text('no load_cell/info has arrived'),
    Text('the {eye} eye has been blocked for {seconds} s'),
    Text('only the {eye} eye has switched in the last minute'),
    Text(
        'the {eye} eye has switched {many_count} times in the last minute, but the {other} eye '
        '{count} times'
    ),
    Text('the last {count} items were {word}'),
    Text('infeed'),
    Text('outfeed'),
    Text('the load lags {time} ms more behind the eyes than rise_lag states'),
    Text('relative to the eyes, the load rises {time} ms {side} than before'),
    Text('the rise of the load is not visible for most items, so that the eyes are not checked'),
    # Texts about the driver, its inputs and its outputs
    Text('{word} failed: {failure}'),
    Text('the source failed: {failure}'),
    Text('the source failed'),
    Text('the driver is inactive'),
    Text('{word} is held back, waiting for {what}'),
    Text('the device sends {rate} values per second, but {parameter} is {nominal}'),
    Text('the photo-eyes have not been read yet'),
    Text('the photo-eyes cannot be read: {error}'),
    Text('the machine inputs have not been read yet'),
    Text('the machine inputs cannot be read: {error}'),
    Text('the outputs are not connected yet'),
    Text('the outputs cannot be reached: {error}'),
    Text('{word}: input {input}'),
    Text('input {word}'),
    Text('the machine inputs are unknown'),
    # Zero and belt
    Text('the empty belt reads another zero than the one in use, or one outside zero_range'),
    Text('the zero has changed by {mass} at once'),
    Text('{mass} before item {count}'),
    Text('the zero has used {percent} % of zero_range'),
    Text('the zero drifts by {mass}/h and leaves zero_range in an hour'),
    Text('products have passed for {seconds} s without a new zero'),
    Text('{mass}, above max_belt_noise of {limit_mass}'),
    Text('{mass}, {ratio} times the usual noise'),
    # Texts about items, estimates and verdicts
    Text('the last {count} items {what}, mostly {reason}'),
    Text('{failed_count} of the last {count} items {what}, mostly {reason}'),
    Text('were faults'),
    Text('were not identified'),
    Text('busy for {percent} % of the time'),
    Text('the masses have a relative standard deviation of {percent} %'),
    Text('the platform oscillates at {frequency} Hz, usually at {usual} Hz'),
    Text('{kind}: since item {item} {change}'),
    Text(
        'the load differs by {factor} standard deviations at {percent} % of the way from t1 to t3'
    ),
    Text('the vibration at {frequency} Hz has {factor} times its power'),
    Text('the learned state is not stored: {error}'),
    Text('{verdicts} came after the reject time in the last minute'),
    Text('1 verdict'),
    Text('{count} verdicts'),
    Text('a verdict came only {time} ms before its reject time'),
    Text('no mass of the last {count} items has arrived'),
    Text('no mass can arrive'),
    Text('{failed_count} of the last {count} items have no mass'),
    Text('reject_eye saw {count} objects that match no reject time'),
    Text('stop requested: {reason}'),
    Text('{word} at item {count}'),
    Text('{hint}: {detail}'),
    Text('withdrawn: no {sign}'),
    Text('samples'),
    Text('eyes'),
    Text('load cell'),
    # Connections of a node
    Text('no {end} of {topic}'),
    Text('publisher'),
    Text('subscriber'),
    Text('{count} messages refused in the last minute: {refusal}'),
    Text('{word} {does} {topic} with an incompatible QoS ({why})'),
    Text('publishes'),
    Text('subscribes to'),
    Text('{word} publishes {topics}'),
    # Production
    Text('not acknowledged: {alarms}'),
    Text('product {product} is not selected yet'),
    Text('no product is selected, so nothing is accepted'),
    Text('the limits on the line, {limits}, are not those of the recipe, {others}'),
    Text('{lower_mass} and {upper_mass}'),
    Text(
        'twice the stated deviation, {mass}, is above a fifth of the tolerable negative error, '
        '{fifth_mass}'
    ),
    Text('the stated deviation, {mass}, is too large for limits {limit_mass} from nominal'),
    Text('DUE: {why}'),
    Text('OVERDUE: {why}'),
    Text('FAILED: {why}'),
    Text('RUNNING: {who} makes it: {made_count} of {count}'),
    Text('none has passed yet'),
    Text('none has passed in this batch'),
    Text('the last one is too long ago'),
    Text('{bad_count} of {count} passes of {who} beyond {limit_mass} or without a mass'),
    # Files and disk
    Text('nearly full: {free}'),
    Text('full in about {count} days: {free}'),
    Text('{size} GB are free'),
    Text('{path}: has begun and not ended'),
    Text('it is not certain which batch is in progress: {batches}'),
    Text('{doubt}; begin a new batch, or one that has not ended: {batches}'),
    Text('{path} has {size} bytes of {limit} at most'),
    Text('{path}: {error}: it was moved or deleted'),
    Text('{path}: is another file than the one that was opened: it was replaced'),
    Text('{path}: has {size} bytes instead of {before}: it was changed'),
    Text('{path}: was changed, moved or deleted'),
    Text('{path}: was changed'),
)
HINTS = (
    *REASONS,
    Text('see docs/reasons.md'),
    Text('{advice}; then reset the stop'),
    # Hints about the clock, the samples and the photo-eyes
    Text('check that one clock stamps the load cell and the photo-eyes'),
    Text('check the sample rate in load_cell/info and the clock of the stamps'),
    Text('check the load on this machine and the network to the driver'),
    Text('check that chronyd runs, and that chronyc tracking works for this user'),
    Text('check chronyc sources, and the network to the time servers'),
    Text('check chronyc sources; times cannot be compared with those of other hosts'),
    Text('check that the driver runs, and the cable and power of the load cell'),
    Text('check processor load, cable and network'),
    Text('check whether two drivers run, and the network between driver and segmenter'),
    Text('check the power of the load cell, and whether two drivers run'),
    Text('check for overload, and check the load-cell wiring'),
    Text('compare the sample rate of the load cell with load_cell/info'),
    Text('check that the driver runs and publishes it with QoS reliable, transient local'),
    Text('check for a jammed product, dirt, and the alignment of the eye'),
    Text(
        'clean the {eye} eye and check its alignment: a dirty eye switches several times at a '
        'product'
    ),
    Text('see whether the product on the belt is the selected one, and check its limits'),
    Text('check the {eye} eye, its wiring and its alignment'),
    Text('measure it by calibrate --dynamic, or set rise_lag to the delay of the amplifier'),
    Text('check the filter of the amplifier, the clocks, and the place and delay of the eyes'),
    Text('leave at least 0.06 s of empty belt before each item'),
    # Hints about the driver, its inputs and its outputs
    Text('see Source of driver'),
    Text('check its cable, power and parameters, then restart the driver'),
    Text('check cable and power; after the repair, reset the stop'),
    Text('activate it with Start on the page, or with ros2 lifecycle set'),
    Text('check that the other nodes are running'),
    Text('check power, cable and address of the inputs'),
    Text('check power, cable and address of the outputs; then reset the stop'),
    Text('look for the product; then reset the stop'),
    # Zero and belt
    Text('clean the belt, free the platform, then set the zero or calibrate'),
    Text(
        'look whether something lies on the belt or was taken off it; if not, the load cell has '
        'shifted: set the zero'
    ),
    Text('clean the belt; calibrate if it is clean'),
    Text('check whether dirt builds up on the belt'),
    Text('let the load cell warm up'),
    Text('increase the spacing of the products or decrease settle_time'),
    Text('strongest at {frequency} Hz: check rollers, belt joint, motor and floor'),
    # Hints about items, estimates and verdicts
    Text('check the load on this machine; a faster estimator or machine is needed'),
    Text('check Belt noise of segmenter, and run tune on passes of this machine'),
    Text('check its fastening, and whether an object lies on it or touches it'),
    Text('check what was changed (belt, rollers, feet), then call forget_learned to learn again'),
    Text('check the file'),
    Text('check the load on this machine, rejector_distance and actuator_delay'),
    Text('check the load on this machine; a more distant rejector leaves more time'),
    Text('{word} does not run: start it'),
    Text('check the other nodes and the load on this machine'),
    Text('check rejector_distance, actuator_delay and confirmation_time'),
    Text('check load cell, driver and segmenter: no new samples are processed'),
    Text('check that the driver runs: no node publishes photo_eyes'),
    Text('check that the driver runs: no node publishes load_cell/info'),
    Text('check its process: it has ended, hangs or is halted'),
    # Connections of a node
    Text('check that {nodes} runs, in this namespace and ROS_DOMAIN_ID'),
    Text('check which node publishes this topic, and its message version'),
    Text('change the QoS of {node} to that of docs/topics.md'),
    Text('report this defect of the diagnostics'),
    # Production
    Text('find the cause of each, then acknowledge them'),
    Text('check that denoise, identifier and reject run, and the warnings of this node'),
    Text('select one on the page, or by the service select_product'),
    Text('select the product again, or change its recipe'),
    Text('train this product, or run the belt at a lower speed'),
    Text('make it: ./checkweigher performance, or the page'),
    # Files and disk
    Text('move recorded items and passes to another disk; see docs/backup.md'),
    Text('make room, or see to the disk: verdicts wait in memory'),
    Text('it was left out; put it right, or move it to another folder'),
    Text('nothing is accepted until then'),
    Text('the batch cannot be released'),
    Text('changes are refused: restore log and LOG.head, and start product again'),
    Text('changes are refused: make room, or see to the disk'),
    Text('name another file in audit_log'),
)
