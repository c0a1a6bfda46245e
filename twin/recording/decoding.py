"""Decode the messages of a bag as observations, in the order in which trackers are to get them."""

from __future__ import annotations

import heapq
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, pi, remainder
from pathlib import Path
from typing import Any

import numpy as np

from trackers.arrays import Nanoseconds
from trackers.errors import InputError
from trackers.observations import Image, LaserScan, Observation
from trackers.rig import Rig
from twin.recording.bags.bag import Copies, Topic, decoded, open_bag
from twin.recording.rig_of_bag.sensor_topics import LeftOut, SensorTopics, poses_of
from twin.recording.ros.depth_images import DepthPairs, decode_depth, match_images
from twin.recording.ros.message_types import TRANSFORM_MESSAGES
from twin.recording.ros.ros_messages import LASER_SCAN, check_fits, from_message, stamp_of
from twin.recording.ros.scan_messages import TurnJoiner
from twin.recording.sensor_clock import MessageTimes

NumberedMessage = tuple[str, int, bytes, bool]
"""Topic, number on it, encoded message, is_ros1."""
_MISCOUNTED = 1.5
"""Distance of angle_max from the last beam, in beams, up to which a driver counts the beams otherwise."""
_LONGEST_S = 10.0
"""Time that no scan takes; time_increment is in ms or µs then [s]."""


@dataclass(frozen=True, eq=False)
class ObservationReader:
    """Reads some sensors' messages as observations.

    times, stamps: of each topic (`MessageTimes`, corrected [ns]). as_written: in the order of the file; in_stamp_order: of the
    stamps; else of the log times.
    """

    path: Path
    topics: Mapping[str, Topic]
    rig: Rig
    found: SensorTopics
    times: Mapping[str, MessageTimes]
    stamps: Mapping[str, Nanoseconds]
    as_written: bool = False
    in_stamp_order: bool = False

    def read(self, reading: LeftOut) -> Iterator[Observation]:
        """Yield the observations, read one at a time; what cannot be used is left out and counted in `reading`.

        Raises InputError where the bag is damaged, or most of a sensor's messages cannot be used.
        """
        found = self.found
        colours = {name: topic for topic, name in found.sensors.items()}
        reading.pairs = {
            name: DepthPairs(match_images(self.stamps[colours[name]], self.stamps[topic]))
            for topic, name in found.depths.items()
            if name in colours
        }
        of_bases = {edge.topic for edge, _ in found.transforms.values()}
        types = found.types | {topic: self.topics[topic].type_among(TRANSFORM_MESSAGES) or "" for topic in of_bases}
        joiners = {topic: TurnJoiner(turn) for topic in found.types if (turn := self.times[topic].turn) is not None}
        for topic, number, data, is_ros1 in self._messages(types, joiners):
            if topic in of_bases:
                yield from poses_of(found, self.stamps, topic, number)
                continue
            joiner = joiners.get(topic)
            observation = self._observation(topic, number, data, is_ros1, joiner, reading)
            if joiner is not None and not isinstance(observation, Image):
                assert observation is None or isinstance(observation, LaserScan)
                observation = joiner.add(number, observation)
            if observation is not None:
                yield observation
        reading.is_done = True

    def _observation(
        self, topic: str, number: int, data: bytes, is_ros1: bool, joiner: TurnJoiner | None, reading: LeftOut
    ) -> Observation | None:
        """Decode one message; None where it cannot be used, or waits for its depth or colour."""
        found, name = self.found, self.found.sensors.get(topic) or self.found.depths[topic]
        stamp_ns = int(self.stamps[topic][number if joiner is None else joiner.turn[number]])
        try:
            message: Any = decoded(data, found.types[topic], is_ros1)
            sensor = self.rig.sensors[name]
            if topic in found.depths:
                pair = reading.pairs[name].depth(number, decode_depth(message, name))
                check_fits(name, sensor, pair)
                return pair
            if found.types[topic] == LASER_SCAN:
                message, said = with_limits(message)
                if said:
                    reading.complete(topic, stamp_ns, said)
            own_ns = stamp_of(message)
            offset_ns = stamp_ns - own_ns if joiner is None else joiner.offset_ns(number, own_ns, stamp_ns)
            observation: Observation | None = from_message(message, name, kind=sensor.kind, offset_ns=offset_ns)
            if name in reading.pairs and isinstance(observation, Image):
                observation = reading.pairs[name].colour(number, observation)
            check_fits(name, sensor, observation)
            return observation
        except InputError as error:
            reading.leave_out(topic, stamp_ns, str(error))
            if 2 * reading.left_out[topic] > self.times[topic].n_message:
                raise InputError(f"{self.path}: topic {topic}: {reading.first[topic][1]}") from error
            return None

    def _messages(self, types: Mapping[str, str], joiners: Mapping[str, TurnJoiner]) -> Iterator[NumberedMessage]:
        with open_bag(self.path) as bag:
            numbers, copies = dict.fromkeys(types, -1), Copies()
            restamped = {
                topic: iter(again.tolist())
                for topic in self.found.types
                if (again := self.times[topic].restamped) is not None
            }

            def numbered() -> Iterator[NumberedMessage]:
                for topic, log_ns, data, is_ros1 in bag.encoded_messages(types, in_file_order=self.as_written):
                    if topic in self.found.types and copies.add(topic, log_ns, data, is_ros1):
                        continue
                    if topic in restamped and next(restamped[topic], False):
                        continue
                    numbers[topic] += 1
                    yield topic, numbers[topic], data, is_ros1

            yield from (
                sorted_by_stamp(numbered(), self._stamps_by_number(joiners)) if self.in_stamp_order else numbered()
            )

    def _stamps_by_number(self, joiners: Mapping[str, TurnJoiner]) -> dict[str, dict[int, int]]:
        """Return the stamp [ns] of each message, by topic and number on it."""
        found: dict[str, dict[int, int]] = {}
        for topic in self.found.types:
            stamps = self.stamps[topic][joiners[topic].turn] if topic in joiners else self.stamps[topic]
            found[topic] = dict(enumerate(stamps.tolist()))
        for key, (edge, _) in self.found.transforms.items():
            found.setdefault(edge.topic, {}).update(zip(edge.number.tolist(), self.stamps[key].tolist(), strict=True))
        return found


def sorted_by_stamp(
    messages: Iterable[NumberedMessage], stamps: Mapping[str, Mapping[int, int]]
) -> Iterator[NumberedMessage]:
    """Yield messages in the order of their stamps [ns], each as soon as all of lesser ones have come; others at once."""
    due = np.sort([stamp for each in stamps.values() for stamp in each.values()])
    held: list[tuple[int, int, NumberedMessage]] = []
    left = 0
    for arrived, message in enumerate(messages):
        stamp = stamps.get(message[0], {}).get(message[1])
        if stamp is None:
            yield message
            continue
        heapq.heappush(held, (stamp, arrived, message))
        while held and held[0][0] <= due[left]:
            yield heapq.heappop(held)[2]
            left += 1


def with_limits(message: Any) -> tuple[Any, str]:
    """Return a LaserScan whose fields that say nothing hold ROS's "not known", and a clause on those; '' for none.

    time_increment (NaN, or a scan of ten seconds): 0; range_min (NaN or negative): 0; range_max (NaN, 0 or negative): infinite.
    An angle_max that is not the bearing of the last beam is reported: bearings are by angle_min and angle_increment.
    """
    known: dict[str, float] = {}
    if not abs(message.time_increment) * len(message.ranges) <= _LONGEST_S:
        known["time_increment"] = 0.0
    if isnan(message.range_min) or message.range_min < 0:
        known["range_min"] = 0.0
    if isnan(message.range_max) or message.range_max <= 0:
        known["range_max"] = inf
    said = [f"{name} {getattr(message, name):g} (taken as {value:g})" for name, value in known.items()]
    last = message.angle_min + (len(message.ranges) - 1) * message.angle_increment
    off = message.angle_max - last
    if (
        len(message.ranges)
        and isfinite(off)
        and abs(remainder(off, 2 * pi)) > _MISCOUNTED * abs(message.angle_increment)
    ):
        said.append(f"angle_max {message.angle_max:g} rad (the last beam is at {last:g} rad by angle_increment)")
    return (replace(message, **known) if known else message), ", ".join(said)
