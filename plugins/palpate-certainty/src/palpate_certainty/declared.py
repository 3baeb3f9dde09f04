"""Tables of the stages of this plugin: each row, and each column."""

from collections.abc import Mapping
from types import MappingProxyType

import polars as pl

from palpate.api import OF_ROW, StageTable, TableColumn
from palpate.api.runs import ASSESSED, OF_A_FIT, SEARCHED, common

PLANE = {
    **common("fit", "scenario", "parameter"),
    "other": TableColumn("Other parameter of the plane; null along one parameter.", pl.String),
    "value": TableColumn("Value of the parameter.", unit="unit of the parameter"),
    "other_value": TableColumn("Value of the other parameter.", unit="unit of the other parameter"),
}

DECLARED: Mapping[str, Mapping[str, StageTable]] = MappingProxyType(
    {
        "intervals": {
            **{name: ASSESSED[name] for name in OF_A_FIT},
            "budget": StageTable(
                "Share of each error source in the variance of each parameter, the largest first.",
                {
                    **common("fit", "scenario", "parameter"),
                    "cause": TableColumn("Error source.", pl.String),
                    "share": TableColumn("Share of the variance; null where it could not be simulated."),
                    "sd": TableColumn("Standard deviation.", unit="unit of the parameter"),
                    "status": TableColumn("'included', or why it could not be simulated.", pl.String),
                },
            ),
            "parameter_combinations": StageTable(
                "Combinations of parameters, the best known first.",
                {
                    **common("fit", "scenario"),
                    "combination": TableColumn("Product of powers, such as c1 · m1^0.3.", pl.String),
                    "relative_width": TableColumn("Width of the 95 % interval over the value."),
                    **common("identifiability"),
                },
            ),
            "mesh_errors": StageTable(
                "Mesh error of each fitted curve.",
                {
                    **common("fit", "scenario", "spot", "channel"),
                    "relative_error": TableColumn(
                        "Standard deviation over the curve, as roots of mean squares."
                    ),
                    "shown_by": TableColumn(
                        "'two meshes', 'the scatter of other meshes', 'one mesh' or 'the study'.", pl.String
                    ),
                },
            ),
            "model_errors": StageTable(
                "Model error of each fitted channel: a process along the path.",
                {
                    **common("fit", "scenario", "channel"),
                    "length": TableColumn("Correlation length, in ranges of the abscissa."),
                    "sd": TableColumn("Standard deviation over the largest ordinate reached so far."),
                },
            ),
            "draws": StageTable("Draws from the density of each fit.", common("fit", "scenario"), SEARCHED),
            "between_spots": StageTable(
                "Differences between spots beyond their errors, by parameter that the spots share.",
                {
                    **common("fit", "scenario", "parameter", "unit"),
                    "value": TableColumn("Mean over the spots; the geometric one of a modulus.", unit=OF_ROW),
                    "sd": TableColumn(
                        "Standard deviation between spots; of a modulus, of its logarithm, times the mean.",
                        unit=OF_ROW,
                    ),
                    **common("lower", "upper"),
                    "n_spots": TableColumn("Number of spots.", pl.Int64),
                },
            ),
            "spot_draws": StageTable(
                "Draws from the density of a new spot; none where spots do not differ.",
                common("fit", "scenario"),
                SEARCHED,
            ),
        },
        "contours": {
            "profile_planes": StageTable(
                "Fopt of emulated curves over the planes of two parameters, the others fitted again.",
                {**PLANE, "fopt": TableColumn("Fopt; null where the emulator knows too little.")},
            )
        },
        "validate": {
            "held_out": StageTable(
                "Each held-out curve against its prediction.",
                {
                    **common("spot", "channel"),
                    "difference": TableColumn("Root mean square difference over the peak."),
                    "band": TableColumn("Root mean square over the peak within which 90 % of curves are."),
                    "probability": TableColumn("Probability of a larger difference."),
                    "inside": TableColumn("True if the curve is inside of its band.", pl.Boolean),
                },
            )
        },
        "certainty": {
            "posterior": StageTable(
                "Posterior of each parameter by scenario.",
                {
                    **common("fit", "scenario", "parameter", "unit"),
                    "mean": TableColumn("Mean of the draws.", unit=OF_ROW),
                    "sd": TableColumn("Standard deviation of the draws.", unit=OF_ROW),
                    **common("lower", "upper"),
                    "mean_solved": TableColumn("Mean by the solver instead of the emulator.", unit=OF_ROW),
                    "at_lower": TableColumn("Probability of the lowest 1 % of the range."),
                    "at_upper": TableColumn("Probability of the highest 1 % of the range."),
                    "split_r": TableColumn("Split R̂ of the chains."),
                    "autocorrelation": TableColumn("Autocorrelation time.", unit="steps"),
                    "n_independent": TableColumn("Independent draws.", pl.Int64),
                    "converged": TableColumn("True if the chains have converged.", pl.Boolean),
                },
            ),
            "posterior_draws": StageTable("Draws of the posterior.", common("fit", "scenario"), SEARCHED),
            "profiles": StageTable(
                "Profile of each parameter in the scenario that generalises.",
                {
                    **common("fit", "scenario", "parameter", "unit", "value"),
                    "rise": TableColumn("Rise of −2 log of the density, the other parameters fitted again."),
                },
            ),
            "profile_ends": StageTable(
                "Ends of the profiles.",
                {
                    **common("fit", "scenario", "parameter", "unit"),
                    "end": TableColumn("'lower' or 'upper'.", pl.String),
                    **common("value"),
                    "value_solved": TableColumn("Value by the solver; null where it failed.", unit=OF_ROW),
                    "at_bound": TableColumn("True at an end of the range.", pl.Boolean),
                },
            ),
            "sobol_indices": StageTable(
                "Sobol indices of each point of the curves, over the ranges.",
                {
                    **common("spot", "channel"),
                    "point": TableColumn("Number of the point.", pl.Int64),
                    "abscissa": TableColumn("Abscissa of the channel, in its unit."),
                    **common("parameter"),
                    "first": TableColumn("Index of first order."),
                    "total": TableColumn("Total index."),
                },
            ),
            "volumes": StageTable(
                "Volume of each posterior.",
                {
                    **common("fit", "scenario"),
                    "volume": TableColumn("Volume over the volume of the ranges."),
                    "ratio": TableColumn("Volume over the volume in the scenario that generalises."),
                },
            ),
            "emulator": StageTable(
                "Errors of the emulated curves.",
                {
                    **common("fit", "scenario", "channel"),
                    "n_runs": TableColumn("Simulations of which the emulator was made.", pl.Int64),
                    "n_solved": TableColumn("Draws that were simulated.", pl.Int64),
                    "error": TableColumn("Largest error at these draws, over the measured peak."),
                    "left_out": TableColumn("Largest error at simulations left out, over the measured peak."),
                },
            ),
            "posterior_planes": StageTable(
                "Fopt over the planes of two parameters, by the emulator of the posterior.",
                {**PLANE, **common("fopt")},
            ),
        },
        "identifiability": {"identifiability": ASSESSED["identifiability"]},
    }
)
"""Tables by stage."""
