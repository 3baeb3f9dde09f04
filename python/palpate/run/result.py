"""Values that the stages of a run hand on: what it read, chose and wrote."""

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from statistics import NormalDist
from typing import Any

import polars as pl

from palpate.domain import Design, Limb, ParameterName, Response
from palpate.run.result_files import responses_of

LEVEL = 0.95
"""Probability with which an interval holds the truth."""

RISE = NormalDist().inv_cdf(0.5 + LEVEL / 2.0) ** 2
"""By how much −2 log of the density is larger at the ends of such an interval: quantile of χ² of one."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyInputs:
    """A study whose files have been read and found usable.

    Parameters
    ----------
    measured, limbs : mapping of spot name to Response, Limb
        ``limbs`` is empty where the solver needs none.
    warnings : tuple of str
        What is odd about the study or its curves, and stops nothing.
    edges_mm : mapping of spot name to float
        Longest edges under the indenter of finer meshes that the run has chosen by itself.
    """

    measured: Mapping[str, Response]
    limbs: Mapping[str, Limb]
    design: Design
    warnings: tuple[str, ...] = ()
    edges_mm: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionResult:
    """Sets that identification chose.

    Parameters
    ----------
    selection : DataFrame
        One row per spot and scenario: spot, scenario, set_id, fopt, nmse_<channel>,
        r2_<channel>, <region.parameter>.
    generalisation : DataFrame
        One row per spot for the one set with the least mean Fopt over the spots; empty
        when no set succeeded at every spot.
    verification : DataFrame
        Which selected sets passed the solver's verification, as
        :func:`palpate.simulation.verification.verify` returns it; empty where the solver has none.
    without_result : mapping of (spot, scenario) to str
        Why no set could be selected there; empty where every scenario has a set at every spot.
    """

    selection: pl.DataFrame
    generalisation: pl.DataFrame
    verification: pl.DataFrame = field(default_factory=pl.DataFrame)
    without_result: Mapping[tuple[str, str], str] = field(default_factory=dict)


ALL_SPOTS = "all spots"
"""Label of a joint fit."""

_OF_TRACE = ("fit", "scenario", "search", "correction", "step", "n_runs", "fopt", "objective", "message")
"""Columns of a trace that are no values."""

UNSETTLED = "the correction by finer meshes has not settled"
"""Message of a fit whose corrections were not near enough to its end."""

UNSEEN = "no curve"
"""Beginning of messages on values that no curve decides."""

WIDENED = "range of"
"""Beginning of messages on ranges that a fit has widened, where it ended at their ends."""


INCLUDED = "included"
"""Status of a cause that intervals include."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CertaintyResult:
    """Certainty of the fitted parameters; empty where there was no fit.

    Parameters
    ----------
    intervals : DataFrame
        One row per fit, scenario and parameter: fit, scenario, parameter (``<name>@<spot>`` where each spot
        has its own), unit, value; lower and upper, the 95 % interval; noise_lower and noise_upper, that of
        the noise alone; relative_width, its length over the value or over the range, whichever is more;
        identifiability, the word for it ("unclear" where the model does not describe the data, or a cause
        could not be simulated).
    budget : DataFrame
        One row per fit, scenario, parameter and cause, the largest first: share of the variance, which sum
        to 1, sd in the parameter's unit, and status: "included", or why a cause could not be simulated, whose
        share and sd are null.
    parameter_combinations : DataFrame
        One row per fit, scenario and principal direction, the best known first: combination (such as
        ``c1 · m1^0.3``), relative_width of its 95 % interval, identifiability.
    adequacy : DataFrame
        One row per fit, scenario, check and channel: check, channel (null for all), probability of
        residuals like these under a good model; verdict, "describes", "approximates" or "does not describe";
        difference from the channel at most, over its peak, and the least r2 of a spot, both at the values of
        ``intervals`` (null for all); and message: what is wrong, empty where nothing is.
    mesh_errors : DataFrame
        One row per fit, scenario, spot and fitted curve: relative_error of the curve by its mesh (one
        standard deviation over the curve, both as root of the mean square), and shown_by: "two meshes",
        "usual scatter" (between pairs of meshes, where it is more), "one mesh" (the usual error of its
        edges) or "the study"; empty without meshes.
    draws : DataFrame
        One row per draw from the density of each fit, cut off at the ranges and the filters: fit, scenario
        and what was searched.
    between_spots : DataFrame
        Of fits whose spots differ by more than their errors, one row per parameter that the spots share: fit,
        scenario, parameter, unit, value (the mean), sd between spots, lower and upper (95 % interval of sd)
        and n_spots.
    spot_draws : DataFrame
        As ``draws``, of the parameters of a new spot; empty where the spots do not differ.
    profile_planes : DataFrame
        Fopt of the joint fits by emulated curves, the other parameters fitted again, over the planes of two
        parameters and along each: fit, scenario, parameter, other (null along one), value, other_value, fopt
        (null where the emulator knows too little).
    reported : DataFrame
        One row per fit, scenario and spot, at the values of ``intervals``: fopt, nmse_<channel> and
        r2_<channel>. The fit that leads is simulated there; on a mesh the others go along their slopes.
    reported_curves : DataFrame
        Points of these curves: fit, scenario, spot, channel, point, abscissa and ordinate.
    """

    intervals: pl.DataFrame = field(default_factory=pl.DataFrame)
    budget: pl.DataFrame = field(default_factory=pl.DataFrame)
    parameter_combinations: pl.DataFrame = field(default_factory=pl.DataFrame)
    adequacy: pl.DataFrame = field(default_factory=pl.DataFrame)
    mesh_errors: pl.DataFrame = field(default_factory=pl.DataFrame)
    draws: pl.DataFrame = field(default_factory=pl.DataFrame)
    between_spots: pl.DataFrame = field(default_factory=pl.DataFrame)
    spot_draws: pl.DataFrame = field(default_factory=pl.DataFrame)
    profile_planes: pl.DataFrame = field(default_factory=pl.DataFrame)
    reported: pl.DataFrame = field(default_factory=pl.DataFrame)
    reported_curves: pl.DataFrame = field(default_factory=pl.DataFrame)

    def __repr__(self) -> str:
        rows = (f"{each.name} {getattr(self, each.name).height}" for each in fields(self))
        return f"CertaintyResult(rows of its tables: {', '.join(rows)})"


@dataclass(frozen=True, slots=True, kw_only=True)
class PosteriorResult:
    """Posteriors of the joint fits, by an emulator of the curves; empty where none were drawn.

    Parameters
    ----------
    posterior : DataFrame
        One row per scenario and parameter: fit, scenario, parameter, unit, mean, sd, lower and upper (95 %),
        mean_solved (the mean by the real solver), at_lower and at_upper (probability of the last 1 % of the
        range), split_r, autocorrelation (in steps), n_independent, converged.
    posterior_draws : DataFrame
        One row per draw: fit, scenario and what was searched.
    profiles : DataFrame
        Of the scenario that generalises, one row per point: fit, scenario, parameter, unit, value and rise
        (of −2 log of the density over its least, the other parameters fitted again; 3.84 at the ends of a
        95 % interval).
    profile_ends : DataFrame
        One row per parameter and end: fit, scenario, parameter, unit, end ("lower" or "upper"), value,
        value_solved (fitted again with the real solver; null where that failed), at_bound.
    sobol_indices : DataFrame
        One row per point of a curve and parameter: spot, channel, point (its number), abscissa, parameter,
        first (Sobol index over the ranges) and total.
    volumes : DataFrame
        One row per scenario: fit, scenario, volume (of the posterior, over that of the box) and ratio to the
        scenario that generalises.
    emulator : DataFrame
        One row per scenario and channel: fit, scenario, channel, n_runs of which the emulator was made,
        n_solved (draws that were simulated), error (largest at these, over the measured peak), left_out
        (largest error at runs left out, anywhere in the ranges).
    posterior_planes : DataFrame
        As ``profile_planes`` of :class:`CertaintyResult`, by this emulator.
    """

    posterior: pl.DataFrame = field(default_factory=pl.DataFrame)
    posterior_draws: pl.DataFrame = field(default_factory=pl.DataFrame)
    profiles: pl.DataFrame = field(default_factory=pl.DataFrame)
    profile_ends: pl.DataFrame = field(default_factory=pl.DataFrame)
    sobol_indices: pl.DataFrame = field(default_factory=pl.DataFrame)
    volumes: pl.DataFrame = field(default_factory=pl.DataFrame)
    emulator: pl.DataFrame = field(default_factory=pl.DataFrame)
    posterior_planes: pl.DataFrame = field(default_factory=pl.DataFrame)


IDENTIFIABILITY = {
    "spot": pl.String,
    "scenario": pl.String,
    "parameter": pl.String,
    "unit": pl.String,
    "value": pl.Float64,
    "optimum": pl.Float64,
    "lower": pl.Float64,
    "upper": pl.Float64,
    "relative_width": pl.Float64,
    "identifiability": pl.String,
    "most_correlated_with": pl.String,
    "correlation": pl.Float64,
    "fopt_threshold": pl.Float64,
    "n_as_good": pl.Int64,
    "q2": pl.Float64,
}
"""Columns of the identifiability."""

DISAGREEMENTS = {
    "spot": pl.String,
    "first": pl.String,
    "second": pl.String,
    "parameter": pl.String,
    "unit": pl.String,
    "first_optimum": pl.Float64,
    "second_optimum": pl.Float64,
}
"""Columns of the disagreements."""


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifiabilityResult:
    """Identifiability of the parameters of a sweep; without rows where it was not assessed.

    Parameters
    ----------
    identifiability : DataFrame
        One row per row of the selection and parameter, then those of all spots together: spot,
        scenario, parameter, unit, value (of the best set); optimum, where Fopt by emulated curves is
        least; lower and upper, the interval within the range; relative_width, its length over that of
        the range; identifiability, the word for it; most_correlated_with and correlation, the parameter
        that compensates for it best; fopt_threshold, the Fopt up to which a set is about as good (that
        least plus itself, or plus what the measured spread or the error of the emulator makes, whichever
        is more); n_as_good, sets of the sweep within it; q2, the share of variation that the emulator
        predicts at sets left out of it, null where there are too few sets for one. What is unknown is
        null, and its word is "unclear".
    disagreements : DataFrame
        One row per spot, pair of scenarios without a common channel that no set fits about as
        well as each alone, and parameter: spot, first and second (channels), parameter, unit,
        first_optimum and second_optimum.
    """

    identifiability: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=IDENTIFIABILITY))
    disagreements: pl.DataFrame = field(default_factory=lambda: pl.DataFrame(schema=DISAGREEMENTS))


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResult:
    """Parameters for which the simulated curves fit the measured ones best.

    Parameters
    ----------
    table : DataFrame
        One row per fit, scenario and spot: fit ("all spots" for a joint one, else the spot),
        scenario, spot, fopt, nmse_<channel>, r2_<channel>, n_evaluations, n_fine (simulations of
        finer meshes), n_runs (the others, without those that a fit before it had asked for), at_bound,
        message (why the search ended) and what was searched. A fit whose every evaluation failed has
        one row with its message.
    trace : DataFrame
        One row per evaluation: fit, scenario, search, correction (0 for the searches from the starts;
        each later one goes on from their end with other answers of the finer meshes), step, n_runs
        (by then, counted as in the table), fopt (null where it failed), objective (with priors),
        message and what was searched, under the names of the search.
    mesh : DataFrame
        Where finer meshes were simulated: fit, scenario, parameter, coarse (value by the coarse meshes
        alone) and corrected (by the finer ones, extrapolated to meshes without error).
    responses : mapping of (fit, scenario, spot) to Response
        Curves of the least Fopt at the measured abscissae.
    """

    table: pl.DataFrame = field(default_factory=pl.DataFrame)
    trace: pl.DataFrame = field(default_factory=pl.DataFrame)
    mesh: pl.DataFrame = field(default_factory=pl.DataFrame)
    responses: Mapping[tuple[str, str, str], Response] = field(default_factory=dict)
    certainty: CertaintyResult = field(default_factory=CertaintyResult)

    @property
    def estimates(self) -> pl.DataFrame:
        """The table with the values that are reported, and Fopt, NMSE and R² of these.

        Where there are intervals they weigh every curve by its error. ``fopt_least`` is that of the search.
        """
        table, known = self.table, self.certainty.intervals
        if "spot" not in table.columns:
            return table
        table = self._with_reported_errors(table.with_columns(fopt_least="fopt"))
        for parameter in known["parameter"].unique(maintain_order=True) if known.height else ():
            name = ParameterName.parse(parameter)
            values = known.filter(parameter=parameter).select("fit", "scenario", estimate="value")
            labels = [column for column in ("spot", "state") if column in table.columns]
            of_row = pl.any_horizontal(pl.lit(not name.spot), *(pl.col(each) == name.spot for each in labels))
            here = pl.col("estimate").is_not_null() & of_row.fill_null(False)
            table = (
                table.join(values, on=["fit", "scenario"], how="left", maintain_order="left")
                .with_columns(pl.when(here).then("estimate").otherwise(name.shared).alias(name.shared))
                .drop("estimate")
            )
        return table

    def _with_reported_errors(self, table: pl.DataFrame) -> pl.DataFrame:
        reported = self.certainty.reported
        if reported.is_empty():
            return table
        keys = ["fit", "scenario", "spot"]
        return table.update(reported, on=keys, how="left")

    @property
    def curves(self) -> Mapping[tuple[str, str, str], Response]:
        """Curves of the reported values at the measured abscissae, by fit, scenario and spot."""
        return {**self.responses, **responses_of(self.certainty.reported_curves)}

    @property
    def of_each_spot(self) -> pl.DataFrame:
        """Rows of the fits of one spot each that have a result."""
        if "spot" not in self.table.columns:
            return pl.DataFrame()
        return self.estimates.filter(pl.col("fit") == pl.col("spot")).drop_nulls("fopt")

    def of_spots(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Rows of :attr:`of_each_spot` by spot and scenario."""
        return {(row["spot"], row["scenario"]): row for row in self.of_each_spot.iter_rows(named=True)}

    @property
    def ends(self) -> pl.DataFrame:
        """One row per fit and scenario that has a result, with the fit as its spot.

        Of a joint fit the mean Fopt and NMSE and the least R² of its spots; null where else they differ.
        """
        if "spot" not in self.table.columns:
            return pl.DataFrame()
        rows = self.estimates.drop_nulls("fopt").with_columns(spot=pl.col("fit"))
        shared = pl.all().exclude("fit", "scenario", "^fopt.*$", "^nmse_.*$", "^r2_.*$")
        return rows.group_by("fit", "scenario", maintain_order=True).agg(
            pl.col("^fopt.*$", "^nmse_.*$").mean(),
            pl.col("^r2_.*$").min(),
            pl.when(shared.n_unique() == 1).then(shared.first()),
        )

    def joint(self, scenario: str) -> pl.DataFrame:
        """Rows of the joint fit in a scenario, one per spot; empty where there is none."""
        if "spot" not in self.table.columns:
            return pl.DataFrame()
        rows = self.estimates.filter(pl.col("scenario") == scenario, pl.col("fit") != pl.col("spot"))
        return rows.drop_nulls("fopt")

    def joint_values(self, scenario: str) -> dict[str, float]:
        """Values where the joint fit in a scenario has ended, by name as searched; empty where it has not.

        Of a study of one spot its fit is the joint one.
        """
        if self.trace.is_empty():
            return {}
        rows = self.trace.filter(pl.col("fopt").is_not_null(), scenario=scenario)
        joint = rows.filter(fit=ALL_SPOTS)
        rows = rows if joint.is_empty() else joint
        # Ends under different corrections cannot be compared: the last is the best known.
        ends = rows.filter(pl.col("correction") == pl.col("correction").max()).sort("objective")
        values = ends.head(1).select(pl.all().exclude(_OF_TRACE)).to_dicts()
        return {name: value for row in values for name, value in row.items() if value is not None}

    @property
    def found(self) -> set[tuple[str, str]]:
        """Spots and scenarios for which a fit has ended with a result."""
        if "spot" not in self.table.columns:
            return set()
        return set(self.table.drop_nulls("fopt").select("spot", "scenario").iter_rows())

    @property
    def failures(self) -> dict[tuple[str, str], str]:
        """Reasons why there is no result, by fit and scenario."""
        if self.table.is_empty():
            return {}
        failed = (
            self.table if "spot" not in self.table.columns else self.table.filter(pl.col("spot").is_null())
        )
        return {
            (fit, scenario): why for fit, scenario, why in failed.select("fit", "scenario", "message").rows()
        }

    def reason(self, spot: str, scenario: str) -> str:
        """Reason why no fit of a scenario has a result at a spot; empty where none was tried."""
        whys = (
            why for (fit, of), why in self.failures.items() if of == scenario and fit in (spot, ALL_SPOTS)
        )
        return next(whys, "")

    def mesh_errors(self, fit: str, scenario: str) -> dict[str, float]:
        """Shift of each parameter by the finer meshes.

        A fit that began with corrections found by another one does not show all that they move: the
        joint fit counts too, and where neither has any values, the most of all.
        """
        if self.mesh.is_empty():
            return {}
        own = self.mesh.filter(pl.col("fit").is_in([fit, ALL_SPOTS]), scenario=scenario)
        errors: dict[str, float] = {}
        for row in (self.mesh if own.is_empty() else own).iter_rows(named=True):
            name = ParameterName.parse(row["parameter"]).shared
            errors[name] = max(errors.get(name, 0.0), abs(row["coarse"] - row["corrected"]))
        return errors
