"""What recordings of messages share, whatever contains them: topics, and the messages on them one by one."""

from collections.abc import Callable, Iterator
from typing import NamedTuple


class Channel(NamedTuple):
    """Where messages of one type are found."""

    topic: str
    kind: str  # type of its messages, such as sensor_msgs/Imu
    encoding: str  # json, cdr or ros1
    definition: str = ""  # of the type, as text; empty where the recording bears none


Wanted = Callable[[Channel], bool]  # whether the messages of a channel are needed
Messages = Iterator[tuple[Channel, int, bytes]]  # channel, time in ns, content


def short(kind: str) -> str:
    """The name of a type without the folder that ROS 2 puts into it."""
    return kind.replace("/msg/", "/")
