"""Laws of solvers."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest

from palpate.domain import (
    COMPLIANCE,
    DEEPER,
    FRICTION,
    Channel,
    Curve,
    FloatArray,
    HomogeneousTests,
    Indentation,
    Job,
    Limb,
    ParameterName,
    Response,
    Simulation,
    Status,
    moving_span,
)
from palpate.domain.channels import FORCE
from palpate.domain.equilibrium_states import POSE, STATE_COLUMNS, WRENCH
from palpate.domain.indenter import Sphere
from palpate.domain.material import IsotropicMaterial
from palpate.errors import PalpateError
from palpate.mesh.specimens import half_space
from palpate.plugins.interfaces import Solver
from palpate.testing.components import (
    HALF_SPACE_FRICTION,
    HALF_SPACE_PATH,
    RADIUS_MM,
    SMALL_STRAIN,
    ComponentContract,
    half_space_peaks,
    moved_values,
    neighbours,
    overridden,
    small_strain_modulus,
)

DEPTH, ROTATION = 0, 1
"""Columns of an indentation's path."""


class SolverContract(ComponentContract):
    """Laws of a solver; override ``solver``, ``job`` and, where it needs one, ``limb``.

    Override ``hopeless`` and ``finer`` too: a solver that reports `ok` without having converged
    shows itself there alone.
    """

    scaling_tolerance = 1e-6
    """Largest relative deviation from: all moduli times s, then all ordinates times s."""

    convergence_tolerance = 0.02
    """Largest relative difference between an answer and that of ``finer``."""

    degrees: Mapping[str, int] = MappingProxyType({})
    """Degree in the moduli of channels where it is not 1: 0 for a displacement."""

    slope_tolerance = 0.02
    """Largest deviation of a slope from a central difference, relative to the largest along the curve."""

    half_space_tolerance = 0.2
    """Largest relative deviation from the force and the torque of a half-space."""

    blind_to: frozenset[str] = frozenset()
    """Inputs that cannot change the answer to `job`: ``radius``, ``friction``, ``limb``, ``parameters``.

    Name one only with the reason: a solver that ignores an input of the study answers another one.
    """

    solver = overridden("the solver under test")

    job = overridden("a job that the solver can do, with materials whose moduli may be scaled")

    @pytest.fixture
    def limb(self) -> Limb | None:
        """Provide the limb of the job."""
        return None

    @pytest.fixture
    def hopeless(self) -> Job | None:
        """Provide a job of the same limb that has no answer, or that this solver cannot find."""
        return None

    @pytest.fixture
    def finer(self) -> Solver | None:
        """Provide the solver with smaller steps or tighter tolerances, where it has such settings."""
        return None

    @pytest.fixture
    def half_space_solver(self, solver: Solver) -> Solver | None:
        """Provide the solver for a half-space, or None where it cannot make one.

        Override it where a setting decides the shape: a layer as thick as a hundred radii.
        """
        return solver

    @pytest.fixture
    def half_space(self, limb: Limb | None) -> Limb | None:
        """Provide a mesh of a half-space for a solver that needs one."""
        if limb is None:
            return None
        # So few cells answer some 14 % too stiffly: what is looked for here is a factor or a sign.
        return half_space("hex8", 0.05 * RADIUS_MM, n_radius=3, n_core=2, extent=40.0)

    @pytest.fixture
    def answer(
        self, request: pytest.FixtureRequest, solver: Solver, job: Job, limb: Limb | None
    ) -> Simulation:
        """Provide the answer to the job, simulated once for all laws."""
        answers = request.cls.__dict__.get("_answers")
        if answers is None:
            answers = request.cls._answers = {}
        case = getattr(getattr(request.node, "callspec", None), "id", "")
        if case not in answers:
            answers[case] = solver.simulate(job, limb)
        return answers[case]

    component = pytest.fixture(lambda self, solver: solver)

    def test_version_is_constant(self, solver: Solver) -> None:
        assert solver.version().strip(), "a version is part of each simulation's key: it cannot be empty"
        assert solver.version() == solver.version(), "the version changes from call to call"

    def test_simulates_the_whole_protocol(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        solver.check(job, limb)
        simulation = solver.simulate(job, limb)
        assert simulation.job is job, "the simulation is of another job"
        assert simulation.status is Status.OK, simulation.message
        assert simulation.response is not None, "status ok without a response"
        assert list(simulation.response), "status ok without a curve"
        assert simulation.seconds >= 0.0, f"{simulation.seconds} seconds"
        for channel in simulation.response:
            self.assert_follows(simulation.response[channel], job)

    def test_travels_to_another_process_once_it_has_simulated(
        self, solver: Solver, job: Job, limb: Limb | None
    ) -> None:
        solver.simulate(job, limb)  # whatever it keeps of that may be of no use to a worker
        self.test_travels_to_another_process(solver)

    def test_it_provides_what_it_declares(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        provides = solver.provides
        assert (limb is not None) == provides.mesh, (
            f"`provides` declares the body '{provides.body}', and the contract has "
            f"{'a' if limb else 'no'} limb: a mesh needs one, and nothing else takes one"
        )
        lacks = ", ".join(provides.lacks(job))
        assert not lacks, f"`provides` lacks what the job asks for: {lacks}"
        observed = {channel.name for channel in job.channels if provides.computes(channel)}
        undeclared = ", ".join(sorted(set(curves(answer)) - observed - set(provides.channels)))
        assert not undeclared, f"the answer has {undeclared}, which is not among the channels of `provides`"
        declared = self._moved_channels(job) & set(provides.channels)
        missed = ", ".join(sorted(declared - set(curves(answer))))
        assert not missed, f"no curve of {missed}, which `provides` declares among its channels"

    def test_it_observes_every_channel_of_its_columns(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        columns = set(solver.provides.columns) - (set(STATE_COLUMNS) - set(WRENCH))
        bare = Channel(name="", abscissa=POSE[0], ordinate="", abscissa_label="", ordinate_label="")
        asked = tuple(replace(bare, name=f"{each} over depth", ordinate=each) for each in sorted(columns))
        if not asked or not isinstance(job.protocol, Indentation):
            return
        response = curves(solver.simulate(replace(job, channels=(*job.channels, *asked)), limb))
        missed = [channel.ordinate for channel in asked if channel.name not in response]
        assert not missed, (
            f"no curve over depth of {', '.join(missed)}, which `provides` has as columns; return "
            "`states.observed(job.channels)`"
        )
        for name, curve in curves(answer).curves.items():
            message = f"channel '{name}' changes where the job asks for more channels"
            np.testing.assert_array_equal(response[name].ordinate, curve.ordinate, message)

    def test_the_same_job_gives_the_same_bits(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        once, again = curves(answer), curves(solver.simulate(job, limb))
        for channel in once:
            message = f"channel '{channel}': the same job has two answers, and only one of them is kept"
            first, second = once[channel], again[channel]
            np.testing.assert_array_equal(second.abscissa, first.abscissa, message)
            np.testing.assert_array_equal(second.ordinate, first.ordinate, message)

    def test_radius_friction_and_limb_matter(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        for what, other, body in self.other_inputs(job, limb):
            if solver.provides.lacks(other):
                continue
            try:
                solver.check(other, body)
            except PalpateError:
                continue  # a refusal is an honest answer
            assert self.differs(answer, solver.simulate(other, body)), (
                f"another {what} changes nothing: use it, refuse it in `check`, or name it in `blind_to`"
            )

    def test_a_parameter_matters_unless_it_is_ignored(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        for region, material in job.materials.items():
            ignored = solver.ignored(material)
            unknown = set(ignored) - {p.name for p in material.parameters}
            assert not unknown, f"`ignored` names {', '.join(unknown)}, which '{material.name}' does not have"
            for name, theta in moved_values(material, job.thetas[region]):
                other = replace(job, thetas={**job.thetas, region: theta})
                matters = self.differs(answer, solver.simulate(other, limb))
                assert not (matters and name in ignored), (
                    f"`ignored` names '{region}.{name}', but the answer changes with it"
                )
                assert matters or name in ignored or "parameters" in self.blind_to, (
                    f"'{region}.{name}' changes nothing: use every region, or name it in `ignored`"
                )

    def test_slopes_are_those_of_central_differences(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        if not solver.provides.slopes:
            pytest.skip("the solver declares no slopes")
        simulation = solver.simulate(replace(job, slopes=True), limb)
        self.assert_scaled(simulation, answer, 1.0)
        names = {
            str(ParameterName(region, p.name)) for region, m in job.materials.items() for p in m.parameters
        }
        if isinstance(job.protocol, Indentation):
            names |= {FRICTION, COMPLIANCE} if solver.provides.contact_penalty else {FRICTION}
            names |= {DEEPER} if solver.provides.depth_slope and job.protocol.only_depth_mm else set()
        for channel, curve in curves(simulation).curves.items():
            assert set(curve.slopes) == names, (
                f"channel '{channel}': slopes in {', '.join(sorted(curve.slopes)) or 'nothing'} instead of "
                f"{', '.join(sorted(names))}"
            )
        for name, step, ahead, behind in neighbours(job, solver.provides):
            after, before = (curves(solver.simulate(other, limb)) for other in (ahead, behind))
            for channel, curve in curves(simulation).curves.items():
                change = 0.5 * (after[channel].ordinate - before[channel].ordinate)
                off = np.abs(step * curve.slopes[name] - change).max()
                rounding = self.scaling_tolerance * np.abs(curve.ordinate).max()
                assert off <= self.slope_tolerance * np.abs(change).max() + rounding, (
                    f"channel '{channel}': the slope in '{name}' is off the central difference by "
                    f"{off / step:.3g}, where the difference reaches {np.abs(change).max() / step:.3g}"
                )

    def test_a_surface_carries_the_force_of_the_curves(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        if not solver.provides.surface or limb is None or FORCE.name not in (answer.response or {}):
            pytest.skip("the solver declares no surface, or has no force")
        simulation = solver.simulate(replace(job, surface=True), limb)
        self.assert_scaled(simulation, answer, 1.0)
        states = simulation.surface
        assert states is not None, "no surface, although the job asks for it"
        force, _ = states.resultants(limb.spot.position_mm)
        wanted = float(np.abs(curves(simulation)[FORCE.name].ordinate).max())
        carried = float(-(force @ limb.spot.normal).min())
        assert abs(carried / wanted - 1.0) <= 0.01, (
            f"the tractions press with {carried:g} N where the curve has {wanted:g} N: they are those of the "
            "indenter on the skin, per deformed area, in the frame of the mesh"
        )
        below = (limb.spot.position_mm - states.positions_mm) @ limb.spot.normal
        assert np.allclose(below, states.depth_mm, atol=1e-3), "the indenter is not at its depth"

    def test_a_half_space_has_the_force_of_hertz_and_the_torque_of_reissner_and_sagoci(
        self, half_space_solver: Solver | None, half_space: Limb | None, job: Job
    ) -> None:
        if half_space_solver is None or isinstance(job.protocol, HomogeneousTests):
            return
        if not half_space_solver.provides.simulates("sphere"):
            pytest.skip("the solver simulates no sphere: no closed form gives the answer")
        material, theta = _first_isotropic(job)
        regions = job.materials if half_space is None else half_space.mesh.regions
        pressed = replace(
            job,
            materials=dict.fromkeys(regions, material),
            thetas=dict.fromkeys(regions, theta),
            protocol=Indentation(
                indenter=Sphere(radius_mm=RADIUS_MM), path=HALF_SPACE_PATH, friction=HALF_SPACE_FRICTION
            ),
        )
        response = curves(half_space_solver.simulate(pressed, half_space))
        for channel, expected in half_space_peaks(material, theta).items():
            if channel not in response:
                continue
            found = float(response[channel].ordinate[-1])
            assert abs(found / expected - 1.0) <= self.half_space_tolerance, (
                f"channel '{channel}': {found:g} for a half-space whose answer is {expected:g}: force is in "
                "N and positive on the way in, torque in N·mm and of the rotation's sign"
            )

    def test_small_strains_have_the_stress_of_the_initial_moduli(self, solver: Solver, job: Job) -> None:
        if not isinstance(job.protocol, HomogeneousTests):
            return
        material, theta = _first_isotropic(job)
        moduli = {c: small_strain_modulus(c, material, theta) for c in job.protocol.paths}
        # Paths as long as the job's, so that a solver that compiles for a length does so once.
        paths = {
            c: path
            if moduli[c] is None
            else (c != "simple_shear") + np.linspace(0.0, SMALL_STRAIN, max(2, len(path)))
            for c, path in job.protocol.paths.items()
        }
        response = curves(solver.simulate(replace(job, protocol=HomogeneousTests(paths=paths)), None))
        for channel, modulus in moduli.items():
            if modulus is None:
                continue
            found = float(response[channel].ordinate[-1]) / SMALL_STRAIN
            assert abs(found / modulus - 1.0) <= 0.05, (
                f"channel '{channel}': a slope of {found:g} MPa at rest, where the initial moduli give "
                f"{modulus:g} MPa: stress is nominal, in MPa, and positive in tension"
            )

    def test_a_hopeless_job_is_no_success(
        self, solver: Solver, hopeless: Job | None, limb: Limb | None
    ) -> None:
        if hopeless is None:
            pytest.skip("no `hopeless` job is given: nothing shows that a failure is reported")
        simulation = solver.simulate(hopeless, limb)
        assert simulation.status is not Status.OK, "status ok for a job that has no answer"
        assert simulation.message.strip(), f"status {simulation.status.value} without a message"

    def test_finer_settings_change_little(
        self, solver: Solver, finer: Solver | None, job: Job, limb: Limb | None
    ) -> None:
        if finer is None:
            pytest.skip("no `finer` solver is given: nothing shows that answers have converged")
        found, reference = (curves(each.simulate(job, limb)) for each in (solver, finer))
        for channel in reference:
            largest = float(np.abs(reference[channel].ordinate).max())
            off = np.abs(_at(found[channel], reference[channel]) - reference[channel].ordinate).max()
            assert off <= self.convergence_tolerance * largest, (
                f"channel '{channel}': finer settings change the answer by {off / largest:.2g} of its "
                f"largest value, more than {self.convergence_tolerance:g}: `ok` is reported too early"
            )

    def test_many_jobs_come_back_in_order(self, solver: Solver, job: Job, limb: Limb | None) -> None:
        jobs = [self.scaled(job, factor, set_id) for set_id, factor in enumerate((1.0, 1.5))]
        many = list(solver.simulate_many(iter(jobs), limb))
        assert [s.job.set_id for s in many] == [0, 1], "simulate_many answers in another order"
        for simulation, alone in zip(many, (solver.simulate(j, limb) for j in jobs), strict=True):
            self.assert_scaled(simulation, alone, 1.0)

    def test_moduli_scale_the_response(
        self, solver: Solver, job: Job, limb: Limb | None, answer: Simulation
    ) -> None:
        self.assert_scaled(solver.simulate(self.scaled(job, 2.0, job.set_id), limb), answer, 2.0)

    def other_inputs(self, job: Job, limb: Limb | None) -> Iterator[tuple[str, Job, Limb | None]]:
        """Yield what is changed, the job and the limb, for each input that must matter."""
        press = job.protocol
        if isinstance(press, Indentation):
            wider = replace(press, indenter=Sphere(radius_mm=1.25 * press.indenter.radius_mm))
            if "radius" not in self.blind_to:
                yield "radius", replace(job, protocol=wider), limb
            if np.ptp(press.path[:, ROTATION]) > 0.0 and "friction" not in self.blind_to:
                other = replace(press, friction=0.0 if press.friction > 0.0 else 1.0)
                yield "friction", replace(job, protocol=other), limb
        if limb is not None and "limb" not in self.blind_to:
            centre, points = limb.spot.position_mm, limb.mesh.points_mm
            mesh = replace(limb.mesh, points_mm=centre + 1.25 * (points - centre))
            yield "limb", job, replace(limb, mesh=mesh)

    def differs(self, one: Simulation, other: Simulation) -> bool:
        """Whether two answers differ by more than rounding, in any curve."""
        if one.response is None or other.response is None or set(one.response) != set(other.response):
            return True
        pairs = [(one.response[name].ordinate, other.response[name].ordinate) for name in one.response]
        # Least change of a curve, relative to its largest ordinate, that is more than rounding.
        return any(a.shape != b.shape or np.abs(a - b).max() > 1e-9 * np.abs(a).max() for a, b in pairs)

    def scaled(self, job: Job, factor: float, set_id: int) -> Job:
        """Build the job with every modulus times ``factor``."""
        thetas = {
            region: theta
            * np.array([factor if p.kind == "modulus" else 1.0 for p in job.materials[region].parameters])
            for region, theta in job.thetas.items()
        }
        return replace(job, thetas=thetas, set_id=set_id)

    def assert_scaled(self, simulation: Simulation, reference: Simulation, factor: float) -> None:
        """Assert that every ordinate is ``factor``, to the channel's degree, times the reference's."""
        found, known = curves(simulation), curves(reference)
        assert set(found) == set(known), "channels come and go with the moduli"
        for channel in known:
            times = factor ** self.degrees.get(channel, 1)
            expected = times * known[channel].ordinate
            tolerance = self.scaling_tolerance * float(np.abs(expected).max())
            np.testing.assert_allclose(
                found[channel].ordinate,
                expected,
                atol=tolerance,
                err_msg=f"channel '{channel}': moduli times {factor:g} is not the curve times {times:g}; "
                "`degrees` names channels that do not scale with the moduli",
            )

    def assert_follows(self, curve: Curve, job: Job) -> None:
        """Assert that a curve goes where the protocol goes, to its end, and turns where it turns."""
        asked = self._asked(curve.channel, job)
        if asked is None:
            return
        reach = 0.02 * float(np.ptp(asked))
        expected, found = turning_points(asked), turning_points(curve.abscissa)
        alike = len(found) == len(expected) and np.abs(found - expected).max() <= reach
        assert alike, (
            f"channel '{curve.channel}': status ok, but the abscissa runs {_route(found)} where the protocol "
            f"runs {_route(expected)}; give every point in the order travelled, or another status"
        )

    def _moved_channels(self, job: Job) -> set[str]:
        """Channels whose abscissa the protocol moves, as far as that is known."""
        if isinstance(job.protocol, HomogeneousTests):
            return set(job.protocol.paths)
        columns = job.protocol.columns
        return {c.name for c in job.channels if c.abscissa in columns and np.ptp(columns[c.abscissa]) > 0.0}

    def _asked(self, channel: str, job: Job) -> FloatArray | None:
        if isinstance(job.protocol, HomogeneousTests):
            return job.protocol.paths.get(channel)
        abscissae = {each.name: each.abscissa for each in job.channels}
        return job.protocol.columns.get(abscissae.get(channel, ""))


def curves(simulation: Simulation) -> Response:
    """Curves of a simulation that must have some."""
    assert simulation.response is not None, simulation.message
    return simulation.response


def _first_isotropic(job: Job) -> tuple[IsotropicMaterial, FloatArray]:
    for region, material in job.materials.items():
        if isinstance(material, IsotropicMaterial):
            return material, job.thetas[region]
    pytest.skip("no region has an isotropic material: no closed form gives the answer")


def turning_points(abscissa: FloatArray) -> FloatArray:
    """Points where a path begins, turns and ends: one more than it has branches."""
    curve = Curve(channel="", abscissa=abscissa, ordinate=np.zeros(len(abscissa)))
    moving = curve.cut(moving_span(curve.abscissa))
    starts = [start for start, _ in moving.branches]
    return moving.abscissa[[*starts, -1]]


def _route(points: FloatArray) -> str:
    return " → ".join(f"{x:g}" for x in points)


def _at(curve: Curve, reference: Curve) -> FloatArray:
    """Ordinates along the reference, by the share of the way that both have travelled."""
    way, asked = (np.concatenate([[0.0], np.abs(np.diff(c.abscissa)).cumsum()]) for c in (curve, reference))
    return np.interp(asked, way, curve.ordinate)
