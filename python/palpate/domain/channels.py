"""The channels of an indenter's equilibrium states: what does work along each part of its motion."""

from palpate.domain.curves import Channel
from palpate.domain.mesh_convergence import MeshConvergence

FORCE = Channel(
    name="force",
    abscissa="depth_mm",
    ordinate="force_N",
    abscissa_label="indentation depth (mm)",
    ordinate_label="normal force (N)",
    non_negative=True,
    zero_at_start=True,
    dissipative=True,
    length_power=2,
    mirrored=1,
    mesh=MeshConvergence(rim_order=3.5, order=2.0, usual=0.03, scatter=0.0025),
)

TORQUE = Channel(
    name="torque",
    abscissa="rotation_deg",
    ordinate="torque_Nmm",
    abscissa_label="rotation (degrees)",
    ordinate_label="torque (N·mm)",
    zero_at_start=True,
    dissipative=True,
    length_power=3,
    mirrored=-1,
)

LATERAL_FORCE = Channel(
    name="lateral_force",
    abscissa="slide_mm",
    ordinate="lateral_force_N",
    abscissa_label="lateral shift (mm)",
    ordinate_label="lateral force (N)",
    dissipative=True,
    length_power=2,
    mirrored=1,
)

TILT_MOMENT = Channel(
    name="tilt_moment",
    abscissa="tilt_deg",
    ordinate="tilt_moment_Nmm",
    abscissa_label="tilt (degrees)",
    ordinate_label="tilt moment (N·mm)",
    dissipative=True,
    length_power=3,
    mirrored=1,
)

PRESS_AND_TWIST = (FORCE, TORQUE)
"""Channels that a job asks for by itself."""

EQUILIBRIUM_CHANNELS = (*PRESS_AND_TWIST, LATERAL_FORCE, TILT_MOMENT)
"""Channels that palpate declares."""
