"""A report's report_data under names that try to be markup, script, or a key with a meaning."""

from dataclasses import replace

import polars as pl

from palpate.mesh.specimens import block
from palpate_report.data.report_data import ReportData

ATTACK = '</script><script>window.pwned = 1</script><img src=x onerror="window.pwned = 1"><marquee>'
SPOTS = {"p1": f"{ATTACK}\u2028{{{{ 7 * 7 }}}}", "p2": "__proto__"}
SCENARIOS = {"I": "<b>bold</b> %{x} &amp;", "II": "constructor", "III": "' onclick='window.pwned = 1"}
REGION = '<a href="javascript:window.pwned = 1">soft</a>'
REASON = f"{ATTACK} at step 3"
NAMES = (*SPOTS.values(), *SCENARIOS.values(), REGION)


def renamed(report_data: ReportData) -> ReportData:
    """The same results under hostile names, some of them failed for a hostile reason."""
    study, measured = report_data.study, report_data.measured
    parameters = tuple(replace(p, name=_parameter(p.name)) for p in report_data.design.parameters)
    scores = _frame(report_data.scores).with_columns(
        nmse=pl.when(pl.col("set_id") < 9).then(None).otherwise(pl.col("nmse")),
        message=pl.when(pl.col("set_id") < 9).then(pl.lit(REASON)).otherwise(pl.col("message")),
        status=pl.when(pl.col("set_id") < 9).then(pl.lit("diverged")).otherwise(pl.col("status")),
    )
    spots = tuple(replace(s, spot=_spot(s.spot)) for s in study.spots)
    scenarios = tuple(replace(s, name=SCENARIOS[s.name], description=ATTACK) for s in study.scenarios)
    space = replace(study.space, regions=tuple(replace(r, region=REGION) for r in study.space.regions))
    limb = block("tet4", n_across=4, n_down=3, layers_mm={REGION: 6.0})
    return replace(
        report_data,
        study=replace(
            study,
            name=ATTACK,
            description=ATTACK,
            spots=spots,
            scenarios=scenarios,
            space=space,
            generalise_by=SCENARIOS["I"],
        ),
        measured={SPOTS[spot]: response for spot, response in measured.items()},
        design=replace(report_data.design, parameters=parameters),
        scores=scores,
        selection=_frame(report_data.selection),
        generalisation=_frame(report_data.generalisation),
        tables={
            "identifiability": _frame(report_data.table("identifiability")).with_columns(
                pl.col("parameter", "most_correlated_with").map_elements(_parameter, return_dtype=pl.String)
            )
        },
        convergence=_frame(report_data.convergence),
        responses={(SPOTS[spot], set_id): r for (spot, set_id), r in report_data.responses.items()},
        limbs={name: replace(limb, spot=replace(limb.spot, name=name)) for name in SPOTS.values()},
        manifest={"name": ATTACK, "inputs": {ATTACK: "0" * 64}},
    )


def _spot(spot):
    return replace(spot, name=SPOTS[spot.name])


def _parameter(name: str) -> str:
    return f"{REGION}.{name.partition('.')[2]}"


def _frame(frame: pl.DataFrame) -> pl.DataFrame:
    named = frame.rename({c: _parameter(c) for c in frame.columns if c.startswith("soft_tissue.")})
    columns = [pl.col("spot").replace(SPOTS)]
    if "scenario" in named.columns:
        columns.append(pl.col("scenario").replace(SCENARIOS))
    return named.with_columns(columns)
