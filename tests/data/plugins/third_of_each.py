"""An indenter, a motion and channels that nothing in palpate knows: a bowl that wipes the skin."""

import numpy as np
from pydantic import Field

from palpate.api import LATERAL_FORCE, Channel, Indenter, Motion, Scenario, Settings, Waypoints, hookimpl


class BowlSettings(Settings):
    """Settings of the indenter ``bowl``."""

    tip: float = Field(8.0, gt=0.0, description="Radius of its lowest point [mm].")


class Bowl(Indenter[BowlSettings]):
    """A body between two spheres: what both have inside, smoothly."""

    name = "bowl"
    summary = "a rounded bowl"

    def __init__(self, settings=None):
        super().__init__(settings)
        self.radius_mm = self.edge_mm = self.settings.tip
        self.bounds_mm = np.array([[-1.0, -1.0, 0.0], [1.0, 1.0, 2.0]]) * self.settings.tip

    def distance(self, points):
        """Signed distance of a sphere on its lowest point."""
        xp = points.__array_namespace__()
        centre = xp.asarray([0.0, 0.0, self.settings.tip])
        return xp.sqrt(xp.sum((points - centre) ** 2, axis=-1)) - self.settings.tip


class WipeSettings(Settings):
    """Settings of the motion ``wipe``."""

    depth: float = Field(2.0, gt=0.0, description="How deep it presses [mm].")
    reach: float = Field(1.0, gt=0.0, description="How far it wipes to both sides [mm].")


class Wipe(Motion[WipeSettings]):
    """Press, and wipe to and fro, oblique to x and y."""

    name = "wipe"
    summary = "press, and wipe to and fro"

    def waypoints(self):
        """Rest, the depth, and both sides."""
        pose = np.zeros((4, 6))
        pose[1:, 0] = self.settings.depth
        pose[2:, 1:3] = self.settings.reach * np.array([[0.8, 0.6], [-0.8, -0.6]])
        return Waypoints(pose=pose)


def grip(columns):
    """Lateral over normal force."""
    return columns["lateral_force_N"] / columns["force_N"]


@hookimpl
def palpate_indenters():
    """Provide the indenter."""
    return [Bowl]


@hookimpl
def palpate_motions():
    """Provide the motion."""
    return [Wipe]


@hookimpl
def palpate_channels():
    """Provide the normal force of the wipe, and the grip, which no common factor of the moduli changes."""
    return [
        Channel(
            name="wiped_force",
            abscissa="slide_mm",
            ordinate="force_N",
            abscissa_label="wipe (mm)",
            ordinate_label="normal force in the wipe (N)",
            mirrored=1,
        ),
        Channel(
            name="grip",
            abscissa="slide_mm",
            ordinate="grip_1",
            abscissa_label="wipe (mm)",
            ordinate_label="lateral over normal force",
            degree=0,
            mirrored=1,
            needs=("lateral_force_N", "force_N"),
            observe=grip,
        ),
        LATERAL_FORCE,
    ]


@hookimpl
def palpate_scenarios():
    """Provide scenarios of the third channels."""
    weights = {"lateral_force": 1.0, "grip": 1.0, "wiped_force": 1.0}
    return [
        Scenario(name="wiped", weights=weights, description="what a wipe shows"),
        Scenario(name="slid", weights={"force": 1.0, "lateral_force": 1.0}, description="press and wipe"),
    ]
