"""Loader of a robot's log: read, processed, and recorded in the manifest."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from palpate.api import CurveError, ExperimentLoader, Response
from palpate.api.files import Inspection, TextFormat
from palpate_robot_log.processing.settings import ProcessingSettings
from palpate_robot_log.reading.channel_map import ChannelMap, LogFiles
from palpate_robot_log.reading.formats import ReadingLimits

if TYPE_CHECKING:
    from palpate_robot_log.reading.assembly import Reading

# SciPy, polars and matplotlib are imported where they are used: who lists the plugins needs none of them.


class RobotLogSettings(ProcessingSettings):
    """Settings of :class:`RobotLogLoader`: how the log is read, then every step of processing."""

    channels: ChannelMap = Field(description="Which columns are time, pose and wrench.")
    files: LogFiles | None = Field(
        default=None, description="Names of two files of each press; left out: one file has pose and wrench."
    )
    text: TextFormat = Field(
        default_factory=TextFormat, description="Layout of delimited text; guessed where left out."
    )
    limits: ReadingLimits = Field(
        default_factory=ReadingLimits, description="Largest file, memory and time of reading."
    )


class RobotLogLoader(ExperimentLoader[RobotLogSettings]):
    """A press as a robot and a six-axis sensor logged it.

    The file gives the channels ``force`` (over depth), ``torque`` (over rotation) where the tool twists,
    with ``slide.enabled`` ``lateral_force`` (over shift), and with ``over_time.enabled`` ``force_over_time``,
    each with standard deviations. A file that the study gives for one channel gives that one alone.
    """

    name = "robot_log"
    summary = "pose and wrench over time: text, Parquet, MATLAB, NumPy or ROS bag, to force and torque"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Curves of one log, or the one of the channel that is wanted.

        Raises
        ------
        CurveError
            Naming file, rows, time stamps and what to do.
        """
        from palpate_robot_log.processing.chain import process
        from palpate_robot_log.processing.corrections import weight_left_in

        reading, gravity = self._read(path), self.settings.gravity
        processed = process(reading.recording, self.settings)
        curves = processed.curves
        if channel is not None and channel not in curves:
            raise CurveError(
                f"{path}: no channel '{channel}' comes of this log (found: {', '.join(curves)}); "
                "log a twist, or leave the channel out"
            )
        wanted = curves if channel is None else {channel: curves[channel]}
        record = {"reading": dict(reading.record), **processed.record}
        if gravity.method == "off" and processed.bias is not None:
            peak = float(abs(processed.curves["force"].ordinate).max())
            bias_N, down = processed.bias.force_N, np.array(gravity.direction)
            if warning := weight_left_in(processed.raw, bias_N, down, peak):
                record["warnings"] = [warning]
        relaxations = [item for item in processed.relaxations if item.channel in wanted]
        return Response(curves=wanted, relaxations=relaxations, record=record)

    def draw(self, path: Path, folder: Path, channel: str | None = None) -> tuple[Path, ...]:
        """Pictures of the log as it was read, tared, in its phases, its first contact and its curves.

        They show all channels. An error is that of :meth:`load`; what could be read is drawn before.
        """
        from palpate_robot_log.pictures import draw_processed, draw_recording
        from palpate_robot_log.processing.chain import process

        reading = self._read(path)
        first = draw_recording(reading.recording, folder)
        return (first, *draw_processed(process(reading.recording, self.settings), folder))

    @classmethod
    def inspect(cls, path: Path, other: Path | None = None) -> Inspection:
        """Contents of a log and a channel map for it; a CurveError where it cannot be read at all.

        Of two files the first is that of the pose.
        """
        from palpate_robot_log.reading.inspection import inspect_log

        return inspect_log(path, other)

    def _read(self, path: Path) -> "Reading":
        from palpate_robot_log.reading.assembly import read_recording

        settings = self.settings
        return read_recording(path, settings.channels, settings.text, settings.limits, settings.files)
