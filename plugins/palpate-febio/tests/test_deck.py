"""Decks: the same bytes, the same content when read back, and names that others know too."""

import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest

from palpate import AnisotropicMaterial
from palpate.domain import Spot
from palpate.errors import MaterialError, MeshError, SolverError
from palpate.mesh.specimens import block
from palpate.mesh.spot_frame import in_spot_frame
from palpate_febio.deck import rigid_id
from palpate_febio.deck_reader import read_deck
from palpate_febio.solver import FebioSolver
from palpate_febio.steps import halved, steps_of, up_to_first_turn, with_hold
from palpate_materials import ArrudaBoyce, Demiray, Gent, NeoHookean, Ogden, Yeoh
from palpate_materials.uncoupled import OgdenSettings

from .decks import (
    SOLVER,
    THETAS,
    TWIST,
    job_of,
    materials_in,
    mixed_limb,
    numbers,
    relaxing_job,
)

SNAPSHOTS = Path(__file__).parent / "data" / "decks"


def without_ball(deck):
    """The deck without the lines of the indenter's mesh, which depend on the machine's cosine."""
    keep, inside = [], False
    for line in deck.decode("ascii").splitlines():
        inside = inside or 'type="tet4" name="indenter"' in line or 'name="indenter_surface"' in line
        if inside and line.startswith(("   <elem", "   <tri3")):
            continue
        inside = inside and "</Elements>" not in line and "</Surface>" not in line
        if line.startswith("   <node ") and int(line.split('"')[1]) > 22:
            continue
        keep.append(line)
    return "\n".join(keep) + "\n"


@pytest.mark.parametrize("name", ["frictional", "frictionless", "paper", "bonded", "newton"])
def test_decks_are_these(name, monkeypatch):
    limb, job, settings = mixed_limb(), job_of(), SOLVER.settings
    if name == "frictionless":
        job = job_of(TWIST[:2], friction=0.0)
    if name == "paper":
        settings = settings.model_copy(update={"contact": "paper"})
    if name == "newton":
        settings = settings.model_copy(update={"fallbacks": ("newton",), "linear_solver": "skyline"})
    if name == "bonded":
        sets = {**limb.mesh.node_sets, "bonded": [4, 5]}
        limb = replace(limb, mesh=replace(limb.mesh, node_sets=sets))
    found = without_ball(FebioSolver(settings).write_deck(job, limb))
    file = SNAPSHOTS / f"{name}.feb"
    # Delete a snapshot to renew it.
    if not file.exists():
        file.write_text(found)
        pytest.fail(f"{file} was missing and has been written: look at it")
    assert found == file.read_text()


@pytest.mark.slow
def test_the_bytes_do_not_depend_on_the_run():
    code = (
        "import sys; sys.path.insert(0, sys.argv[1]); import decks as t, hashlib; "
        "print(hashlib.sha256(t.SOLVER.write_deck(t.job_of(), t.mixed_limb())).hexdigest())"
    )
    seen = set()
    for seed in ("1", "2"):
        ran = subprocess.run(
            [sys.executable, "-c", code, str(Path(__file__).parent)],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            text=True,
            check=True,
        )
        seen.add(ran.stdout)
    assert len(seen) == 1


def formulations(job, limb):
    domains = ET.fromstring(SOLVER.write_deck(job, limb)).iterfind("MeshDomains/SolidDomain")
    return {domain.get("name"): domain.get("type") for domain in domains}


class Joined(NeoHookean):
    """A material of a plugin, which FEBio has with a bulk modulus in a coupled energy."""

    name, febio = "joined", ("coupled Mooney-Rivlin", {"E": "c1", "nu": "k"})


def test_tet10_has_one_pressure_per_element_where_febio_can():
    """FEBio's default for tet10 is the displacement element, which locks; hex8 has three fields by itself."""
    uncoupled = {"skin": Ogden(), "soft tissue": Yeoh(), "fat": NeoHookean()}
    assert formulations(job_of(), mixed_limb()) == {
        "1_skin_hex8": None,
        "2_soft_tissue_tet10": "three-field-solid",
        "3_fat_tet4": None,
        "indenter": None,
    }
    for material in (NeoHookean(), Joined()):
        job = replace(
            job_of(),
            materials={**uncoupled, "soft tissue": material},
            thetas={**THETAS, "soft tissue": THETAS["fat"]},
        )
        assert formulations(job, mixed_limb())["2_soft_tissue_tet10"] is None
    assert formulations(relaxing_job(), mixed_limb())["2_soft_tissue_tet10"] == "three-field-solid"


def test_what_is_read_back_is_what_was_written(tmp_path):
    spot = Spot(name="p1", position_mm=[0.5, 0.5, 0.0], normal=[0.1, -0.2, 1.0])
    limb = mixed_limb(spot)
    file = tmp_path / "job.feb"
    file.write_bytes(SOLVER.write_deck(job_of(), limb))
    deck, mesh = read_deck(file), in_spot_frame(limb)
    np.testing.assert_allclose(deck.points[: mesh.n_nodes], mesh.points_mm, atol=1e-11)
    assert [(p.kind, p.material) for p in deck.parts] == [
        ("hex8", "1_skin"),
        ("tet10", "2_soft_tissue"),
        ("tet4", "3_fat"),
    ]
    for part in deck.parts:
        np.testing.assert_array_equal(part.cells, mesh.cells[part.kind])
    np.testing.assert_array_equal(deck.node_sets["fixed"], mesh.node_sets["fixed"])
    np.testing.assert_array_equal(deck.surfaces["skin_surface"], np.sort(mesh.node_sets["contact"]))
    np.testing.assert_array_equal(deck.supports[0].nodes, mesh.node_sets["fixed"])
    assert [support.axes for support in deck.supports] == ["xyz"]
    written = {
        material.get("name"): {child.tag: float(child.text) for child in material}
        for material in ET.parse(file).getroot().iterfind("Material/material")
        if material.get("type") != "rigid body"
    }
    assert written["2_soft_tissue"] == {"density": 1e-9, "c1": 0.0129, "c2": -2e-3, "c3": 2.76e-4, "k": 0.6}
    assert written["1_skin"] == {"density": 1e-9, "c1": 0.16, "m1": 6.0, "k": 2.0}


def test_laws_of_several_terms_and_of_limited_chains_are_written():
    four = np.array([0.06, 3.0, 0.01, -2.0, 0.02, 5.0, 0.01, -1.5, 1.0])
    materials = {"skin": Ogden(OgdenSettings(terms=4)), "soft tissue": Gent()}
    thetas = {"skin": four, "soft tissue": np.array([0.03, 40.0, 0.9])}
    job = job_of()
    job = replace(job, materials={**job.materials, **materials}, thetas={**job.thetas, **thetas})
    found = materials_in(SOLVER.write_deck(job, mixed_limb()))
    names = [f"{name}{k}" for k in range(1, 5) for name in "cm"]
    assert numbers(found["1_skin"]) == dict(zip([*names, "k"], four, strict=True))
    assert found["2_soft_tissue"].get("type") == "Gent"
    assert numbers(found["2_soft_tissue"]) == {"G": 0.03, "Jm": 40.0, "k": 0.9}
    assert formulations(job, mixed_limb())["2_soft_tissue_tet10"] == "three-field-solid"


@pytest.mark.parametrize("material", [Demiray(), ArrudaBoyce()])
def test_materials_that_febio_lacks_are_refused(material):
    job = job_of()
    fat = {**job.materials, "fat": material}
    thetas = {**job.thetas, "fat": np.array([0.05, 1.0, 1.0])}
    with pytest.raises(MaterialError, match=f"{material.name}.*attribute febio"):
        SOLVER.write_deck(replace(job, materials=fat, thetas=thetas), mixed_limb())


def test_a_surface_that_cannot_be_touched_is_refused():
    limb = mixed_limb()
    sets = {**limb.mesh.node_sets, "contact": [4, 5]}
    with pytest.raises(MeshError, match="no outer face"):
        SOLVER.write_deck(job_of(), replace(limb, mesh=replace(limb.mesh, node_sets=sets)))


class Fibred(AnisotropicMaterial):
    """A matrix and fibres along e1."""

    name, summary, parameters = "fibred", "one family of fibres", NeoHookean.parameters

    def energy_from_F(self, F, theta, fields=None):  # noqa: N802 - the interface's name
        J = jnp.linalg.det(F)
        matrix = jnp.sum(F * F) * J ** (-2 / 3) - 3.0
        return theta[0] * (matrix + (jnp.sum(F[:, 0] ** 2) - 1.0) ** 2) + theta[1] * jnp.log(J) ** 2


def test_directions_are_refused_where_the_deck_is_turned_against_the_mesh():
    limb = block("hex8", n_across=2, n_down=1, width_mm=4.0, height_mm=3.0)
    limb = replace(limb, spot=Spot(name="p1", normal=[0.0, np.sin(0.3), np.cos(0.3)]))
    thetas = {"soft_tissue": np.array([0.02, 0.4])}
    job = replace(job_of(), materials={"soft_tissue": Fibred()}, thetas=thetas)
    with pytest.raises(SolverError, match="has directions, and FEBio's deck is in the frame of the spot"):
        SOLVER.check(job, limb)


# ------------------------------------------------------------------ relaxation


# ---------------------------------------------------------------------- steps


def test_every_waypoint_is_a_step():
    steps = steps_of(job_of().protocol, 3, 5.0)
    found = np.column_stack([steps.depth_mm, steps.rotation_deg])
    for waypoint in TWIST:
        assert (found == waypoint).all(axis=1).any()
    assert steps.n == 3 + 5 + 9 + 5
    assert np.abs(np.diff(steps.rotation_deg)).max() <= 5.0


def test_halving_keeps_every_second_step_and_a_hold_stays():
    steps = steps_of(job_of().protocol, 3, 5.0)
    fine = halved(steps)
    np.testing.assert_array_equal(fine.depth_mm[::2], steps.depth_mm)
    np.testing.assert_array_equal(fine.rotation_deg[::2], steps.rotation_deg)
    first = up_to_first_turn(steps)
    assert first.rotation_deg[-1] == -22.5
    assert (with_hold(first, 4).rotation_deg[-5:] == -22.5).all()
    straight = steps_of(job_of(TWIST[:3]).protocol, 3, 5.0)
    assert up_to_first_turn(straight).n == straight.n


# --------------------------------------------------------- an independent view


def plain(element):
    """Children as pyfebio's models want them: numbers as numbers, choices of words as words."""
    found = {}
    for child in element:
        text = (child.text or "").strip()
        value = text
        for read in (int, float):
            try:
                value = read(text)
                break
            except ValueError:
                continue
        found[child.tag] = value
    return found


def accepted(model, element, **more):
    """The model built from a section; a tag that it does not know fails."""
    given = {**plain(element), **{k: v for k, v in element.attrib.items() if k != "type"}, **more}
    unknown = set(given) - set(model.model_fields)
    assert not unknown, f"{model.__name__} knows no {unknown}"
    return model(**given)


@pytest.fixture(scope="module")
def root():
    return ET.fromstring(SOLVER.write_deck(job_of(), mixed_limb()))


def test_pyfebio_has_every_name_in_the_control_section(root):
    pyfebio = pytest.importorskip("pyfebio")
    control = root.find("Control")
    solver, stepper = control.find("solver"), control.find("time_stepper")
    broyden = accepted(pyfebio.control.BroydenMethod, solver.find("qn_method"))
    built = accepted(
        pyfebio.control.Control,
        control,
        solver=accepted(pyfebio.control.SolidSolver, solver, qn_method=broyden),
        time_stepper=accepted(
            pyfebio.control.TimeStepper,
            stepper,
            dtmax=pyfebio.control.TimeStepValue(lc=int(stepper.find("dtmax").get("lc")), text=1.0),
        ),
    )
    assert built.solver.qn_method.max_ups == 10
    assert built.time_stepper.dtmin == 1e-3


def test_pyfebio_has_every_name_of_contact_motion_and_support(root):
    pyfebio = pytest.importorskip("pyfebio")
    contact = accepted(pyfebio.contact.SlidingElastic, root.find("Contact/contact"))
    assert (contact.laugon, contact.fric_coeff) == ("AUGLAG", 1.0)
    lock, press, twist = root.findall("Rigid/rigid_bc")
    fixed = accepted(pyfebio.rigid.RigidFixed, _unnamed(lock), rb="3")
    assert (fixed.Rx_dof, fixed.Rz_dof, fixed.Rw_dof) == (1, 0, 0)
    for motion, lc, scale in ((press, 1, -1.0), (twist, 2, 1.0)):
        value = pyfebio.rigid.Value(lc=lc, text=scale)
        assert motion.find("value").get("lc") == str(lc)
        built = pyfebio.rigid.RigidPrescribed(
            **{**plain(motion), "rb": "4", "value": value, "type": motion.get("type")}
        )
        assert built.value.text == float(motion.findtext("value"))
    held = accepted(pyfebio.boundary.BCZeroDisplacement, _unnamed(root.find("Boundary/bc")))
    assert held.node_set == "fixed"


def _unnamed(element):
    element.attrib.pop("name", None)
    return element


def test_pyfebio_reads_the_mesh_curves_and_record(root):
    pyfebio = pytest.importorskip("pyfebio")
    for curve in root.findall("LoadData/load_controller"):
        points = [pt.text for pt in curve.iterfind("points/pt")]
        built = pyfebio.loaddata.LoadCurve(
            id=int(curve.get("id")),
            interpolate=curve.findtext("interpolate"),
            extend=curve.findtext("extend"),
            points=pyfebio.loaddata.CurvePoints(points=points),
        )
        assert [float(p.split(",")[0]) for p in built.points.points] == list(range(len(points)))
    ours = ET.fromstring(without_ball(ET.tostring(root))).find("Mesh")  # it takes long over many nodes
    for name in ("Elements", "Surface"):
        ours.remove(next(e for e in ours.findall(name) if e.get("name").startswith("indenter")))
    mesh = pyfebio.mesh.Mesh.from_xml(ET.tostring(ours))
    assert len(mesh.nodes[0].all_nodes) == 22
    assert [e.type for e in mesh.elements] == ["hex8", "tet10", "tet4"]
    record = root.find("Output/logfile/rigid_body_data")
    known = {entry.value for entry in pyfebio.output.RigidBodyDataEnum}
    assert set(record.get("data").split(";")) <= known
    rigid = root.find("Material/material[@type='rigid body']")
    assert record.text == rigid.get("id") == str(rigid_id(SOLVER.problem(job_of(), mixed_limb())))


def test_pyfebio_has_the_materials(root):
    pyfebio = pytest.importorskip("pyfebio")
    models = {"Ogden": "OgdenUC", "Yeoh": "Yeoh", "neo-Hookean": "NeoHookean"}
    for element in root.findall("Material/material")[:3]:
        model = getattr(pyfebio.material, models[element.get("type")])
        # Its bound that no coefficient is negative is not FEBio's: only names are compared.
        assert {child.tag for child in element} <= set(model.model_fields)
        assert model.model_fields["type"].default == element.get("type")
