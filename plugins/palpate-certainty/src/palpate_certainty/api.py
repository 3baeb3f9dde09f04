"""Names that other plugins may import of palpate-certainty; each is imported when it is first used."""

from typing import TYPE_CHECKING

from palpate.api import deferred

if TYPE_CHECKING:
    from palpate_certainty.anatomy import OF_LIMB as OF_LIMB
    from palpate_certainty.assumptions import ASSUMED as ASSUMED
    from palpate_certainty.between_spots import (
        SPOTS as SPOTS,
        SpotDifferences as SpotDifferences,
        freedom_of as freedom_of,
    )
    from palpate_certainty.curve_coordinates import CurveCoordinates as CurveCoordinates
    from palpate_certainty.emulator import GaussianProcess as GaussianProcess
    from palpate_certainty.error_sources import (
        MESH as MESH,
        Columns as Columns,
        ErrorSource as ErrorSource,
        columns_of as columns_of,
        error_budget as error_budget,
        error_sources_of as error_sources_of,
        n_differences as n_differences,
    )
    from palpate_certainty.laplace import (
        FLAT_SD as FLAT_SD,
        N_DRAWS as N_DRAWS,
        RANGE_SD as RANGE_SD,
        Density as Density,
        Laplace as Laplace,
        wider as wider,
    )
    from palpate_certainty.linear_problem import LinearProblem as LinearProblem, linearised as linearised
    from palpate_certainty.mesh_error import SpotMesh as SpotMesh, usual_error as usual_error
    from palpate_certainty.noise_model import (
        ResidualLayout as ResidualLayout,
        layout_of as layout_of,
        matern as matern,
    )
    from palpate_certainty.stages import joint_assessed as joint_assessed, spot_meshes as spot_meshes
    from palpate_certainty.tables import Assessed as Assessed, density_of as density_of

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
