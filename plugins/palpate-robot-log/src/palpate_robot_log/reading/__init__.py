"""Reading a robot's log: one file per format, a channel map, and the checks that need no physics.

:func:`read_recording` takes a file and a :class:`ChannelMap` and gives a
:class:`palpate_robot_log.recording.Recording`; :func:`read_log` gives the columns
as they are in the file. Names are imported when they are first used.
"""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate_robot_log.reading.assembly import Reading, read_recording
    from palpate_robot_log.reading.channel_map import ChannelMap
    from palpate_robot_log.reading.formats import ReadingLimits, Request, read_log

__all__ = ["ChannelMap", "Reading", "ReadingLimits", "Request", "read_log", "read_recording"]

__getattr__ = deferred(
    __name__,
    {
        "ChannelMap": "channel_map",
        "ReadingLimits": "formats",
        "Reading": "assembly",
        "Request": "formats",
        "read_log": "formats",
        "read_recording": "assembly",
    },
)


def __dir__() -> list[str]:
    return sorted(__all__)
