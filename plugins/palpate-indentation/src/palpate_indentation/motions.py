"""A motion made of moves: to a place, or until a load is reached."""

from collections.abc import Iterator
from typing import Annotated, NamedTuple, Self

import numpy as np
from pydantic import Field, model_validator

from palpate.api import FloatArray, Motion, Quantity, Settings, StudyError, Waypoints
from palpate.api.experiment import MOST_TILT_DEG, MOST_WAYPOINTS

Length = Annotated[float, Quantity("mm")]
Angle = Annotated[float, Quantity("deg")]
Force = Annotated[float, Quantity("N")]
Moment = Annotated[float, Quantity("N*mm")]


class _Part(NamedTuple):
    """Keys of a part of the motion: its place, its load, how far a load may move it; and its columns."""

    place: str
    load: str
    limit: str
    columns: tuple[int, ...]


PARTS = (
    _Part("depth", "force", "depth_limit", (0,)),
    _Part("slide", "slide_force", "slide_limit", (1, 2)),
    _Part("tilt", "tilt_moment", "tilt_limit", (3, 4)),
    _Part("twist", "torque", "twist_limit", (5,)),
)


class Move(Settings):
    """One move, or a repetition of moves. What it does not name stays where it is."""

    depth: Length | None = Field(None, description="Depth to go to; below 0 the indenter is off the skin.")
    slide: tuple[Length, Length] | None = Field(None, description="Shift along x and y to go to.")
    tilt: tuple[Angle, Angle] | None = Field(None, description="Rotation of the axis about x and y to go to.")
    twist: Angle | None = Field(None, description="Rotation about the axis to go to.")
    force: Force | None = Field(None, description="Force against the normal to press by.")
    slide_force: tuple[Force, Force] | None = Field(None, description="Force along x and y to push by.")
    tilt_moment: tuple[Moment, Moment] | None = Field(None, description="Moment about x and y to tilt by.")
    torque: Moment | None = Field(None, description="Torque about the normal to turn by.")
    duration: Annotated[float, Quantity("s")] | None = Field(
        None, gt=0.0, description="Time that it takes; of each move or of none."
    )
    repeat: int = Field(1, ge=1, le=MOST_WAYPOINTS, description="How often `moves` are made.")
    moves: tuple["Move", ...] = Field((), description="Moves that are repeated.")

    @model_validator(mode="after")
    def _check(self) -> Self:
        own = self.model_fields_set - {"repeat", "moves"}
        if self.moves and own:
            raise ValueError(f"'{min(own)}' next to moves that are repeated; make it a move of its own")
        if self.repeat > 1 and not self.moves:
            raise ValueError("nothing to repeat; give moves = [ … ]")
        for part, place, load in zip(PARTS, self.places, self.loads, strict=True):
            if place is not None and load is not None:
                raise ValueError(f"both {part.place} and {part.load}; give one of them, or two moves")
        return self

    @property
    def places(self) -> "tuple[float | tuple[float, float] | None, ...]":
        """Places of the parts to go to."""
        return self.depth, self.slide, self.tilt, self.twist

    @property
    def loads(self) -> "tuple[float | tuple[float, float] | None, ...]":
        """Loads of the parts to be reached."""
        return self.force, self.slide_force, self.tilt_moment, self.torque

    def each(self) -> Iterator["Move"]:
        """Single moves in order."""
        if not self.moves:
            yield self
        for _ in range(self.repeat if self.moves else 0):
            for move in self.moves:
                yield from move.each()


class MovesSettings(Settings):
    """Settings of the motion ``moves``."""

    moves: tuple[Move, ...] = Field(min_length=1, description="Moves, in order.")
    depth_limit: Length | None = Field(None, gt=0.0, description="Deepest a force may press [mm].")
    slide_limit: Length | None = Field(
        None, gt=0.0, description="Farthest a slide_force may push, along each of x and y [mm]."
    )
    tilt_limit: Angle | None = Field(
        None, gt=0.0, description="Farthest a tilt_moment may tilt, about each of x and y [degrees]."
    )
    twist_limit: Angle | None = Field(None, gt=0.0, description="Farthest a torque may turn [degrees].")

    @property
    def limits(self) -> tuple[float | None, ...]:
        """Limits to which a load may move each part."""
        return self.depth_limit, self.slide_limit, self.tilt_limit, self.twist_limit


class Moves(Motion[MovesSettings]):
    """Moves to places or until loads are reached, one after the other."""

    name = "moves"
    summary = "any sequence of depth, slide, tilt, twist, and of forces and moments to be reached"

    def __init__(self, settings: MovesSettings) -> None:
        super().__init__(settings)
        self._made = _followed(settings)

    def waypoints(self) -> Waypoints:
        """Rest, and the end of each move."""
        return self._made


def _followed(settings: MovesSettings) -> Waypoints:
    poses, loads, durations_s = [np.zeros(6)], [np.full(6, np.nan)], list[float | None]()
    for move in (single for each in settings.moves for single in each.each()):
        if len(poses) > MOST_WAYPOINTS:
            raise StudyError(f"the motion has more than {MOST_WAYPOINTS} moves; repeat less often")
        pose, load = _after(move, poses[-1], loads[-1], settings)
        _check_tilt(pose[3:5], "tilt" if np.isnan(load[3]) else "tilt_limit")
        poses.append(pose)
        loads.append(load)
        durations_s.append(move.duration)
    timed_s = [each for each in durations_s if each is not None]
    if timed_s and len(timed_s) < len(durations_s):
        raise StudyError(
            f"move {durations_s.index(None) + 1} of {len(durations_s)} has no duration, and others have one; "
            "give each move one, or none"
        )
    time_s = np.cumsum([0.0, *timed_s]) if timed_s else None
    return Waypoints(pose=np.array(poses), loads=np.array(loads), time_s=time_s)


def _check_tilt(tilt: FloatArray, key: str) -> None:
    if (size := float(np.hypot(*tilt))) >= MOST_TILT_DEG:
        about = f"{tilt[0]:g}° about x and {tilt[1]:g}° about y"
        raise StudyError(f"'{key}' tilts by {about}, {size:.3g}° in all; give less than {MOST_TILT_DEG:g}°")


def _after(
    move: Move, pose: FloatArray, load: FloatArray, settings: MovesSettings
) -> tuple[FloatArray, FloatArray]:
    """Pose and load (6,) at the end of a move, from those at its beginning."""
    pose, load = pose.copy(), np.where(np.isnan(load), np.nan, np.inf)
    for part, place, target, limit in zip(PARTS, move.places, move.loads, settings.limits, strict=True):
        columns = list(part.columns)
        if place is not None:
            pose[columns], load[columns] = place, np.nan
        elif target is not None:
            if limit is None:
                raise StudyError(f"'{part.load}' may move the indenter any far; add {part.limit} = …")
            pose[columns], load[columns] = limit, target
    return pose, load
