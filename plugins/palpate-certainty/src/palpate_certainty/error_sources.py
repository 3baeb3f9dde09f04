"""Errors of the curves, cause by cause: a derivative of the curves, times a standard deviation.

Each cause is a further value of the fit's problem, so its derivative has the same origin as the derivatives
of parameters: exact slopes, or differences of simulations that the run keeps.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from palpate.api import (
    FRICTION,
    BoolArray,
    FloatArray,
    Indentation,
    Limb,
    PalpateError,
    Parameter,
    ParameterError,
    ParameterName,
    ParameterSpace,
    Protocol,
    Response,
)
from palpate.api.fit import (
    GAIN,
    MOVED_ERROR,
    OFFSET,
    Correction,
    Fit,
    Parametrisation,
    SpotInputs,
    SpotTerm,
    channel_of,
    path_of,
    pieces,
)
from palpate.api.runs import Study, check_limb
from palpate_certainty.anatomy import OF_LIMB, change_of, changed_limb, noted_position_mm
from palpate_certainty.assumptions import ASSUMED
from palpate_certainty.mesh_error import SpotMesh, independent_parts, is_stated, scattered_parts

CONTACT = "contact"
"""Penetration of the tissue by the indenter, as a cause that all curves share.

Curves are nearly linear in 1/penalty: one standard deviation, a factor of two of the penalty, is 0.7 of the
change by a rigid contact by slopes, and 3/4 by differences. Corrected curves have a rigid contact; a share of
that correction is uncertain.
"""

STEPS = 10.0
"""Range of a cause, in standard deviations to either side: differences step a twentieth of it."""

Columns = Mapping[tuple[str, str], Mapping[str, FloatArray]]
"""What one standard deviation of each cause adds to the ordinates (n,), by spot and channel."""


@dataclass(frozen=True, slots=True, kw_only=True)
class ErrorSource:
    """One thing that may be wrong.

    Parameters
    ----------
    kind : str
        ``onset``, ``tilt``, ``gain``, ``friction``, ``indenter``, ``contact``, ``fixed``, ``position``,
        ``bone`` or ``layers``.
    of : str
        Spot, spot and axis of a tilt or position, spot and region of a layer measured there, channel,
        region, or full name of the parameter; empty for one that all curves share.
    sd : float
        Its standard deviation: in mm, degrees, factors of two of the contact penalty, as a friction
        coefficient, or a share of a gain, parameter or thickness.
    spots : tuple of str
        Spots whose curves it changes; empty for all.
    """

    kind: str
    of: str
    sd: float
    spots: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name among the values of the problem."""
        return f"{self.kind} {self.of}" if self.of else self.kind

    def is_at(self, spot: str) -> bool:
        """Whether it changes the curves of a spot."""
        return not self.spots or spot in self.spots

    @property
    def label(self) -> str:
        """Name in the budget: spots and channels of one kind are one cause."""
        return self.of if self.kind == "fixed" else self.kind


def error_sources_of(
    study: Study, measured: Mapping[str, Response], searched: Sequence[str]
) -> list[ErrorSource]:
    """Causes of a study's budget whose derivatives come from simulated curves.

    The names ``searched`` are fitted, and no cause. A loader's ``record["uncertainty"]`` has the standard
    deviation of ``depth_mm``.
    """
    heads = {ParameterName.parse(name).shared for name in searched}
    return [each for each in _causes(study, measured) if each.sd > 0.0 and _value(each) not in heads]


def _value(cause: ErrorSource) -> str:
    """Name under which a fit would search what a cause varies."""
    names = {"onset": OFFSET, "gain": f"{GAIN}.{cause.of}", "friction": FRICTION, "fixed": cause.of}
    return names.get(cause.kind, cause.kind)


def _causes(study: Study, measured: Mapping[str, Response]) -> Iterator[ErrorSource]:
    budget, protocol, is_known = study.budget, study.protocol, study.data == "simulated"
    for channel in dict.fromkeys(name for response in measured.values() for name in response):
        yield ErrorSource(kind="gain", of=channel, sd=budget.gain)
    if isinstance(protocol, Indentation):
        for spot, response in measured.items():
            usual = _found(response, lambda uncertainty: uncertainty["depth_mm"], ASSUMED.onset_mm)
            onset = usual if budget.onset is None else budget.onset
            yield ErrorSource(kind="onset", of=spot, sd=onset, spots=(spot,))
            for axis in "xy":
                yield ErrorSource(kind="tilt", of=f"{spot} {axis}", sd=budget.tilt, spots=(spot,))
        usual = (ASSUMED.relative if is_known else ASSUMED.skin_friction) * protocol.friction
        sd = usual if budget.friction is None else budget.friction
        yield ErrorSource(kind="friction", of="", sd=sd)
        yield ErrorSource(kind="indenter", of="", sd=budget.radius)
        if study.solver.provides.contact_penalty:
            yield ErrorSource(kind=CONTACT, of="", sd=1.0)
        yield from _of_anatomy(study, measured)
    searched, usual = set(study.space.names), ASSUMED.relative if is_known else ASSUMED.borrowed
    for region in study.space.regions:
        for parameter in region.material.parameters:
            if (name := region.name_of(parameter.name)) not in searched:
                possible = min(usual, region.room.get(parameter.name, np.inf))
                yield ErrorSource(kind="fixed", of=name, sd=budget.parameters.get(name, possible))


def _of_anatomy(study: Study, spots: Iterable[str]) -> Iterator[ErrorSource]:
    """Position of each site, layers measured there; bone and other layers, which spots share."""
    budget, is_known = study.budget, study.data == "simulated"
    if not study.solver.provides.mesh:
        return
    sites: dict[str, tuple[str, ...]] = {}
    for spot in spots:
        # A planned press may be where the study has no spot.
        site = study.site_of(spot) if spot in study.spot_names else spot
        sites[site] = (*sites.get(site, ()), spot)
    for site, there in sites.items():
        usual = 0.0 if is_known else noted_position_mm(study, site)
        sd = usual if budget.position is None else budget.position
        for axis in "xy":
            yield ErrorSource(kind="position", of=f"{site} {axis}", sd=sd, spots=there)
    usual = 0.0 if is_known else ASSUMED.bone_mm
    yield ErrorSource(kind="bone", of="", sd=usual if budget.bone is None else budget.bone)
    for region in study.space.regions if len(study.space.regions) > 1 else ():
        name, others = region.region, dict(sites)
        for site in (site for site in sites if site in study.spot_names):
            if found := study.measured_layers_mm(site).get(name):
                sd, there = found[1] / found[0], others.pop(site)
                yield ErrorSource(kind="layers", of=f"{site} {name}", sd=sd, spots=there)
        sd = budget.layers.get(name, budget.layers.get("", 0.0 if is_known else ASSUMED.relative))
        there = tuple(spot for each in others.values() for spot in each)
        if there:
            yield ErrorSource(kind="layers", of=name, sd=sd, spots=there if others != sites else ())


def drift_of(study: Study, response: Response, channel: str) -> float:
    """Standard deviation of what a channel drifts by along its curve, in its unit."""
    if study.budget.zero is not None:
        return study.budget.zero * float(np.abs(response[channel].ordinate).max())
    return _found(response, lambda uncertainty: uncertainty.get("drift", {}).get(channel, 0.0), 0.0)


def _found(response: Response, size: Callable[[Mapping[str, Any]], float], usual: float) -> float:
    """Root of the mean square of what the loader found in the files of a spot; else the usual size."""
    files = response.record.get("files", {}).values()
    found = [size(each["uncertainty"]) for each in files if "uncertainty" in each]
    return float(np.sqrt(np.mean(np.square(found)))) if found else usual


class WithErrorSources(Parametrisation):
    """Values that a study searches, and each cause as one more value around zero.

    Parameters
    ----------
    base : Parametrisation
    causes : sequence of ErrorSource
    limbs : dict of limb name to Limb
        Of the spots; those that a cause changes are added.
    """

    name, summary = "with_causes", "a study's parametrisation with the causes of its budget"

    def __init__(
        self, base: Parametrisation, causes: Sequence[ErrorSource], limbs: dict[str, Limb] | None = None
    ) -> None:
        super().__init__()
        self.base, self.causes = base, tuple(causes)
        self.limbs = {} if limbs is None else limbs

    def parameters(self, space: ParameterSpace, spots: Sequence[str]) -> tuple[Parameter, ...]:
        """The study's own, then the causes in standard deviations."""
        own = [
            Parameter(
                name=cause.name, unit="1", lower=-STEPS, upper=STEPS, kind="shape", description=cause.kind
            )
            for cause in self.causes
        ]
        return (*self.base.parameters(space, spots), *own)

    def inputs(
        self, space: ParameterSpace, spot: str, protocol: Protocol, values: Mapping[str, float]
    ) -> SpotInputs:
        """The study's own, changed by each cause."""
        names = {cause.name for cause in self.causes}
        own = {name: value for name, value in values.items() if name not in names}
        inputs = self.base.inputs(space, spot, protocol, own)
        for cause in self.causes:
            by = cause.sd * values[cause.name]
            if by and cause.is_at(spot):
                inputs = (
                    self._on_other_limb(space, spot, inputs, cause, by)
                    if cause.kind in OF_LIMB
                    else _changed(space, inputs, cause, by)
                )
        return inputs

    def _on_other_limb(
        self, space: ParameterSpace, spot: str, inputs: SpotInputs, cause: ErrorSource, by: float
    ) -> SpotInputs:
        """Inputs on a limb that a cause has changed, which is added to the others."""
        if (limb := self.limbs.get(f"{spot}/{inputs.mesh}" if inputs.mesh else spot)) is None:
            raise ParameterError(f"the mesh of spot '{spot}' is not known")
        changed = changed_limb(limb, cause.kind, cause.of.rpartition(" ")[2], by)
        if changed is limb:
            return inputs
        try:
            check_limb(changed, [region.region for region in space.regions])
        except PalpateError as error:
            # The mesh is as the user has it; what to do about one that is wrong does not apply.
            why = str(error).partition("; ")[0]
            raise ParameterError(f"cannot {change_of(cause.kind, cause.of, by)}: {why}") from error
        name = f"{inputs.mesh}, {cause.name} {by:+.17g}".removeprefix(", ")
        self.limbs[f"{spot}/{name}"] = changed
        return replace(inputs, mesh=name)


def _changed(space: ParameterSpace, inputs: SpotInputs, cause: ErrorSource, by: float) -> SpotInputs:
    """Inputs with one cause other than they were by so much."""
    protocol = inputs.protocol
    if cause.kind == "gain":
        return replace(inputs, gains={**inputs.gains, cause.of: inputs.gains.get(cause.of, 1.0) * (1.0 + by)})
    if cause.kind == "fixed":
        (region,) = (r for r in space.regions if ParameterName.parse(cause.of).region == r.region)
        factors = [1.0 + by * (name == cause.of) for name in region.full_names.values()]
        theta = inputs.thetas[region.region] * np.array(factors)
        return replace(inputs, thetas={**inputs.thetas, region.region: theta})
    assert isinstance(protocol, Indentation)
    if cause.kind == "friction":
        return replace(inputs, protocol=replace(protocol, friction=max(protocol.friction + by, 0.0)))
    if cause.kind == CONTACT:
        return replace(inputs, protocol=replace(protocol, contact_penalty=protocol.contact_penalty * 2.0**by))
    if cause.kind == "indenter":
        indenter = protocol.indenter.grown(by)
        return replace(inputs, protocol=replace(protocol, indenter=indenter))
    if cause.kind == "tilt":
        x, y = protocol.tilt_deg
        tilt_deg = (x + by, y) if cause.of.endswith("x") else (x, y + by)
        return replace(inputs, protocol=replace(protocol, tilt_deg=tilt_deg))
    path = protocol.path.copy()
    path[path[:, 0] > 0.0, 0] += by
    offsets = {**inputs.offsets, "depth_mm": inputs.offsets.get("depth_mm", 0.0) + by}
    return replace(inputs, protocol=replace(protocol, path=path), offsets=offsets)


def n_differences(causes: Iterable[ErrorSource], study: Study) -> int:
    """Most simulations of a spot for derivatives of causes: two for each without a slope, one of a limb."""
    by_slope, provides = {"gain"}, study.solver.provides
    by_slope |= {"friction", "fixed", CONTACT} if provides.slopes else set()
    protocol = study.protocol
    if provides.depth_slope and isinstance(protocol, Indentation) and protocol.only_depth_mm:
        by_slope |= {"onset"}
    return sum(1 if cause.kind in OF_LIMB else 2 for cause in causes if cause.kind not in by_slope)


def columns_of(
    fit: Fit, causes: Sequence[ErrorSource], channels: Sequence[str], limbs: dict[str, Limb] | None = None
) -> tuple[Columns, dict[ErrorSource, str]]:
    """Change of the curves by one standard deviation of each cause, where a fit has ended.

    Second is the reason for each source whose derivative could not be simulated. Limbs that a cause changes
    are added to the ``limbs``, on which the problem's jobs are simulated.

    Raises
    ------
    PalpateError
        The point itself cannot be simulated.
    """
    terms = [term.of_channels(channels) for term in fit.problem.terms]
    per_sd, failed = _per_sd(fit, terms, causes, limbs)
    # How often a step that a limb cannot take is halved before its cause is left out.
    for n in range(1, 5):
        again = [k for k, cause in enumerate(causes) if cause.name in failed and cause.kind in OF_LIMB]
        if not again:
            break
        smaller = [replace(causes[k], sd=causes[k].sd / 2**n) for k in again]
        found, left = _per_sd(fit, terms, smaller, limbs)
        per_sd[:, again] = 2**n * found
        failed = {name: why for name, why in failed.items() if name in left} | left
    kept = {k: cause for k, cause in enumerate(causes) if cause.name not in failed}
    columns: dict[tuple[str, str], dict[str, FloatArray]] = {}
    for term, channel, at, scale in pieces(terms):
        part = per_sd[at] / scale[:, None]
        columns[term.spot, channel] = {cause.name: part[:, k] for k, cause in kept.items()}
    return columns, {cause: failed[cause.name] for cause in causes if cause.name in failed}


def _per_sd(
    fit: Fit, terms: Sequence[SpotTerm], causes: Sequence[ErrorSource], limbs: dict[str, Limb] | None
) -> tuple[FloatArray, dict[str, str]]:
    """Change of the residuals (n, n_causes) by one standard deviation of each cause, and failures by name."""
    assert fit.best is not None
    problem = fit.problem
    wider = problem.restated(terms, WithErrorSources(problem.parametrisation, causes, limbs))
    point = np.concatenate([fit.best.point, np.full(len(causes), 0.5)])
    try:
        slopes, failed = wider.columns(point)
    except ParameterError as error:
        raise ParameterError(f"the error budget cannot be simulated: {error}") from error
    return slopes[:, len(problem.parameters) :] / (2.0 * STEPS), failed


MESH, ZERO, CORRECTION = "mesh", "zero", "correction"
"""Causes besides the sources of :mod:`~palpate_certainty.error_sources`."""


def error_budget(
    study: Study,
    measured: Mapping[str, Response],
    terms: Sequence[SpotTerm],
    residuals: FloatArray,
    columns: Columns,
    meshes: Mapping[str, SpotMesh],
    inputs: Mapping[str, SpotInputs] = MappingProxyType({}),
) -> dict[str, dict[str, FloatArray]]:
    """Change of the residuals by one standard deviation of each cause; ``columns`` are of simulated ones.

    Measured curves are as the loader has read them; slopes have moved the corrections by finer meshes to the
    ``inputs``.

    Returns
    -------
    mapping of label to mapping of name to (n,) array
        A label is an entry of the budget; curves that share a name share the error.
    """
    found: dict[str, dict[str, FloatArray]] = {}

    def add(label: str, name: str, at: slice, values: FloatArray) -> None:
        found.setdefault(label, {}).setdefault(name, np.zeros(residuals.size))[at] = values

    for term, name, at, scale in pieces(terms):
        channel = channel_of(name)
        inside, curve = term.counted(name), term.measured[channel]
        for cause, ordinates in columns.get((term.spot, channel), {}).items():
            add(_label(cause), cause, at, (scale * ordinates)[inside])
        drift = drift_of(study, measured[term.spot], channel) * _along(curve.abscissa)
        add(ZERO, f"{term.spot} {channel}", at, (scale * drift)[inside])
        # Of the fitted curve: the noise of the measured one would bias the most likely values.
        fitted = residuals[at] + (scale * curve.ordinate)[inside]
        mesh, moved_to = meshes.get(term.spot, SpotMesh()), inputs.get(term.spot)
        for label, of, values in _by_mesh(study, term, name, mesh, moved_to, scale, fitted):
            add(label, of, at, values)
    return found


def _by_mesh(
    study: Study,
    term: SpotTerm,
    name: str,
    mesh: SpotMesh,
    moved_to: SpotInputs | None,
    scale: FloatArray,
    fitted: FloatArray,
) -> Iterator[tuple[str, str, FloatArray]]:
    """Errors of a fitted curve by its correction, its contact and its mesh: label, name and values."""
    channel = channel_of(name)
    inside, curve, convergence = term.counted(name), term.measured[channel], study.mesh_convergence(channel)
    correction, by_mesh, along = term.corrections.get(channel), None, _along(curve.abscissa)[inside]
    if correction is not None:
        size = _size_of(correction, scale, inside, fitted)
        by_mesh = (size * scale * correction.added)[inside]
        if moved_to is not None:
            change = correction.change_to(moved_to, term.materials)
            moved = (scale * correction.moved(size * correction.coarse, change))[inside]
            yield CORRECTION, channel, MOVED_ERROR * moved
            by_mesh = by_mesh + moved
        if correction.contact is not None:
            by_contact = (size * scale * correction.contact)[inside]
            yield CONTACT, CONTACT, ASSUMED.contact * by_contact
            by_mesh = by_mesh - by_contact
    is_shown = mesh.refinement.ratio > 1.0 and not is_stated(channel, study.budget.mesh)
    if is_shown and by_mesh is not None:
        extrapolated = mesh.of_extrapolation(convergence, by_mesh)
        yield MESH, "extrapolation", extrapolated
        scatter = mesh.refinement.scatter(convergence) * np.abs(curve.ordinate).max()
        # Two meshes that differ by more leave more of other shapes, too.
        size = np.hypot(scatter, np.sqrt(np.mean((extrapolated / scale[inside]) ** 2)))
        parts = scattered_parts(size * scale[inside], along)
    elif study.solver.provides.mesh:
        parts = independent_parts(mesh.error(channel, convergence, study.budget.mesh) * fitted, along)
    else:
        return
    for k, part in enumerate(parts):
        yield MESH, f"{channel} {k}", np.sqrt(ASSUMED.mesh_shared) * part
        yield MESH, f"{term.spot} {channel} {k}", np.sqrt(1.0 - ASSUMED.mesh_shared) * part


def mesh_errors(
    study: Study,
    terms: Sequence[SpotTerm],
    residuals: FloatArray,
    errors: FloatArray,
    meshes: Mapping[str, SpotMesh],
) -> Iterator[dict[str, Any]]:
    """Relative error of each fitted curve by its mesh, one standard deviation, and what shows it.

    One standard deviation of each error of the mesh adds ``errors`` (n, m) to the residuals.
    """
    for term, name, at, scale in pieces(terms):
        channel = channel_of(name)
        inside, ordinate = term.counted(name), term.measured[channel].ordinate
        size = float(np.linalg.norm(residuals[at] + (scale * ordinate)[inside]))
        error = float(np.linalg.norm(errors[at])) / size
        if is_stated(channel, study.budget.mesh):
            shown_by = "the study"
        elif channel not in term.corrections:
            shown_by = "one mesh"
        else:
            largest = float(np.linalg.norm(scale[inside])) * np.abs(ordinate).max()
            between = meshes.get(term.spot, SpotMesh()).refinement
            scatter = between.scatter(study.mesh_convergence(channel)) * largest / size
            is_scatter = error**2 <= 3.0 * scatter**2  # the error that two meshes show counts twice
            shown_by = "the scatter of other meshes" if is_scatter else "two meshes"
        yield {"spot": term.spot, "channel": name, "relative_error": error, "shown_by": shown_by}


def _size_of(correction: Correction, scale: FloatArray, inside: BoolArray, fitted: FloatArray) -> float:
    """Size of a fitted curve over the size of the corrected curve at the set of its correction."""
    fine = (scale * (correction.coarse + correction.added))[inside]
    known = np.isfinite(fine)
    return float(np.linalg.norm(fitted[known])) / max(float(np.linalg.norm(fine[known])), 1e-300)


def _along(abscissa: FloatArray) -> FloatArray:
    path = path_of(abscissa)
    return np.asarray(path / path[-1])


def _label(cause: str) -> str:
    kind, _, of = cause.partition(" ")
    return of if kind == "fixed" else kind
