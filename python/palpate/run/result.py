"""What a run read, chose and wrote: the values that the stages hand on."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import polars as pl

from palpate.domain import Design, Limb, Response


@dataclass(frozen=True, slots=True, kw_only=True)
class StudyInputs:
    """A study whose files have been read and found usable.

    Parameters
    ----------
    measured, limbs : mapping of spot name to Response, Limb
        ``limbs`` is empty where the solver needs none.
    design : Design
    warnings : tuple of str
        What is odd about the study or its curves, and stops nothing.
    of_last_sweep : bool
        Whether its simulations are those of the folder's last sweep, whatever the meshes are now.
    """

    measured: Mapping[str, Response]
    limbs: Mapping[str, Limb]
    design: Design
    warnings: tuple[str, ...] = ()
    of_last_sweep: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class SelectionResult:
    """What identification chose.

    Parameters
    ----------
    selection : DataFrame
        One row per spot and scenario: spot, scenario, set_id, fopt, nmse_<channel>,
        r2_<channel>, <region.parameter>.
    generalisation : DataFrame
        One row per spot for the one set with the least mean Fopt over the spots; empty
        when no set succeeded at every spot.
    refinement : DataFrame
        Rows of the local search that started from each selected set; empty without one.
    stiffness_scaling : DataFrame
        Best multiple of any set by spot and scenario, as
        :func:`palpate.stages.stiffness_scaling.best_scaled_sets` returns it; empty unless asked for.
    verification : DataFrame
        Which selected sets passed the solver's verification, as
        :func:`palpate.stages.verification.verify` returns it; empty where the solver has none.
    without_result : mapping of (spot, scenario) to str
        Why no set could be selected there; empty where every scenario has a set at every spot.
    """

    selection: pl.DataFrame
    generalisation: pl.DataFrame
    refinement: pl.DataFrame
    stiffness_scaling: pl.DataFrame = field(default_factory=pl.DataFrame)
    verification: pl.DataFrame = field(default_factory=pl.DataFrame)
    without_result: Mapping[tuple[str, str], str] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class FitResult:
    """Where the local searches ended.

    Parameters
    ----------
    table : DataFrame
        One row per row of the selection: spot, scenario, start_set_id, start_fopt, fopt,
        nmse_<channel>, r2_<channel>, n_simulations, message and <region.parameter>. All but
        the start and the message are null where the start could not be simulated again.
    responses : mapping of (spot, scenario) to Response
        Simulated curves of each row.
    """

    table: pl.DataFrame
    responses: Mapping[tuple[str, str], Response]
