"""Tables of a run that the core makes, or reads of whoever makes them: each row, and each column."""

from collections.abc import Mapping
from types import MappingProxyType

import polars as pl

from palpate.plugins.table import OF_ROW, StageTable, TableColumn

COMMON = MappingProxyType(
    {
        "fit": TableColumn("'all spots' for a joint fit, else the spot.", pl.String),
        "scenario": TableColumn("Scenario of the study.", pl.String),
        "spot": TableColumn("Name of the spot.", pl.String),
        "channel": TableColumn("Name of the channel.", pl.String),
        "set_id": TableColumn("Number of the set in the design.", pl.Int64),
        "parameter": TableColumn("Full name; NAME@SPOT where each spot has its own.", pl.String),
        "unit": TableColumn("Unit of the parameter.", pl.String),
        "value": TableColumn("Value of the parameter.", unit=OF_ROW),
        "lower": TableColumn("Lower end of the 95 % interval.", unit=OF_ROW),
        "upper": TableColumn("Upper end of the 95 % interval.", unit=OF_ROW),
        "identifiability": TableColumn("Word for the relative width, or 'unclear'.", pl.String),
        "fopt": TableColumn("Fopt, the weighted sum of the misfits."),
        "point": TableColumn("Number of the point.", pl.Int64),
        "abscissa": TableColumn("Abscissa of the channel, in its unit."),
        "ordinate": TableColumn("Ordinate of the channel, in its unit."),
        "status": TableColumn("Status of the simulation.", pl.String),
        "message": TableColumn("Reason; empty where there is none.", pl.String),
    }
)
"""Columns that mean the same in every table."""


def common(*names: str) -> dict[str, TableColumn]:
    """Columns of :data:`COMMON` by name."""
    return {name: COMMON[name] for name in names}


SEARCHED = "One column for each searched parameter, in its unit."
ERRORS = "nmse_CHANNEL and r2_CHANNEL for each channel."

DECLARED: Mapping[str, Mapping[str, StageTable]] = MappingProxyType(
    {
        "experiment": {
            "measured": StageTable(
                "Points of the measured curves of each spot.",
                common("channel", "point", "abscissa", "ordinate"),
            )
        },
        "sample": {"design": StageTable("Parameters of each set.", common("set_id"), SEARCHED)},
        "score": {
            "scores": StageTable(
                "Misfit of each set at each spot in each channel.",
                {
                    **common("spot", "set_id", "channel"),
                    "nmse": TableColumn(
                        "Misfit by the study's score, NMSE by itself; null for a set without a rank."
                    ),
                    "r2": TableColumn("Coefficient of determination R²."),
                    "coverage": TableColumn("Share of the measured weight that the simulated curve reaches."),
                    **common("status", "message"),
                },
            )
        },
        "select": {
            "selection": StageTable(
                "Set with the least Fopt by spot and scenario.",
                common("spot", "scenario", "set_id", "fopt"),
                f"{ERRORS} {SEARCHED}",
            ),
            "generalisation": StageTable(
                "Set with the least mean Fopt over the spots, a row for each spot.",
                {
                    **common("spot", "scenario", "set_id", "fopt"),
                    "fopt_mean": TableColumn("Mean of Fopt over the spots."),
                    "fopt_sd": TableColumn("Standard deviation of Fopt over the spots."),
                },
                f"{ERRORS} {SEARCHED}",
            ),
        },
        "verify": {
            "verification": StageTable(
                "Verification of each selected set.",
                {
                    **common("spot", "set_id"),
                    "passed": TableColumn("True if the solver's answer was verified.", pl.Boolean),
                    **common("message"),
                    "key": TableColumn("Key of the verification; empty where it is tried again.", pl.String),
                },
                "The solver's figures.",
            )
        },
        "fit": {
            "fit": StageTable(
                "End of each search, a row for each fit, scenario and spot.",
                {
                    **common("fit", "scenario", "spot", "fopt"),
                    "n_evaluations": TableColumn("Evaluations of the searches.", pl.Int64),
                    "n_fine": TableColumn("Simulations of finer meshes.", pl.Int64),
                    "n_runs": TableColumn("Other simulations that no fit before had asked for.", pl.Int64),
                    "at_bound": TableColumn("Parameters at an end of their range.", pl.String),
                    "message": TableColumn("Reason why the search ended.", pl.String),
                },
                f"{ERRORS} {SEARCHED}",
            ),
            "fit_trace": StageTable(
                "Every evaluation of the searches.",
                {
                    **common("fit", "scenario"),
                    "search": TableColumn("Number of the search.", pl.Int64),
                    "correction": TableColumn(
                        "Number of the correction by finer meshes; 0 for the first.", pl.Int64
                    ),
                    "step": TableColumn("Number of the evaluation.", pl.Int64),
                    "n_runs": TableColumn("Simulations by then.", pl.Int64),
                    "fopt": TableColumn("Fopt; null where the evaluation failed."),
                    "objective": TableColumn("Fopt with priors."),
                    **common("message"),
                },
                SEARCHED,
            ),
            "fit_mesh": StageTable(
                "Correction of each parameter by finer meshes.",
                {
                    **common("fit", "scenario", "parameter"),
                    "coarse": TableColumn("Value by the coarse meshes alone.", unit="unit of the parameter"),
                    "corrected": TableColumn(
                        "Value extrapolated to no mesh error.", unit="unit of the parameter"
                    ),
                },
            ),
            "fine_meshes": StageTable(
                "Meshes that were refined.",
                {
                    **common("spot"),
                    "edge_mm": TableColumn("Longest edge under the indenter.", unit="mm"),
                    "n_nodes": TableColumn("Number of nodes.", pl.Int64),
                },
            ),
            "fit_curves": StageTable(
                "Curves where each search ended.",
                common("fit", "scenario", "spot", "channel", "point", "abscissa", "ordinate"),
            ),
        },
        "surface": {
            "surface": StageTable(
                "Simulation that has the states of the skin, by spot.",
                {
                    **common("spot", "scenario"),
                    "source": TableColumn("'fit', or the set of the sweep.", pl.String),
                    "key": TableColumn("Key of the simulation in the ledger.", pl.String),
                    **common("status", "message"),
                },
            )
        },
    }
)
"""Tables of the core by stage."""

# ------------------------------------------------------- read of whoever assesses a fit

OF_A_FIT = ("intervals", "adequacy", "reported", "reported_curves")
"""Tables that the answer reads of a fit that was assessed."""

ASSESSED = MappingProxyType(
    {
        "intervals": StageTable(
            "Value and 95 % interval of each parameter.",
            {
                **common("fit", "scenario", "parameter", "unit", "value", "lower", "upper"),
                "relative_width": TableColumn("Width over the value or over the range, whichever is more."),
                **common("identifiability"),
            },
        ),
        "adequacy": StageTable(
            "Checks of whether the model describes the data.",
            {
                **common("fit", "scenario"),
                "check": TableColumn("Kind of the check.", pl.String),
                "channel": TableColumn("Name of the channel; null for all.", pl.String),
                "probability": TableColumn("Probability of residuals like these under a good model."),
                "verdict": TableColumn("'describes', 'approximates' or 'does not describe'.", pl.String),
                "difference": TableColumn("Largest difference from the channel over its peak; null for all."),
                "r2": TableColumn("Least R² of a spot at the reported values; null for all."),
                "explained_by": TableColumn(
                    "Stated error that explains most of it; null for none.", pl.String
                ),
                "visible": TableColumn(
                    "Discrepancy of a law, as a standard deviation over the peak, that nine of ten such "
                    "experiments show; null for all."
                ),
                **common("message"),
            },
        ),
        "reported": StageTable(
            "Errors of each fit at its reported values.", common("fit", "scenario", "spot", "fopt"), ERRORS
        ),
        "reported_curves": StageTable(
            "Curves of each fit at its reported values.",
            common("fit", "scenario", "spot", "channel", "point", "abscissa", "ordinate"),
        ),
        "identifiability": StageTable(
            "Interval of each parameter by the sweep.",
            {
                **common("spot", "scenario", "parameter", "unit"),
                "value": TableColumn("Value of the best set.", unit=OF_ROW),
                "optimum": TableColumn("Value where Fopt of emulated curves is least.", unit=OF_ROW),
                "lower": TableColumn("Lower end of the interval within the range.", unit=OF_ROW),
                "upper": TableColumn("Upper end of the interval within the range.", unit=OF_ROW),
                "relative_width": TableColumn("Width over the width of the range."),
                **common("identifiability"),
                "most_correlated_with": TableColumn("Parameter that compensates for it best.", pl.String),
                "correlation": TableColumn("Correlation with this parameter."),
                "fopt_threshold": TableColumn("Largest Fopt of a set that is about as good."),
                "n_as_good": TableColumn("Sets of the sweep up to the threshold.", pl.Int64),
                "q2": TableColumn(
                    "Share of variation that the emulator predicts at sets left out; null: too few."
                ),
            },
        ),
    }
)
"""Tables that the answer reads, from whichever stages declare them: on a fit, and on a sweep."""
