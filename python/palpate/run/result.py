"""Values that the stages of a run hand on: what it read, chose and wrote."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from statistics import NormalDist
from typing import Any

import polars as pl

from palpate.domain import Design, Job, Limb, ParameterName, Response
from palpate.run.result_files import responses_of
from palpate.run.tables import ASSESSED, DECLARED, OF_A_FIT

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
    jobs : sequence of Job
        Jobs of the sweep where they have been checked.
    edges_mm : mapping of spot name to float
        Longest edges under the indenter of finer meshes that the run has chosen by itself.
    """

    measured: Mapping[str, Response]
    limbs: Mapping[str, Limb]
    design: Design
    warnings: tuple[str, ...] = ()
    jobs: Sequence[Job] = ()
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

FIRST_ANSWER = "first answer"
"""Stage after the first fit, and key of its result among what stages of one run share."""

UNSETTLED = "the correction by finer meshes has not settled"
"""Message of a fit whose corrections were not near enough to its end."""

UNSEEN = "no curve"
"""Beginning of messages on values that no curve decides."""

WIDENED = "range of"
"""Beginning of messages on ranges that a fit has widened, where it ended at their ends."""


INCLUDED = "included"
"""Status of a cause that intervals include."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResult:
    """Parameters for which the simulated curves fit the measured ones best.

    Parameters
    ----------
    table, trace, mesh : DataFrame
        Tables ``fit``, ``fit_trace`` and ``fit_mesh`` of :data:`palpate.run.tables.DECLARED`. A fit whose
        every evaluation failed has one row with its message.
    responses : mapping of (fit, scenario, spot) to Response
        Curves of the least Fopt at the measured abscissae.
    intervals, adequacy, reported, reported_curves : DataFrame
        As in :data:`palpate.run.tables.ASSESSED`; without rows where no stage has assessed the fit.
    """

    table: pl.DataFrame = field(default_factory=DECLARED["fit"]["fit"].empty)
    trace: pl.DataFrame = field(default_factory=DECLARED["fit"]["fit_trace"].empty)
    mesh: pl.DataFrame = field(default_factory=DECLARED["fit"]["fit_mesh"].empty)
    responses: Mapping[tuple[str, str, str], Response] = field(default_factory=dict)
    intervals: pl.DataFrame = field(default_factory=ASSESSED["intervals"].empty)
    adequacy: pl.DataFrame = field(default_factory=ASSESSED["adequacy"].empty)
    reported: pl.DataFrame = field(default_factory=ASSESSED["reported"].empty)
    reported_curves: pl.DataFrame = field(default_factory=ASSESSED["reported_curves"].empty)

    def without_assessment(self) -> "FitResult":
        """The fit as its search has ended."""
        none: dict[str, Any] = {name: ASSESSED[name].empty() for name in OF_A_FIT}
        return replace(self, **none)

    @property
    def estimates(self) -> pl.DataFrame:
        """The table with the values that are reported, and Fopt, NMSE and R² of these.

        Where there are intervals they weigh every curve by its error. ``fopt_least`` is the search's.
        """
        known, keys = self.intervals, ["fit", "scenario", "spot"]
        table = self.table.with_columns(fopt_least="fopt").update(self.reported, on=keys, how="left")
        for parameter in known["parameter"].unique(maintain_order=True):
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

    @property
    def curves(self) -> Mapping[tuple[str, str, str], Response]:
        """Curves of the reported values at the measured abscissae, by fit, scenario and spot."""
        return {**self.responses, **responses_of(self.reported_curves)}

    @property
    def of_each_spot(self) -> pl.DataFrame:
        """Rows of the fits of one spot each that have a result."""
        return self.estimates.filter(pl.col("fit") == pl.col("spot")).drop_nulls("fopt")

    def of_spots(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Rows of :attr:`of_each_spot` by spot and scenario."""
        return {(row["spot"], row["scenario"]): row for row in self.of_each_spot.iter_rows(named=True)}

    @property
    def ends(self) -> pl.DataFrame:
        """One row per fit and scenario that has a result, with the fit as its spot.

        Of a joint fit the mean Fopt and NMSE and the least R² of its spots; null where else they differ.
        """
        rows = self.estimates.drop_nulls("fopt").with_columns(spot=pl.col("fit"))
        shared = pl.all().exclude("fit", "scenario", "^fopt.*$", "^nmse_.*$", "^r2_.*$")
        return rows.group_by("fit", "scenario", maintain_order=True).agg(
            pl.col("^fopt.*$", "^nmse_.*$").mean(),
            pl.col("^r2_.*$").min(),
            pl.when(shared.n_unique() == 1).then(shared.first()),
        )

    def joint(self, scenario: str) -> pl.DataFrame:
        """Rows of the joint fit in a scenario, one per spot; empty where there is none."""
        rows = self.estimates.filter(pl.col("scenario") == scenario, pl.col("fit") != pl.col("spot"))
        return rows.drop_nulls("fopt")

    def joint_values(self, scenario: str) -> dict[str, float]:
        """Values where the joint fit in a scenario has ended, by name as searched; empty where it has not.

        Of a study of one spot its fit is the joint one.
        """
        rows = self.trace.filter(pl.col("fopt").is_not_null(), scenario=scenario)
        joint = rows.filter(fit=ALL_SPOTS)
        rows = rows if joint.is_empty() else joint
        # Ends under different corrections cannot be compared: the last is the best known.
        ends = rows.filter(pl.col("correction") == pl.col("correction").max()).sort("objective")
        others = ("fit", "scenario", "search", "correction", "step", "n_runs", "fopt", "objective", "message")
        values = ends.head(1).select(pl.all().exclude(others)).to_dicts()
        return {name: value for row in values for name, value in row.items() if value is not None}

    @property
    def found(self) -> set[tuple[str, str]]:
        """Spots and scenarios for which a fit has ended with a result."""
        return set(self.table.drop_nulls("fopt").select("spot", "scenario").iter_rows())

    @property
    def failures(self) -> dict[tuple[str, str], str]:
        """Reasons why there is no result, by fit and scenario."""
        failed = self.table.filter(pl.col("spot").is_null())
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
        own = self.mesh.filter(pl.col("fit").is_in([fit, ALL_SPOTS]), scenario=scenario)
        errors: dict[str, float] = {}
        for row in (self.mesh if own.is_empty() else own).iter_rows(named=True):
            name = ParameterName.parse(row["parameter"]).shared
            errors[name] = max(errors.get(name, 0.0), abs(row["coarse"] - row["corrected"]))
        return errors
