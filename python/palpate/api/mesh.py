"""Meshes: topology, shape functions, supports of a file, the frame of a spot, and blocks for tests."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.limb.inspection import (
        guessed_unit as guessed_unit,
        inspected as inspected,
        likely_sets as likely_sets,
        region_name as region_name,
        skin_of as skin_of,
    )
    from palpate.limb.supports import FixedNodes as FixedNodes, Support as Support, fixed_nodes as fixed_nodes
    from palpate.mesh.layers import (
        layer_of as layer_of,
        nodes_of_regions as nodes_of_regions,
        surface_normals as surface_normals,
    )
    from palpate.mesh.refinement import (
        EDGE_OVER_REACH as EDGE_OVER_REACH,
        automatic_edge_mm as automatic_edge_mm,
        refined as refined,
    )
    from palpate.mesh.specimens import (
        block as block,
        cylinder as cylinder,
        half_space as half_space,
        layer as layer,
    )
    from palpate.mesh.splitting import SOLIDS as SOLIDS, Cut as Cut, curved as curved, cut as cut
    from palpate.mesh.spot_frame import (
        NEAR as NEAR,
        RIM as RIM,
        SpotWrench as SpotWrench,
        contact_edge_mm as contact_edge_mm,
        in_spot_frame as in_spot_frame,
        indentation_of as indentation_of,
        pose_of as pose_of,
        spot_axes as spot_axes,
    )
    from palpate.mesh.topology import (
        CELLS as CELLS,
        CUBE as CUBE,
        HEX_CORNERS as HEX_CORNERS,
        SIX_TETS as SIX_TETS,
        SLOPES as SLOPES,
        barycentric as barycentric,
        linear_simplex as linear_simplex,
        multilinear as multilinear,
        outer_faces as outer_faces,
        quadratic_simplex as quadratic_simplex,
        surface_faces as surface_faces,
        triangles_of as triangles_of,
        with_midpoints as with_midpoints,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
