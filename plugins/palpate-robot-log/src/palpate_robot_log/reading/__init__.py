"""Reading a robot's log: one file per format, a channel map, and the checks that need no physics.

:func:`read_recording` takes a file and a :class:`ChannelMap` and gives a
:class:`palpate_robot_log.recording.Recording`; :func:`read_log` gives the columns
as they are in the file. Names are imported when they are first used.
"""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_robot_log.reading.assembly import Reading as Reading, read_recording as read_recording
    from palpate_robot_log.reading.channel_map import ChannelMap as ChannelMap
    from palpate_robot_log.reading.formats import (
        ReadingLimits as ReadingLimits,
        Request as Request,
        read_log as read_log,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
