"""Writes a FEBio 4.0 deck, the same bytes for the same problem.

The frame is the spot's: the spot is the origin, its outward normal +z. FEBio's
time counts steps (:mod:`palpate_febio.steps`), so a step that was asked for
is in the output at a whole number. Where a tissue relaxes it is in seconds.
"""

import re
import xml.etree.ElementTree as ET
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from palpate.api import FloatArray, IntArray, Mesh
from palpate_febio.contact_meshes import contact_faces, sphere_mesh
from palpate_febio.settings import PENALTY, FebioSettings, Method
from palpate_febio.spelling import DENSITY_T_PER_MM3, Written
from palpate_febio.steps import Steps

DECK_NAME = "job.feb"
LOG_NAME = "job.log"
RECORD_NAME = "rigid.csv"
RECORD_DATA = ("z", "thz", "Fx", "Fy", "Fz", "Mx", "My", "Mz")
INDENTER = "indenter"

DIGITS = 12
"""Of a number: as many as FEBio prints."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Problem:
    """Everything that decides a deck.

    Parameters
    ----------
    mesh : Mesh
        In the spot's frame.
    radius_mm : float
        Of the sphere.
    method : str
        How to solve; see :data:`palpate_febio.settings.Method`.
    """

    mesh: Mesh
    materials: Mapping[str, Written]
    radius_mm: float
    friction: float
    steps: Steps
    settings: FebioSettings
    method: Method = "broyden"

    @property
    def bonded(self) -> bool:
        """True if the indenter is glued to the skin by the node set ``bonded``, and touches nothing else."""
        return bool(np.size(self.mesh.node_sets.get("bonded", ())))

    @property
    def augmented(self) -> bool:
        """True if contact is enforced by augmented Lagrangian: friction has no memory without it."""
        return self.friction > 0.0 and self.settings.contact == "right"

    @property
    def penalty(self) -> float:
        """Penalty of the contact, in units of FEBio's automatic one."""
        chosen = self.settings.penalty or PENALTY[self.settings.contact]
        return chosen / 4.0 if self.method == "broyden_soft" else chosen


def write_deck(problem: Problem) -> bytes:
    """The deck.

    Returns
    -------
    bytes
        ASCII; numbers to 12 digits, which is what FEBio prints.

    Raises
    ------
    MeshError
        The mesh has no face to touch.
    """
    root, control = new_deck(problem.steps.time)
    _control(control, problem)
    _materials(root, problem)
    _mesh(root, problem)
    _boundary(root, problem)
    _rigid(root, problem)
    if not problem.bonded:
        _contact(root, problem)
    _load_data(root, problem.steps)
    log = ET.SubElement(ET.SubElement(root, "Output"), "logfile")
    data = {"data": ";".join(RECORD_DATA), "delim": ",", "file": RECORD_NAME}
    leaf(log, "rigid_body_data", rigid_id(problem), **data)
    return to_bytes(root)


def new_deck(times: FloatArray) -> tuple[ET.Element, ET.Element]:
    """Root of a deck, and its control: statics up to the last time, and no plot file.

    The first step is no longer than the shortest between the times.
    """
    n_steps = int(np.ceil(times[-1] / np.diff(times).min() - 1e-9))
    step = times[-1] / n_steps
    root = ET.Element("febio_spec", version="4.0")
    leaf(ET.SubElement(root, "Module", type="solid"), "units", "mm-N-s")
    control = ET.SubElement(root, "Control")
    steps = {
        "analysis": "STATIC",
        "time_steps": n_steps,
        "step_size": _number(step),
        "plot_level": "PLOT_NEVER",
    }
    leaves(control, steps)
    constants = ET.SubElement(ET.SubElement(root, "Globals"), "Constants")
    leaves(constants, dict.fromkeys(("T", "R", "Fc"), 0))  # FEBio loses its way after an empty section
    return root, control


def add_material(section: ET.Element, number: int, name: str, material: Written, digits: int) -> None:
    """Add a material as FEBio spells it."""
    element = ET.SubElement(section, "material", id=str(number), name=name, type=material.febio_type)
    layer: Written | None = material
    while layer is not None:
        for tag, value in (("density", DENSITY_T_PER_MM3), *layer.values):
            leaf(element, tag, format(value + 0.0, f".{digits}g"))
        layer = layer.elastic
        if layer is not None:
            element = ET.SubElement(element, "elastic", type=layer.febio_type)


def hold(section: ET.Element, node_set: str) -> None:
    """Add the boundary condition that a node set does not move."""
    held = ET.SubElement(section, "bc", name=node_set, node_set=node_set, type="zero displacement")
    leaves(held, dict.fromkeys(("x_dof", "y_dof", "z_dof"), 1))


def rigid_id(problem: Problem) -> int:
    """Number of the indenter's material: FEBio prints zeros for any other, and ends well."""
    return len(problem.mesh.regions) + 1


def to_bytes(root: ET.Element) -> bytes:
    """An element tree as FEBio's reader likes it: declaration, then one tag to a line."""
    ET.indent(root, " ")
    body: bytes = ET.tostring(root, encoding="us-ascii")
    return b'<?xml version="1.0" encoding="ISO-8859-1"?>\n' + body + b"\n"


def leaf(parent: ET.Element, tag: str, value: object, **attributes: str) -> None:
    """Add an element that holds a value alone."""
    ET.SubElement(parent, tag, attributes).text = str(value)


def leaves(parent: ET.Element, values: Mapping[str, object]) -> None:
    """Add an element for each name and value."""
    for name, value in values.items():
        leaf(parent, name, value)


def _number(value: float) -> str:
    return format(value + 0.0, f".{DIGITS}g")


def _numbers(values: Iterable[float]) -> str:
    return ",".join(map(_number, values))


def safe_name(name: str) -> str:
    """A region's name as FEBio may read it."""
    return re.sub(r"[^A-Za-z0-9_-]", "_", name)


def _material_name(problem: Problem, region: str) -> str:
    return f"{problem.mesh.regions.index(region) + 1}_{safe_name(region)}"


# -------------------------------------------------------------------- control


def _control(control: ET.Element, problem: Problem) -> None:
    solver = ET.SubElement(control, "solver", type="solid")
    leaves(
        solver,
        {
            "symmetric_stiffness": "non-symmetric",
            "equation_scheme": "staggered",
            "max_refs": 40,
            "diverge_reform": 1,
            "reform_each_time_step": 1,
            "dtol": 0.001,
            "etol": 0.01,
            "rtol": 0,
            "lstol": 0.9,
            "min_residual": 1e-14,
            "rhoi": 0,
        },
    )
    if problem.method.startswith("broyden"):
        leaf(ET.SubElement(solver, "qn_method", type="Broyden"), "max_ups", 10)
    else:
        ET.SubElement(solver, "qn_method", type="full Newton")
    if problem.settings.linear_solver:
        ET.SubElement(solver, "linear_solver", type=problem.settings.linear_solver)
    stepper = ET.SubElement(control, "time_stepper", type="default")
    # FEBio would shorten steps after a few iterations: augmentation takes many, and each step forgets.
    leaves(
        stepper,
        {
            "max_retries": 12,
            "opt_iter": 1000,
            "dtmin": _number(1e-3 * np.diff(problem.steps.time).min()),
            "aggressiveness": 1,
            "cutback": 0.5,
        },
    )
    leaf(stepper, "dtmax", 1, lc="3")


def _materials(root: ET.Element, problem: Problem) -> None:
    section = ET.SubElement(root, "Material")
    for k, region in enumerate(problem.mesh.regions, start=1):
        add_material(section, k, _material_name(problem, region), problem.materials[region], DIGITS)
    rigid = ET.SubElement(section, "material", id=str(rigid_id(problem)), name=INDENTER, type="rigid body")
    leaf(rigid, "density", _number(DENSITY_T_PER_MM3))
    leaf(rigid, "override_com", 1)
    leaf(rigid, "center_of_mass", _numbers((0.0, 0.0, problem.radius_mm)))


# ----------------------------------------------------------------------- mesh


def _mesh(root: ET.Element, problem: Problem) -> None:
    section = ET.SubElement(root, "Mesh")
    mesh, ball = problem.mesh, sphere_mesh(problem.radius_mm, problem.settings.facet_mm)
    nodes = ET.SubElement(section, "Nodes", name="all")
    points = np.vstack([mesh.points_mm, ball.points_mm + np.array([0.0, 0.0, problem.radius_mm])])
    for k, point in enumerate(points.tolist(), start=1):
        leaf(nodes, "node", _numbers(point), id=str(k))
    domains = [*_parts(mesh), ("tet4", INDENTER, ball.tets + mesh.n_nodes)]
    first = 1
    for kind, name, cells in domains:
        element = ET.SubElement(section, "Elements", type=kind, name=name)
        _cells(element, "elem", cells, first)
        first += len(cells)
    for name in ("fixed", "bonded"):
        if np.size(chosen := mesh.node_sets.get(name, ())):
            leaf(section, "NodeSet", ",".join(map(str, np.asarray(chosen) + 1)), name=name)
    if not problem.bonded:
        _surfaces(section, contact_faces(mesh), ball.faces + mesh.n_nodes)
    _domains(root, problem, domains)


def _parts(mesh: Mesh) -> list[tuple[str, str, IntArray]]:
    """Elements of one kind and region each, with the name of the part."""
    return [
        (kind, f"{r + 1}_{safe_name(region)}_{kind}", mesh.cells[kind][mesh.cell_regions[kind] == r])
        for r, region in enumerate(mesh.regions)
        for kind in sorted(mesh.cells)
        if (mesh.cell_regions[kind] == r).any()
    ]


def _cells(parent: ET.Element, tag: str, cells: IntArray, first: int) -> None:
    for k, cell in enumerate((cells + 1).tolist(), start=first):
        leaf(parent, tag, ",".join(map(str, cell)), id=str(k))


def _surfaces(section: ET.Element, faces_by_kind: Mapping[str, IntArray], ball: IntArray) -> None:
    surface = ET.SubElement(section, "Surface", name="skin_surface")
    first = 1
    for kind, faces in faces_by_kind.items():
        _cells(surface, kind, faces, first)
        first += len(faces)
    _cells(ET.SubElement(section, "Surface", name="indenter_surface"), "tri3", ball, 1)
    pair = ET.SubElement(section, "SurfacePair", name="contact")
    leaf(pair, "primary", "skin_surface")
    leaf(pair, "secondary", "indenter_surface")


def _domains(root: ET.Element, problem: Problem, domains: list[tuple[str, str, IntArray]]) -> None:
    section = ET.SubElement(root, "MeshDomains")
    for kind, name, _ in domains:
        domain = ET.SubElement(section, "SolidDomain", name=name, mat=INDENTER)
        if name != INDENTER:
            region = problem.mesh.regions[int(name.split("_")[0]) - 1]
            domain.set("mat", _material_name(problem, region))
            if kind == "tet10" and problem.materials[region].uncoupled:
                # One pressure and one volume change per element: FEBio's default for hex8, and here for
                # tet10 too.
                domain.set("type", "three-field-solid")


# -------------------------------------------------------- supports and motion


def _boundary(root: ET.Element, problem: Problem) -> None:
    section = ET.SubElement(root, "Boundary")
    hold(section, "fixed")
    if problem.bonded:
        glue = ET.SubElement(section, "bc", name="glue", node_set="bonded", type="rigid")
        leaf(glue, "rb", rigid_id(problem))


def _rigid(root: ET.Element, problem: Problem) -> None:
    section = ET.SubElement(root, "Rigid")
    lock = ET.SubElement(section, "rigid_bc", name="lock", type="rigid_fixed")
    leaf(lock, "rb", rigid_id(problem))
    leaves(lock, {"Rx_dof": 1, "Ry_dof": 1, "Rz_dof": 0, "Ru_dof": 1, "Rv_dof": 1, "Rw_dof": 0})
    for name, kind, dof, curve, scale in (
        ("press", "rigid_displacement", "z", "1", -1),
        ("twist", "rigid_rotation", "Rw", "2", 1),
    ):
        motion = ET.SubElement(section, "rigid_bc", name=name, type=kind)
        leaf(motion, "rb", rigid_id(problem))
        leaf(motion, "dof", dof)
        leaf(motion, "value", scale, lc=curve)
        leaf(motion, "relative", 0)


def _contact(root: ET.Element, problem: Problem) -> None:
    section = ET.SubElement(root, "Contact")
    contact = ET.SubElement(
        section, "contact", name="contact", surface_pair="contact", type="sliding-elastic"
    )
    settings = problem.settings
    leaves(
        contact,
        {
            "laugon": "AUGLAG" if problem.augmented else "PENALTY",
            "tolerance": _number(settings.augmentation_tolerance),
            "gaptol": _number(settings.gap_tolerance_mm if problem.augmented else 0.0),
            "penalty": _number(problem.penalty),
            "auto_penalty": 1,
            "update_penalty": 0,
            "two_pass": 0,
            "minaug": 0,
            "maxaug": settings.max_augmentations,
            "knmult": 0,
            "search_tol": 0.01,
            "symmetric_stiffness": 0,
            "search_radius": _number(0.4 * problem.radius_mm),
            "tension": 0,
            "fric_coeff": _number(problem.friction),
            "node_reloc": 0,
        },
    )


def _load_data(root: ET.Element, steps: Steps) -> None:
    section, longest = ET.SubElement(root, "LoadData"), np.diff(steps.time).max()
    for k, values, form in (
        (1, steps.depth_mm, "LINEAR"),
        (2, np.deg2rad(steps.rotation_deg), "LINEAR"),
        (3, np.full(steps.n + 1, longest), "STEP"),
    ):
        curve = ET.SubElement(section, "load_controller", id=str(k), type="loadcurve")
        leaf(curve, "interpolate", form)
        leaf(curve, "extend", "CONSTANT")
        points = ET.SubElement(curve, "points")
        for point in zip(steps.time.tolist(), values.tolist(), strict=True):
            leaf(points, "pt", _numbers(point))
