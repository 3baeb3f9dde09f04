"""Tables of a run that the core makes, or reads of whoever makes them: each row, and each column."""

from types import MappingProxyType

import polars as pl

from palpate.plugins.table import OF_ROW, StageTable, TableColumn

SPOT_COLUMN = {"spot": TableColumn("Name of the spot.", pl.String)}
SCENARIO_COLUMN = {"scenario": TableColumn("Scenario of the study.", pl.String)}
CHANNEL_COLUMN = {"channel": TableColumn("Name of the channel.", pl.String)}
FIT_COLUMNS = {
    "fit": TableColumn("'all spots' for a joint fit, else the spot.", pl.String),
    **SCENARIO_COLUMN,
}
PARAMETER_COLUMNS = {
    "parameter": TableColumn("Full name; NAME@SPOT where each spot has its own.", pl.String),
    "unit": TableColumn("Unit of the parameter.", pl.String),
}
VALUE_COLUMN = {"value": TableColumn("Value of the parameter.", unit=OF_ROW)}
INTERVAL_COLUMNS = {
    "lower": TableColumn("Lower end of the 95 % interval.", unit=OF_ROW),
    "upper": TableColumn("Upper end of the 95 % interval.", unit=OF_ROW),
}
IDENTIFIABILITY_COLUMN = {
    "identifiability": TableColumn(
        "Word for the relative width; 'unclear' without a certain interval.", pl.String
    )
}
FOPT_COLUMN = {"fopt": TableColumn("Fopt, the weighted sum of the misfits.")}
SET_COLUMN = {"set_id": TableColumn("Number of the set in the design.", pl.Int64)}
MESSAGE_COLUMN = {"message": TableColumn("Reason; empty where there is none.", pl.String)}
POINT_COLUMNS = {
    **CHANNEL_COLUMN,
    "point": TableColumn("Number of the point.", pl.Int64),
    "abscissa": TableColumn("Abscissa of the channel, in its unit."),
    "ordinate": TableColumn("Ordinate of the channel, in its unit."),
}
SEARCHED = "One column for each searched parameter, in its unit."
ERRORS = "nmse_CHANNEL and r2_CHANNEL for each channel."

OF_EXPERIMENT = MappingProxyType(
    {"measured": StageTable("Points of the measured curves of each spot.", POINT_COLUMNS)}
)
OF_SAMPLE = MappingProxyType({"design": StageTable("Parameters of each set.", SET_COLUMN, SEARCHED)})
OF_SCORE = MappingProxyType(
    {
        "scores": StageTable(
            "Misfit of each set at each spot in each channel.",
            {
                **SPOT_COLUMN,
                **SET_COLUMN,
                **CHANNEL_COLUMN,
                "nmse": TableColumn(
                    "Misfit by the study's score, NMSE by itself; null for a set without a rank."
                ),
                "r2": TableColumn("Coefficient of determination R²."),
                "coverage": TableColumn("Share of the measured weight that the simulated curve reaches."),
                "status": TableColumn("Status of the simulation.", pl.String),
                **MESSAGE_COLUMN,
            },
        )
    }
)
OF_SELECT = MappingProxyType(
    {
        "selection": StageTable(
            "Set with the least Fopt by spot and scenario.",
            {**SPOT_COLUMN, **SCENARIO_COLUMN, **SET_COLUMN, **FOPT_COLUMN},
            f"{ERRORS} {SEARCHED}",
        ),
        "generalisation": StageTable(
            "Set with the least mean Fopt over the spots, a row for each spot.",
            {
                **SPOT_COLUMN,
                **SCENARIO_COLUMN,
                **SET_COLUMN,
                **FOPT_COLUMN,
                "fopt_mean": TableColumn("Mean of Fopt over the spots."),
                "fopt_sd": TableColumn("Standard deviation of Fopt over the spots."),
            },
            f"{ERRORS} {SEARCHED}",
        ),
    }
)
OF_VERIFY = MappingProxyType(
    {
        "verification": StageTable(
            "Verification of each selected set.",
            {
                **SPOT_COLUMN,
                **SET_COLUMN,
                "passed": TableColumn("True if the solver's answer was verified.", pl.Boolean),
                **MESSAGE_COLUMN,
                "key": TableColumn("Key of the verification; empty where it is tried again.", pl.String),
            },
            "The solver's figures.",
        )
    }
)
OF_FIT = MappingProxyType(
    {
        "fit": StageTable(
            "End of each search, a row for each fit, scenario and spot.",
            {
                **FIT_COLUMNS,
                **SPOT_COLUMN,
                **FOPT_COLUMN,
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
                **FIT_COLUMNS,
                "search": TableColumn("Number of the search.", pl.Int64),
                "correction": TableColumn(
                    "Number of the correction by finer meshes; 0 for the first.", pl.Int64
                ),
                "step": TableColumn("Number of the evaluation.", pl.Int64),
                "n_runs": TableColumn("Simulations by then.", pl.Int64),
                "fopt": TableColumn("Fopt; null where the evaluation failed."),
                "objective": TableColumn("Fopt with priors."),
                **MESSAGE_COLUMN,
            },
            SEARCHED,
        ),
        "fit_mesh": StageTable(
            "Correction of each parameter by finer meshes.",
            {
                **FIT_COLUMNS,
                "parameter": PARAMETER_COLUMNS["parameter"],
                "coarse": TableColumn("Value by the coarse meshes alone.", unit="unit of the parameter"),
                "corrected": TableColumn(
                    "Value extrapolated to no mesh error.", unit="unit of the parameter"
                ),
            },
        ),
        "fine_meshes": StageTable(
            "Meshes that were refined.",
            {
                **SPOT_COLUMN,
                "edge_mm": TableColumn("Longest edge under the indenter.", unit="mm"),
                "n_nodes": TableColumn("Number of nodes.", pl.Int64),
            },
        ),
        "fit_curves": StageTable(
            "Curves where each search ended.", {**FIT_COLUMNS, **SPOT_COLUMN, **POINT_COLUMNS}
        ),
    }
)
OF_SURFACE = MappingProxyType(
    {
        "surface": StageTable(
            "Simulation that has the states of the skin, by spot.",
            {
                **SPOT_COLUMN,
                **SCENARIO_COLUMN,
                "source": TableColumn("'fit', or the set of the sweep.", pl.String),
                "key": TableColumn("Key of the simulation in the ledger.", pl.String),
                "status": TableColumn("Status of the simulation.", pl.String),
                **MESSAGE_COLUMN,
            },
        )
    }
)

# ------------------------------------------------------- read of whoever assesses a fit

OF_A_FIT = ("intervals", "adequacy", "reported", "reported_curves")
"""Tables that the answer reads of a fit that was assessed."""

ASSESSED = MappingProxyType(
    {
        "intervals": StageTable(
            "Value and 95 % interval of each parameter.",
            {
                **FIT_COLUMNS,
                **PARAMETER_COLUMNS,
                **VALUE_COLUMN,
                **INTERVAL_COLUMNS,
                "noise_lower": TableColumn("Lower end by the noise alone.", unit=OF_ROW),
                "noise_upper": TableColumn("Upper end by the noise alone.", unit=OF_ROW),
                "relative_width": TableColumn("Width over the value or over the range, whichever is more."),
                **IDENTIFIABILITY_COLUMN,
            },
        ),
        "adequacy": StageTable(
            "Checks of whether the model describes the data.",
            {
                **FIT_COLUMNS,
                "check": TableColumn("Kind of the check.", pl.String),
                "channel": TableColumn("Name of the channel; null for all.", pl.String),
                "probability": TableColumn("Probability of residuals like these under a good model."),
                "verdict": TableColumn("'describes', 'approximates' or 'does not describe'.", pl.String),
                "difference": TableColumn("Largest difference from the channel over its peak; null for all."),
                "r2": TableColumn("Least R² of a spot at the reported values; null for all."),
                **MESSAGE_COLUMN,
            },
        ),
        "reported": StageTable(
            "Errors of each fit at its reported values.",
            {**FIT_COLUMNS, **SPOT_COLUMN, **FOPT_COLUMN},
            ERRORS,
        ),
        "reported_curves": StageTable(
            "Curves of each fit at its reported values.", {**FIT_COLUMNS, **SPOT_COLUMN, **POINT_COLUMNS}
        ),
        "identifiability": StageTable(
            "Interval of each parameter by the sweep.",
            {
                **SPOT_COLUMN,
                **SCENARIO_COLUMN,
                **PARAMETER_COLUMNS,
                "value": TableColumn("Value of the best set.", unit=OF_ROW),
                "optimum": TableColumn("Value where Fopt of emulated curves is least.", unit=OF_ROW),
                "lower": TableColumn("Lower end of the interval within the range.", unit=OF_ROW),
                "upper": TableColumn("Upper end of the interval within the range.", unit=OF_ROW),
                "relative_width": TableColumn("Width over the width of the range."),
                **IDENTIFIABILITY_COLUMN,
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
