"""What rosbag2 keeps of a bag beside its messages: topics, counts, times, quality of service.

Version 5 of the format, as ROS 2 Humble writes it; later ones read it.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

METADATA, BAG_KEY = "rosbag2", "serialized_metadata"
QOS_KEY = "offered_qos_profiles"
FOREVER = "{sec: 9223372036, nsec: 854775807}"  # how rosbag2 writes an infinite duration
DEPTH = 10  # messages that a publisher keeps, ROS 2's own default


@dataclass(slots=True)
class TopicFacts:
    """What is known of a topic.

    Attributes
    ----------
    kind : str
        Its type's full name.
    latched : bool
        Whether who comes late gets its last message.
    messages : int
        How many were written.
    first, last : int
        Times of the earliest and latest [ns].
    """

    kind: str
    latched: bool
    messages: int = 0
    first: int = 2**63 - 1
    last: int = 0

    def count(self, stamp: int) -> None:
        """Take note of a message of a time [ns]."""
        self.messages += 1
        self.first, self.last = min(self.first, stamp), max(self.last, stamp)


def qos_profile(*, latched: bool) -> str:
    """The quality of service that a topic was offered with, as YAML in one line."""
    depth, durability = (1, 1) if latched else (DEPTH, 2)
    return (
        f"[{{history: 1, depth: {depth}, reliability: 1, durability: {durability}, "
        f"deadline: {FOREVER}, lifespan: {FOREVER}, liveliness: 1, "
        f"liveliness_lease_duration: {FOREVER}, avoid_ros_namespace_conventions: false}}]"
    )


def bag_metadata(file: str, topics: Mapping[str, TopicFacts]) -> str:
    """The content of `metadata.yaml` for a bag of one MCAP file.

    Parameters
    ----------
    file : str
        Its name.
    topics : mapping of str to TopicFacts
    """
    total = sum(one.messages for one in topics.values())
    first = min((one.first for one in topics.values()), default=0) if total else 0
    span = max((one.last for one in topics.values()), default=0) - first if total else 0
    name = json.dumps(file)
    lines = [
        "rosbag2_bagfile_information:",
        "  version: 5",
        "  storage_identifier: mcap",
        f"  duration: {{nanoseconds: {span}}}",
        f"  starting_time: {{nanoseconds_since_epoch: {first}}}",
        f"  message_count: {total}",
        "  topics_with_message_count:",
    ]
    for topic, one in topics.items():
        lines += [
            "    - topic_metadata:",
            f"        name: {topic}",
            f"        type: {one.kind}",
            "        serialization_format: cdr",
            f"        {QOS_KEY}: {json.dumps(qos_profile(latched=one.latched))}",
            f"      message_count: {one.messages}",
        ]
    lines += [
        '  compression_format: ""',
        '  compression_mode: ""',
        f"  relative_file_paths: [{name}]",
        "  files:",
        f"    - path: {name}",
        f"      starting_time: {{nanoseconds_since_epoch: {first}}}",
        f"      duration: {{nanoseconds: {span}}}",
        f"      message_count: {total}",
    ]
    return "\n".join(lines) + "\n"
