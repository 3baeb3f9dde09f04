"""An indenter and channels that nothing in palpate knows: a bowl, and what a twist does to its press."""

import numpy as np
from pydantic import Field

from palpate.api import Channel, Indenter, Scenario, Settings, hookimpl


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


def lever(columns):
    """Torque over force."""
    return columns["torque_Nmm"] / columns["force_N"]


@hookimpl
def palpate_indenters():
    """Provide the indenter."""
    return [Bowl]


@hookimpl
def palpate_channels():
    """Provide the force while it turns, and the lever, which no common factor of the moduli changes."""
    return [
        Channel(
            name="held_force",
            abscissa="rotation_deg",
            ordinate="force_N",
            abscissa_label="rotation (degrees)",
            ordinate_label="force in the twist (N)",
            mirrored=1,
        ),
        Channel(
            name="lever",
            abscissa="rotation_deg",
            ordinate="lever_mm",
            abscissa_label="rotation (degrees)",
            ordinate_label="torque over force (mm)",
            degree=0,
            mirrored=-1,
            needs=("torque_Nmm", "force_N"),
            observe=lever,
        ),
    ]


@hookimpl
def palpate_scenarios():
    """Provide scenarios of the third channel."""
    return [
        Scenario(name="held", weights={"held_force": 1.0, "lever": 1.0}, description="what a twist changes"),
        Scenario(name="three", weights={"force": 1.0, "held_force": 1.0}, description="force twice"),
    ]
