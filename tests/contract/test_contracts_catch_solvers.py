"""Each law of solvers fails on what breaks it, with the reason; a correct solver passes all."""

from dataclasses import replace
from itertools import pairwise
from types import MappingProxyType

import numpy as np
import pytest

from palpate import (
    Curve,
    HomogeneousTests,
    Indentation,
    Job,
    Provides,
    Response,
    Simulation,
    Solver,
    Sphere,
    Status,
    mechanics,
)
from palpate.domain import SurfaceStates
from palpate.mesh.specimens import block
from palpate.testing import LinearMaterial, SolverContract

PATH = [(0.0, 0.0), (5.0, 0.0), (5.0, -20.0), (5.0, 20.0), (5.0, 0.0)]


class Sound(Solver):
    """Force and torque of a half-space under a sphere, of the mean modulus; nothing for a negative one.

    Where there is a limb, its thickness stiffens the answer.
    """

    name, summary, n_steps = "sound", "without fault", 40
    provides = Provides(slopes=True, surface=True)

    def simulate(self, job, limb):
        stiffness = self.stiffness(job)
        if stiffness <= 0.0:
            return Simulation(job=job, status=Status.DIVERGED, response=None, message="no stable state")
        thickness = np.ptp(limb.mesh.points_mm[:, 2]) if limb else np.inf
        curves = self.curves(stiffness, job.protocol, thickness)
        if job.slopes:
            curves = {name: replace(c, slopes=self.slopes(c, job)) for name, c in curves.items()}
        surface = self.surface(job, limb, curves["force"]) if job.surface else None
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves), surface=surface)

    def surface(self, job, limb, force):
        """One triangle at the spot, which carries everything."""
        depth, spot, k = force.abscissa, limb.spot, len(force.abscissa)
        push = -np.outer(force.ordinate, spot.normal)
        return SurfaceStates(
            points_mm=spot.position_mm + np.eye(3),
            triangles=[[0, 1, 2]],
            depth_mm=depth,
            rotation_deg=np.zeros(k),
            positions_mm=spot.position_mm - np.outer(depth, spot.normal),
            rotations=np.tile(np.eye(3), (k, 1, 1)),
            displacements_mm=np.zeros((k, 3, 3)),
            areas_mm2=np.ones((k, 3)) / 3.0,
            touching=np.ones((k, 3)),
            pressures_MPa=np.outer(force.ordinate, np.ones(3)),
            shears_MPa=np.zeros((k, 3, 3)),
            tractions_MPa=np.repeat(push[:, None], 3, axis=1),
        )

    def slopes(self, curve, job):
        per_e = curve.ordinate / sum(theta[0] for theta in job.thetas.values())
        f = job.protocol.friction
        grips = curve.channel == "torque"
        per_f = grips * 0.1 / (1 + f) ** 2 / (0.9 + 0.1 * f / (1 + f)) * curve.ordinate
        return {**{f"{region}.e": per_e for region in job.thetas}, "friction": per_f}

    def stiffness(self, job):
        """Young's modulus: that of ``LinearMaterial`` is its parameter, and its Poisson's ratio 0."""
        return np.mean([theta[0] for theta in job.thetas.values()])

    def curves(self, young, press, thickness):
        ways = [a + np.linspace(0, 1, self.n_steps + 1)[1:, None] * (b - a) for a, b in pairwise(press.path)]
        depth, turn = np.concatenate([press.path[:1], *ways]).T
        radius = press.indenter.radius_mm
        contact = np.sqrt(radius * depth)
        # Load stepping in n steps that stops improving each one too early.
        force = 4 / 3 * young * contact * depth * (1 + contact / thickness) * (1 - 0.1 / self.n_steps)
        grip = 0.9 + 0.1 * press.friction / (1 + press.friction)
        torque = 8 / 3 * young * contact**3 * grip * np.radians(turn)
        last = self.n_steps  # of the press: after it the depth rests
        return {
            "force": Curve(channel="force", abscissa=depth[: last + 1], ordinate=force[: last + 1]),
            "torque": Curve(channel="torque", abscissa=turn[last:], ordinate=torque[last:]),
        }


def scaled(curves, factor):
    return {name: replace(curve, ordinate=factor * curve.ordinate) for name, curve in curves.items()}


class Fine(Sound):
    n_steps = 400


class CutShort(Sound):
    """Stops half way and returns ok."""

    def curves(self, *given):
        return {name: curve.cut(slice(0, 15)) for name, curve in super().curves(*given).items()}


class Boasting(Sound):
    provides = replace(Sound.provides, columns=("depth_mm", "force_N", "lateral_x_N"))


class WithoutBranches(Sound):
    """Sorts the twist by angle, so that its two ways become one."""

    def curves(self, *given):
        curves = super().curves(*given)
        turn = curves["torque"].abscissa
        order = np.argsort(turn, kind="stable")
        torque = Curve(channel="torque", abscissa=turn[order], ordinate=curves["torque"].ordinate[order])
        return {**curves, "torque": torque}


class Hopeful(Sound):
    def simulate(self, job, limb):
        curves = self.curves(abs(self.stiffness(job)), job.protocol, np.inf)
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))


class Undeclared(Sound):
    provides = replace(Sound.provides, channels=("force",))


class WithoutTorque(Sound):
    """Has no torque, which every solver declares by itself."""

    def curves(self, *given):
        return {"force": super().curves(*given)["force"]}


class WithoutTwist(Sound):
    provides = replace(Sound.provides, motions=("depth",))


class WithoutMesh(Sound):
    provides = replace(Sound.provides, body="layers")


class Mute(Sound):
    def simulate(self, job, limb):
        return replace(super().simulate(job, limb), message="")


class Loose(Sound):
    n_steps = 2


class OutOfProportion(Sound):
    def stiffness(self, job):
        return super().stiffness(job) + 0.01


class Disordered(Sound):
    def simulate_many(self, jobs, limb):
        yield from (self.simulate(job, limb) for job in reversed(list(jobs)))


class Noisy(Sound):
    def curves(self, *given):
        return scaled(super().curves(*given), 1 + 1e-7 * np.random.default_rng().random())


class BlindToFriction(Sound):
    def curves(self, young, press, thickness):
        return super().curves(young, replace(press, friction=1.0), thickness)


class BlindToRadius(Sound):
    def curves(self, young, press, thickness):
        return super().curves(young, replace(press, indenter=Sphere(radius_mm=7.5)), thickness)


class BlindToLimb(Sound):
    def curves(self, young, press, thickness):
        return super().curves(young, press, np.inf)


class FirstRegion(Sound):
    def stiffness(self, job):
        return next(iter(job.thetas.values()))[0]


class Ignorant(Sound):
    """Declares parameters as ignored that it uses."""

    def ignored(self, material):
        return ("e",)


class Misspelt(Sound):
    def ignored(self, material):
        return ("c3",)


class Downwards(Sound):
    def curves(self, *given):
        return scaled(super().curves(*given), -1.0)


class Mirrored(Sound):
    def curves(self, *given):
        curves = super().curves(*given)
        return {"force": curves["force"], **scaled({"torque": curves["torque"]}, -1.0)}


class InKilonewtons(Sound):
    def curves(self, *given):
        return scaled(super().curves(*given), 1e-3)


class Steep(Sound):
    def slopes(self, curve, job):
        return {name: 1.05 * values for name, values in super().slopes(curve, job).items()}


class BlindSlopes(Sound):
    def slopes(self, curve, job):
        found = super().slopes(curve, job)
        return {**found, "friction": 0.0 * found["friction"]}


class FewSlopes(Sound):
    def slopes(self, curve, job):
        return {"r0.e": super().slopes(curve, job)["r0.e"]}


class Pulling(Sound):
    def surface(self, job, limb, force):
        found = super().surface(job, limb, force)
        return replace(found, tractions_MPa=-found.tractions_MPa)


class Withholding(Sound):
    def surface(self, job, limb, force):
        return None


class Astray(Sound):
    def surface(self, job, limb, force):
        found = super().surface(job, limb, force)
        return replace(found, positions_mm=found.positions_mm + 1.0)


class WithSinkage(Sound):
    """Also measures how far the skin sinks next to the sphere: no modulus changes it."""

    def curves(self, young, press, thickness):
        curves = super().curves(young, press, thickness)
        depth = curves["force"].abscissa
        sinkage = depth * (1 - 0.1 * press.indenter.radius_mm / 7.5)
        return {**curves, "sinkage": Curve(channel="sinkage", abscissa=depth, ordinate=sinkage)}


def press(*stiffnesses):
    return Job(
        spot="p1",
        set_id=0,
        materials={f"r{k}": LinearMaterial() for k in range(len(stiffnesses))},
        thetas={f"r{k}": np.array([value]) for k, value in enumerate(stiffnesses)},
        protocol=Indentation(indenter=Sphere(radius_mm=7.5), path=PATH, friction=1.0),
    )


def hold(test, solver, contract=SolverContract):
    """Hold a solver against one law, of a job of two regions."""
    job, limb, laws = press(0.4, 0.6), block(n_across=2, n_down=1), contract()
    offered = {"solver": solver, "job": job, "limb": limb, "hopeless": press(-1.0), "finer": Fine()}
    offered |= {"half_space_solver": solver, "half_space": None, "answer": solver.simulate(job, limb)}
    method = getattr(laws, f"test_{test}")
    names = method.__code__.co_varnames[1 : method.__code__.co_argcount]
    method(**{name: offered[name] for name in names})


HALF_SPACE = "a_half_space_has_the_force_of_hertz_and_the_torque_of_reissner_and_sagoci"
INPUTS, PARAMETERS = "radius_friction_and_limb_matter", "a_parameter_matters_unless_it_is_ignored"
DECLARED = "it_provides_what_it_declares"
SLOPES = "slopes_are_those_of_central_differences"
SURFACE = "a_surface_carries_the_force_of_the_curves"
FAULTS = [
    ("simulates_the_whole_protocol", CutShort(), r"'force'.* runs 0 → 1\.75 where"),
    (
        "simulates_the_whole_protocol",
        WithoutBranches(),
        "'torque'.* runs -20 → 20 where .* 0 → -20 → 20 → 0",
    ),
    (DECLARED, Undeclared(), "the answer has torque, which is not among the channels of `provides`"),
    (DECLARED, WithoutTorque(), "no curve of torque, which `provides` declares"),
    (DECLARED, WithoutTwist(), "`provides` lacks what the job asks for: motions with rotation"),
    (DECLARED, WithoutMesh(), "`provides` declares the body 'layers', and the contract has a limb"),
    ("it_observes_every_channel_of_its_columns", Boasting(), "no curve over depth of force_N, lateral_x_N"),
    ("a_hopeless_job_is_no_success", Hopeful(), "status ok for a job that has no answer"),
    ("a_hopeless_job_is_no_success", Mute(), "status diverged without a message"),
    ("finer_settings_change_little", Loose(), "'force': finer settings change the answer by 0"),
    ("moduli_scale_the_response", OutOfProportion(), "moduli times 2 is not the curve times 2"),
    ("moduli_scale_the_response", WithSinkage(), "'sinkage'.*`degrees` names channels that do not scale"),
    ("many_jobs_come_back_in_order", Disordered(), "another order"),
    ("the_same_job_gives_the_same_bits", Noisy(), "the same job has two answers"),
    (INPUTS, BlindToFriction(), "another friction changes nothing"),
    (INPUTS, BlindToRadius(), "another radius changes nothing"),
    (INPUTS, BlindToLimb(), "another limb changes nothing"),
    (PARAMETERS, FirstRegion(), "'r1.e' changes nothing: use every region"),
    (PARAMETERS, Ignorant(), "`ignored` names 'r0.e', but the answer changes with it"),
    (PARAMETERS, Misspelt(), "`ignored` names c3, which 'linear' does not have"),
    (HALF_SPACE, Downwards(), "'force': -.* positive on the way in"),
    (HALF_SPACE, Mirrored(), "'torque': -.* of the rotation's sign"),
    (HALF_SPACE, InKilonewtons(), "force is in N"),
    (SLOPES, Steep(), r"'force': the slope in 'r0\.e' is off the central difference by"),
    (SLOPES, BlindSlopes(), "'torque': the slope in 'friction' is off"),
    (SURFACE, Pulling(), "the tractions press with 0 N where|the tractions press with -"),
    (SURFACE, Withholding(), "no surface, although the job asks for it"),
    (SURFACE, Astray(), "the indenter is not at its depth"),
    (SLOPES, FewSlopes(), r"slopes in r0\.e instead of friction, r0\.e, r1\.e"),
]


@pytest.mark.parametrize(("test", "solver", "expected"), FAULTS, ids=[type(s).__name__ for _, s, _ in FAULTS])
def test_a_solvers_fault_is_reported(test, solver, expected):
    with pytest.raises(AssertionError, match=f"(?s){expected}"):
        hold(test, solver)


@pytest.mark.parametrize("test", sorted({test for test, _, _ in FAULTS}))
def test_a_sound_solver_passes(test):
    hold(test, Sound())


class OfSinkage(SolverContract):
    degrees = MappingProxyType({"sinkage": 0})


def test_a_channel_of_degree_0_passes():
    hold("moduli_scale_the_response", WithSinkage(), OfSinkage)


class OfOneRegion(SolverContract):
    blind_to = frozenset({"friction", "radius", "limb", "parameters"})


@pytest.mark.parametrize("solver", [BlindToFriction(), BlindToRadius(), BlindToLimb(), FirstRegion()])
def test_inputs_declared_without_influence_pass(solver):
    hold(INPUTS, solver, OfOneRegion)
    hold(PARAMETERS, solver, OfOneRegion)


class Stretched(Solver):
    """Small-strain stress of a uniaxial and a shear test."""

    name, summary, factor = "stretched", "homogeneous", 1.0
    provides = Provides(body="specimen", max_regions=1, channels=("uniaxial", "simple_shear"))

    def simulate(self, job, limb):
        (material,), (theta,) = job.materials.values(), job.thetas.values()
        mu, kappa = mechanics.initial_moduli(material, theta)
        slopes = {"uniaxial": (1.0, 9 * kappa * mu / (3 * kappa + mu)), "simple_shear": (0.0, mu)}
        curves = {
            name: Curve(
                channel=name, abscissa=path, ordinate=self.factor * slopes[name][1] * (path - slopes[name][0])
            )
            for name, path in job.protocol.paths.items()
        }
        return Simulation(job=job, status=Status.OK, response=Response(curves=curves))


class InKilopascals(Stretched):
    factor = 1e3


def test_the_stress_of_a_homogeneous_test():
    paths = {"uniaxial": np.linspace(1, 2, 4), "simple_shear": np.linspace(0, 1, 4)}
    job, laws = replace(press(0.5), protocol=HomogeneousTests(paths=paths)), SolverContract()
    laws.test_small_strains_have_the_stress_of_the_initial_moduli(Stretched(), job)
    with pytest.raises(AssertionError, match="stress is nominal, in MPa"):
        laws.test_small_strains_have_the_stress_of_the_initial_moduli(InKilopascals(), job)


class TestStretched(SolverContract):
    """The whole contract, with its own fixtures: one answer serves all laws."""

    @pytest.fixture
    def solver(self):
        return Stretched()

    @pytest.fixture
    def job(self):
        paths = {"uniaxial": np.linspace(1, 2, 4)}
        return replace(press(0.5), protocol=HomogeneousTests(paths=paths))

    @pytest.fixture
    def hopeless(self):
        pytest.skip("a straight line has always an answer")

    @pytest.fixture
    def finer(self):
        pytest.skip("a closed form has no steps")
