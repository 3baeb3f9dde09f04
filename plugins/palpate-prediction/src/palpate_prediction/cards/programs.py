"""Energies as each program writes them, and what it means by them.

==========  ======================================================  ================================
program     powers of Ĩ1 − 3 / of the stretches / Gent              volume
==========  ======================================================  ================================
febio       Σ c_k/k (Ĩ1 − 3)^k (the k is missing in its stress);    K/2 (ln J)²; neo-Hookean coupled
            Σ c_j/m_j² (Σ λ̃^m_j − 3); −G Jm/2 ln(1 − (Ĩ1 − 3)/Jm)
abaqus      Σ C_k0 (Ĩ1 − 3)^k; Σ 2 μ_j/α_j² (Σ λ̃^α_j − 3)           (J − 1)²/D1, D1 = 2/K
ansys       Σ C_k0 (Ĩ1 − 3)^k; Σ μ_j/α_j (Σ λ̃^α_j − 3);             (J − 1)²/d1, d1 = 2/K;
            −μ Jm/2 ln(1 − (Ĩ1 − 3)/Jm)                             Gent: ((J² − 1)/2 − ln J)/d1
==========  ======================================================  ================================

A material that relaxes by G(t) = G(0) (1 − Σ γ_i (1 − e^(−t/τ_i))) is in

==========  ========================================================================================
febio       moduli of the long term, G(t) = G∞ (1 + Σ g_i e^(−t/t_i)), so that g_i = γ_i/(1 − Σ γ)
abaqus      moduli at once, G(t) = G0 (1 − Σ g_i (1 − e^(−t/τ_i))); k_i of the bulk modulus
ansys       moduli at once, G(t) = G0 (1 − Σ α_i + Σ α_i e^(−t/τ_i)); SHEAR and BULK by themselves
==========  ========================================================================================
"""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from palpate.api import FloatArray, MaterialError, ParameterName, RegionMaterial, Run
from palpate.api.fit import TIED, inputs_at, relaxing_space, relaxing_thetas
from palpate.api.mechanics import EnergyForm
from palpate.api.runs import Study
from palpate_prediction.cards.card import (
    DENSITY_T_PER_MM3,
    CardData,
    check_form,
    differences,
    head,
    ranges_of,
)
from palpate_report.api import Headline, formula_of, model_verdict, paragraphs_of, report_data

STRESS = (
    "stress: Cauchy, sigma_a = lambda_a/J dW/dlambda_a; J = lambda1 lambda2 lambda3, "
    "l_a = J^(-1/3) lambda_a, I1 = l1^2 + l2^2 + l3^2"
)

MOST_FEBIO = 6
"""Terms g_i, t_i that FEBio's viscoelastic materials take."""


def _stretch_energy(factor: str, power: str, n: int) -> str:
    term = f"{factor} (l1^{power} + l2^{power} + l3^{power} - 3)"
    return " + ".join(term.format(j) for j in range(1, n + 1))


def _power_energy(factor: str, n: int) -> str:
    return " + ".join(f"{factor} (I1 - 3)^{{0}}".format(k) for k in range(1, n + 1))


def _gent_energy(shear: str) -> str:
    return f"-{shear} Jm/2 ln(1 - (I1 - 3)/Jm)"


def _numbers(values: Iterable[float], per_line: int = 8) -> list[str]:
    texts = [f"{value:.12g}" for value in values]
    return [", ".join(texts[i : i + per_line]) for i in range(0, len(texts), per_line)]


# --------------------------------------------------------------------- programs


def febio(data: CardData) -> str:
    """Element ``<material>`` of a FEBio 4 file."""
    form, shares = check_form(data, "febio"), data.relaxation
    left = 1.0 - sum(shares.values())
    lines = [*head(data, form), *_febio_energy(form), STRESS]
    kind, values = _febio_values(_long_term(form, left))
    density = f"    <density>{DENSITY_T_PER_MM3:g}</density>\n"
    body = _tags(values)
    if shares:
        relaxing, about = _febio_relaxation(data, form)
        lines += about
        terms = [
            (f"{name}{i}", value)
            for i, (time_s, share) in enumerate(shares.items(), 1)
            for name, value in (("g", share / left), ("t", time_s))
        ]
        body = f'{_tags(terms)}    <elastic type="{kind}">\n{density}{body}    </elastic>\n'
        kind = relaxing
    comment = "\n".join(f"  {line.replace('--', '- -')}" for line in lines)
    start = f'<material id="{data.number}" name="{data.region}" type="{kind}">'
    return f"<!--\n{comment}\n-->\n{start}\n{density}{body}</material>\n"


def _tags(values: Iterable[tuple[str, float]]) -> str:
    return "".join(f"    <{name}>{value:.12g}</{name}>\n" for name, value in values)


def _long_term(form: EnergyForm, left: float) -> EnergyForm:
    """Energy whose stress is that which is left; the bulk modulus of a separate volume stays."""
    return replace(
        form,
        powers=tuple(left * c for c in form.powers),
        stretches=tuple((left * c, m) for c, m in form.stretches),
        gent=(left * form.gent[0], form.gent[1]) if form.gent else None,
        bulk_MPa=left * form.bulk_MPa if form.volume == "coupled" else form.bulk_MPa,
    )


def _febio_relaxation(data: CardData, form: EnergyForm) -> tuple[str, list[str]]:
    """Type of FEBio's material around the elastic one, and lines on it."""
    name, of_shape = data.material.name, data.material.relaxes_isochoric
    if len(data.relaxation) > MOST_FEBIO:
        raise MaterialError(
            f"material '{name}' cannot be written for febio: its viscoelastic materials take {MOST_FEBIO} "
            f"time constants, and it has {len(data.relaxation)}; fit fewer"
        )
    if form.volume == "coupled" and of_shape:
        raise MaterialError(
            f"material '{name}' cannot be written for febio: FEBio relaxes the whole stress of an energy "
            "that couples shape and volume, and this fit the shape alone; fit it with "
            'relaxing_stress = "all"'
        )
    terms = "G(t) = G (1 + sum g_i exp(-t/t_i)), with the long-term G of the elastic material below"
    if form.volume == "coupled":
        return "viscoelastic", [terms]
    pressure = (
        [] if of_shape else ["the bulk modulus does not relax here; in palpate it does, as the shear one"]
    )
    return "uncoupled viscoelastic", [terms, *pressure]


def _febio_values(form: EnergyForm) -> tuple[str, list[tuple[str, float]]]:
    if form.volume == "coupled":
        mu, nu = form.shear_MPa, form.poisson
        return "neo-Hookean", [("E", 2.0 * mu * (1.0 + nu)), ("v", nu)]
    bulk = [("k", form.bulk_MPa)]
    if form.gent:
        return "Gent", [("G", form.gent[0]), ("Jm", form.gent[1]), *bulk]
    if form.powers:
        return "Yeoh", [(f"c{k}", k * c) for k, c in enumerate(form.powers, start=1)] + bulk
    pairs = [
        (f"{name}{j}", value)
        for j, pair in enumerate(form.stretches, 1)
        for name, value in zip("cm", pair, strict=True)
    ]
    return "Ogden", pairs + bulk


def _febio_energy(form: EnergyForm) -> Iterator[str]:
    if form.volume == "coupled":
        yield "energy: W = mu/2 (lambda1^2 + lambda2^2 + lambda3^2 - 3) - mu ln J + lam/2 (ln J)^2"
        yield "with mu = E / (2 (1 + v)) and lam = E v / ((1 + v) (1 - 2 v))"
    elif form.gent:
        yield f"energy: W = {_gent_energy('G')} + k/2 (ln J)^2"
    elif form.powers:
        yield f"energy: W = {_power_energy('c{0}/{0}', len(form.powers))} + k/2 (ln J)^2"
        yield "FEBio 4.4 to 4.11 was measured to have this stress: its c_k is k times the textbook's"
    else:
        terms = _stretch_energy("c{0}/m{0}^2", "m{0}", len(form.stretches))
        yield f"energy: W = {terms} + k/2 (ln J)^2"


def abaqus(data: CardData) -> str:
    """``*Material`` of an Abaqus input file."""
    form = check_form(data, "abaqus")
    if form.gent:
        raise MaterialError(
            f"material '{data.material.name}' cannot be written for abaqus: it has Gent's energy as a user "
            "subroutine alone; use --for febio, ansys or json, or fit arruda_boyce"
        )
    d1, n = 2.0 / form.bulk_MPa, len(form.powers) or len(form.stretches)
    rest = [d1, *[0.0] * (n - 1)]
    if form.stretches:
        keyword = f"*Hyperelastic, ogden, n={n}"
        values = [value for c, m in form.stretches for value in (0.5 * c, m)]
        terms = _stretch_energy("2 mu{0}/alpha{0}^2", "alpha{0}", n)
    else:
        kind = {1: "neo hooke", 3: "yeoh"}.get(n, f"reduced polynomial, n={n}")
        keyword, values, terms = f"*Hyperelastic, {kind}", list(form.powers), _power_energy("C{0}0", n)
    comments = [
        *head(data, form),
        f"energy: W = {terms} + 1/D1 (J - 1)^2, D1 = 2/K",
        STRESS,
        *differences(data, form),
    ]
    shares, of_bulk = data.relaxation, 0.0 if data.material.relaxes_isochoric else 1.0
    keyword += ", moduli=instantaneous" if shares else ""
    named = f"*Material, name={data.region}\n*Density\n{DENSITY_T_PER_MM3:g},\n{keyword}\n"
    lines = _numbers([*values, *rest])
    if shares:
        comments.append(
            "G(t) = G (1 - sum g_i (1 - exp(-t/tau_i))); lines of *Viscoelastic are g_i, k_i, tau_i"
        )
        lines.append("*Viscoelastic, time=prony")
        lines += [", ".join(_numbers([g, of_bulk * g, tau])) for tau, g in shares.items()]
    return "".join(f"** {line}\n" for line in comments) + named + "\n".join(lines) + "\n"


def ansys(data: CardData) -> str:
    """Commands ``TB`` of an Ansys Mechanical APDL file."""
    form = check_form(data, "ansys")
    d1, n = 2.0 / form.bulk_MPa, len(form.powers) or len(form.stretches)
    if form.gent:
        table, values, terms, n = "GENT", list(form.gent), _gent_energy("mu"), 1
    elif form.stretches:
        table, values = "OGDEN", [value for c, m in form.stretches for value in (c / m, m)]
        terms = _stretch_energy("mu{0}/alpha{0}", "alpha{0}", n)
    elif n == 1:
        table, values, terms = "NEO", [2.0 * form.powers[0]], "mu/2 (I1 - 3)"
    else:
        table, values, terms = "YEOH", list(form.powers), _power_energy("C{0}0", n)
    volume = "((J^2 - 1)/2 - ln J)" if form.gent else "(J - 1)^2"
    comments = [
        *head(data, form),
        f"energy: W = {terms} + 1/d1 {volume}, d1 = 2/K",
        STRESS,
        *differences(data, form),
    ]
    rest = [d1, *[0.0] * (0 if table == "NEO" else n - 1)]
    option = "" if table in ("NEO", "GENT") else f"{n}"
    lines = [
        f"MP,DENS,{data.number},{DENSITY_T_PER_MM3:g}",
        f"TB,HYPER,{data.number},1,{option},{table}",
        *_table([*values, *rest]),
    ]
    if shares := data.relaxation:
        comments.append("G(t) = G (1 - sum a_i (1 - exp(-t/tau_i))); TB,PRONY has pairs a_i, tau_i")
        pairs = [value for time_s, share in shares.items() for value in (share, time_s)]
        for kind in ("SHEAR",) if data.material.relaxes_isochoric else ("SHEAR", "BULK"):
            lines += [f"TB,PRONY,{data.number},1,{len(shares)},{kind}", *_table(pairs)]
    return "".join(f"! {line}\n" for line in comments) + "\n".join(lines) + "\n"


def _table(numbers: Sequence[float]) -> Iterator[str]:
    """Commands ``TBDATA`` of the table before them."""
    for i in range(0, len(numbers), 6):
        yield f"TBDATA,{i + 1}," + ",".join(f"{value:.12g}" for value in numbers[i : i + 6])


def as_json(data: CardData) -> str:
    """Everything, in palpate's own convention; every material has this card."""
    from palpate.api.mechanics import moduli_at_rest

    mu, kappa = map(float, moduli_at_rest(data.material, np.asarray(data.theta)))
    parameters = {
        p.name: {
            "value": value,
            "unit": p.unit,
            "interval_95": list(data.intervals.get(p.name, ())) or None,
            "origin": data.origins[p.name],
            "verdict": data.verdicts.get(p.name),
        }
        for p, value in zip(data.material.parameters, data.theta.tolist(), strict=True)
    }
    content = {
        "title": data.title,
        "verdict": data.verdict,
        "region": data.region,
        "material": data.material.name,
        "settings": data.material.settings.model_dump(mode="json"),
        "energy": formula_of(data.material) or paragraphs_of(data.material)[0],
        "stress": "Cauchy: sigma_a = lambda_a/J dW/dlambda_a",
        "units": "mm, N, MPa",
        "parameters": parameters,
        "initial_shear_modulus_MPa": mu,
        "initial_bulk_modulus_MPa": kappa,
        "strain_of_experiment": dict(data.strain) or None,
        "ends_of_experiment": dict(data.reached) or None,
    }
    return json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def as_text(data: CardData) -> str:
    """Text for a person; every material has this card."""
    content = json.loads(as_json(data))
    moduli = (
        "initial moduli: shear {initial_shear_modulus_MPa:.4g} MPa, bulk {initial_bulk_modulus_MPa:.4g} MPa"
    )
    return "\n".join([*head(data), moduli.format_map(content), f"energy: {content['energy']}", ""])


def joined(program: str, cards: Mapping[str, str]) -> str:
    """Cards by region as the text of one file; those in JSON become one object by region."""
    if program != "json":
        return "".join(cards.values())
    content = {region: json.loads(card) for region, card in cards.items()}
    return json.dumps(content, indent=2, ensure_ascii=False) + "\n"


PROGRAMS: Mapping[str, Callable[[CardData], str]] = MappingProxyType(
    {"febio": febio, "abaqus": abaqus, "ansys": ansys, "json": as_json, "text": as_text}
)
"""Writers of cards by program."""


def cards_of(run: Run) -> Iterator[CardData]:
    """Cards of what was found for all spots together, by region; a value by spot or state is of the first."""
    data = report_data(run)
    study, found = run.study, run.fitted()
    model = model_verdict(data)
    known = _counting_at(found.spots[0], study.space.states, data.estimates)
    strains = run.strains().values()
    inputs = inputs_at(study, found.spots[0], found.values, run.measured)
    thetas = relaxing_thetas(study, inputs.thetas, found.values)
    for number, region in enumerate(relaxing_space(study).regions, start=1):
        theta = thetas[region.region]
        full = _full_names(study, region)
        searched = {p: known.get(name) for p, name in full.items()}
        source = "fitted" if found.is_fit else "selected"
        yield CardData(
            title=f"{study.name}, region {region.region}, material {region.material.name} ({found.source}, "
            f"scenario {found.scenario}, spots {', '.join(found.spots)})",
            region=region.region,
            material=region.material,
            theta=theta,
            intervals=_intervals(region, theta, searched),
            strain=ranges_of([strain[region.region] for strain in strains if region.region in strain]),
            origins={p: "fixed" if p in region.fixed else TIED if p in region.tied else source for p in full},
            verdicts={p: each.verdict for p, each in searched.items() if each},
            model=model,
            reached=_reached(run),
            number=number,
            record_s=study.record_s,
        )


def _reached(run: Run) -> dict[str, tuple[str, float, float]]:
    """Abscissa and its ends of the measured curves of a homogeneous specimen by channel; empty of a limb."""
    if run.study.protocol is not None:
        return {}
    ends: dict[str, list[float]] = {}
    for response in run.measured.values():
        for name, curve in response.curves.items():
            ends.setdefault(name, []).extend((float(curve.abscissa.min()), float(curve.abscissa.max())))
    return {name: (run.channels[name].abscissa, min(each), max(each)) for name, each in ends.items()}


def _counting_at(spot: str, states: Mapping[str, str], every: Sequence[Headline]) -> dict[str, Headline]:
    """Parameters whose values count at a spot, by full name without the spot or its state."""
    named = ((ParameterName.parse(each.name), each) for each in every)
    return {name.shared: each for name, each in named if name.counts_at(spot, states)}


def _full_names(study: Study, region: RegionMaterial) -> dict[str, str]:
    """Full names of the parameters of a region's material; shares of all moduli have no region."""
    own, shares = list(region.full_names.items()), tuple(study.parametrisation.times_s)
    n_own = len(own) - len(shares)
    return dict(own[:n_own]) | {name: share for (name, _), share in zip(own[n_own:], shares, strict=True)}


def _intervals(
    region: RegionMaterial, theta: FloatArray, searched: Mapping[str, Headline | None]
) -> dict[str, tuple[float, float]]:
    """95 % intervals in textbook values, of the parameters that the fit has some for."""
    intervals = {}
    for i, parameter in enumerate(region.material.parameters):
        found = searched[parameter.name]
        if found is None or not found.level or found.lower is None or found.upper is None:
            continue
        values = np.tile(region.material.from_textbook(theta, region.convention), (2, 1))
        values[:, i] = found.lower, found.upper
        lower, upper = sorted(float(region.material.to_textbook(v, region.convention)[i]) for v in values)
        intervals[parameter.name] = (lower, upper)
    return intervals
