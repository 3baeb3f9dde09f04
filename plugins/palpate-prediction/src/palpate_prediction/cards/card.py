"""Content of a fitted material's card, whatever the program."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from palpate.api import FloatArray, Material, MaterialError, Parameter, RelaxingMaterial
from palpate.api.fit import explained, mark_of
from palpate.api.mechanics import EnergyForm, StandardMaterial
from palpate.api.report import rounded
from palpate_report.api import ModelVerdict, with_unit

DENSITY_T_PER_MM3 = 1e-9
"""Density of water, for programs that ask for one; nothing of it is fitted."""

VOLUMES = (0.95, 1.05)
"""Relative volumes at which pressures are compared where those of the experiment are unknown."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CardData:
    """A fitted material of one region.

    Parameters
    ----------
    title : str
        Study, region, and where the values come from.
    theta : (n_parameters,) array
        Textbook values.
    intervals : mapping of parameter to (lower, upper)
        95 % intervals of the parameters that have one, in their units.
    strain : mapping
        Ends of what the experiment reached: ``stretch_min``, ``stretch_max``, ``i1_max``, ``J_min`` and
        ``J_max``; empty where that is not known.
    origins : mapping of parameter to str
        Where its value is from: ``fitted``, ``selected`` from a sweep, ``fixed`` or ``tied``.
    verdicts : mapping of parameter to str
        What may be read of its value, where that was searched.
    model : ModelVerdict
        On the fit of the run.
    reached : mapping of channel to (abscissa, lower, upper)
        Ends of the measured curves, where the experiment is on a homogeneous specimen.
    number : int
        By which the parts of a model name the material: from 1, in the order of the study's regions.
    record_s : float
        Time of the longest motion, which tells no slower relaxation; 0 where it is not known.
    """

    title: str
    region: str
    material: Material
    theta: FloatArray
    intervals: Mapping[str, tuple[float, float]]
    strain: Mapping[str, float]
    origins: Mapping[str, str]
    verdicts: Mapping[str, str]
    model: ModelVerdict = field(default_factory=ModelVerdict)
    reached: Mapping[str, tuple[str, float, float]] = field(default_factory=dict)
    number: int = 1
    record_s: float = 0.0

    @property
    def verdict(self) -> str:
        """Verdict on each parameter in one sentence, or why none can be read; in ASCII."""
        if self.model.failure:
            text = f"WARNING: {self.model.failure}"
        else:
            known = (f"{name} {verdict}" for name, verdict in self.verdicts.items())
            marks = explained(map(mark_of, self.verdicts.values()))
            text = ", ".join(known) or "nothing was searched"
            text += " (WARNING: not all are results)" if marks else ""
            text = " ".join(filter(None, (self.model.approximation, text)))
        return text.replace("R²", "R2").encode("ascii", "replace").decode()

    @property
    def relaxation(self) -> dict[float, float]:
        """Share of the stress that relaxes with each time constant [s], of those above 0."""
        if not isinstance(self.material, RelaxingMaterial):
            return {}
        return {time: share for time, share in self.material.relaxation(self.theta).items() if share > 0.0}


def check_form(data: CardData, program: str) -> EnergyForm:
    """Return the standard form of the energy at once.

    Raises
    ------
    MaterialError
        The material declares none.
    """
    material, theta = data.material, data.theta
    if isinstance(material, RelaxingMaterial):
        material, theta = material.at_once(theta)
    if not isinstance(material, StandardMaterial):
        raise MaterialError(
            f"material '{data.material.name}' cannot be written for {program}: its class declares no "
            "standard energy (method energy_form), such as powers of I1 - 3 or of the stretches; use "
            "--for json, or fit ogden, yeoh or neo_hookean"
        )
    return material.energy_form(theta)


def ranges_of(strains: Sequence[Mapping[str, Any]]) -> dict[str, float]:
    """Ends over the states and spots of the strains of one region; empty where there are none."""
    found = {}
    for name in strains[0] if strains else ():
        values = [value for strain in strains for value in strain[name]]
        if name.endswith(("_min", "_max")) and values:
            found[name] = float(min(values) if name.endswith("_min") else max(values))
    return found


def head(data: CardData, form: EnergyForm | None = None) -> Iterator[str]:
    """Lines on a material: verdict, units, values with intervals, range; of a ``form`` moduli and density."""
    yield f"palpate: {data.title}"
    yield data.verdict if data.model.failure else f"verdict: {data.verdict}"
    yield "units: mm, N, MPa" + (", tonne, s" if form else "")
    for parameter, value in zip(data.material.parameters, data.theta.tolist(), strict=True):
        ends = data.intervals.get(parameter.name)
        shown = with_unit(rounded(value, *ends) if ends else f"{value:.6g}", parameter.unit)
        about = [_interval(data, parameter), data.verdicts.get(parameter.name, "")]
        known = f" ({'; '.join(each for each in about if each)})" if any(about) else ""
        yield f"{data.origins[parameter.name]}: {parameter.name} = {shown}{known}"
    if form is not None:
        yield f"not fitted: density {DENSITY_T_PER_MM3:g} t/mm3, as of water"
        yield (
            f"initial moduli: shear {form.shear_MPa:.6g} MPa, bulk {form.bulk_MPa:.6g} MPa, "
            f"Poisson's ratio {form.poisson:.6g}"
        )
    yield from _relaxation(data, form)
    yield _range(data.strain, data.reached)


def _relaxation(data: CardData, form: EnergyForm | None) -> Iterator[str]:
    """Lines on what relaxes, if anything does."""
    if not (shares := data.relaxation):
        return
    left, of_shape = 1.0 - sum(shares.values()), data.material.relaxes_isochoric
    terms = "".join(f" - {g:.6g} (1 - exp(-t/{tau:.6g}))" for tau, g in shares.items())
    yield f"relaxation: the moduli above are those at once; G(t)/G(0) = 1{terms}"
    if form is not None:
        bulk = form.bulk_MPa * (1.0 if of_shape else left)
        yield f"long-term moduli: shear {form.shear_MPa * left:.6g} MPa, bulk {bulk:.6g} MPa"
    if untold := [f"{tau:g} s" for tau in shares if 0.0 < data.record_s < tau]:
        yield f"not determined by a record of {data.record_s:.3g} s: relaxation with {', '.join(untold)}"
    which = "stress of the shape at constant volume" if of_shape else "stress"
    yield (
        f"in palpate the second Piola-Kirchhoff {which} relaxes; a program where another stress does differs "
        "where the tissue is turned or deformed much after it has relaxed"
    )


def _interval(data: CardData, parameter: Parameter) -> str:
    if parameter.name not in data.intervals:
        return ""
    lower, upper = data.intervals[parameter.name]
    return f"95 % interval {rounded(lower, lower, upper)} to {rounded(upper, lower, upper)}"


def _range(strain: Mapping[str, float], reached: Mapping[str, tuple[str, float, float]]) -> str:
    if reached:
        ends = (f"{of} {low:.3f} to {high:.3f} ({name})" for name, (of, low, high) in reached.items())
        return f"valid: the experiment reached {', '.join(ends)}"
    if not strain:
        return "valid: the strains of the experiment are not known; `palpate surface` computes them"
    return (
        f"valid: the experiment reached principal stretches from {strain['stretch_min']:.3f} to "
        f"{strain['stretch_max']:.3f}, I1 up to {strain['i1_max']:.3f}, J from {strain['J_min']:.4f} to "
        f"{strain['J_max']:.4f}"
    )


def differences(data: CardData, form: EnergyForm) -> Iterator[str]:
    """Lines on how stresses with the program's volumetric energy differ from palpate's.

    The energy is K/2 (J − 1)², and K/2 ((J² − 1)/2 − ln J) of Gent's.
    """
    J = np.array([data.strain.get("J_min", VOLUMES[0]), data.strain.get("J_max", VOLUMES[1])])
    mine, other = np.log(J) / J, 0.5 * (J - 1.0 / J) if form.gent else J - 1.0
    if form.volume == "coupled":
        share = form.shear_MPa / form.bulk_MPa
        mine = (share * (J ** (2.0 / 3.0) - 1.0) + (1.0 - 2.0 / 3.0 * share) * np.log(J)) / J
    shown = ", ".join(
        f"{100.0 * (ratio - 1.0):+.2f} % at J = {at:.4g}"
        for ratio, at in zip(other / np.where(mine == 0.0, 1.0, mine), J.tolist(), strict=True)
        if at != 1.0
    )
    yield f"mean stress of a pure dilation: differs from palpate's by {shown or 'nothing'}"
    if form.volume == "coupled":
        shown = ", ".join(f"{100.0 * (at ** (-2.0 / 3.0) - 1.0):+.2f} % at J = {at:.4g}" for at in J.tolist())
        yield (
            "deviatoric stress: of an energy that couples shape and volume in palpate; equal at J = 1, "
            f"here it differs by {shown}, and palpate's mean stress depends on the shape too"
        )
