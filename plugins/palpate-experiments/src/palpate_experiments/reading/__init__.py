"""Reading a robot's log: one file per format, a channel map, and the checks that need no physics.

:func:`read_recording` takes a file and a :class:`ChannelMap` and gives a
:class:`palpate_experiments.recording.Recording`; :func:`read_log` gives the columns
as they stand in the file. Names are imported when they are first used.
"""

import importlib
from types import MappingProxyType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from palpate_experiments.reading.assembly import Reading, read_recording
    from palpate_experiments.reading.channel_map import ChannelMap
    from palpate_experiments.reading.confined import read_log
    from palpate_experiments.reading.formats import Request
    from palpate_experiments.reading.limits import Limits
    from palpate_experiments.reading.text_layout import TextFormat

__all__ = ["ChannelMap", "Limits", "Reading", "Request", "TextFormat", "read_log", "read_recording"]

_HOMES = MappingProxyType(
    {
        "ChannelMap": "channel_map",
        "Limits": "limits",
        "Reading": "assembly",
        "Request": "formats",
        "TextFormat": "text_layout",
        "read_log": "confined",
        "read_recording": "assembly",
    }
)


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module 'palpate_experiments.reading' has no attribute '{name}'")
    value: object = getattr(importlib.import_module(f"palpate_experiments.reading.{_HOMES[name]}"), name)
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
