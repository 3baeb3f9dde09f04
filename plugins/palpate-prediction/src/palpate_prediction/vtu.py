"""The skin as a VTU file, which ParaView reads: triangles with displacement, pressure and shear."""

from collections.abc import Mapping

import numpy as np

from palpate.api import FloatArray, IntArray, SurfaceStates

_TRIANGLE = 5
"""VTK's number of a triangle."""


def vtu(states: SurfaceStates, state: int) -> bytes:
    """Content of a file of one state; points are those of the undeformed limb."""
    fields = {
        "displacement_mm": states.displacements_mm[state],
        "contact_pressure_MPa": states.pressures_MPa[state],
        "contact_shear_MPa": states.shears_MPa[state],
        "touching": states.touching[state],
    }
    n, m = len(states.points_mm), len(states.triangles)
    return (
        '<?xml version="1.0"?>\n<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian">\n'
        f'<UnstructuredGrid><Piece NumberOfPoints="{n}" NumberOfCells="{m}">\n'
        f"<Points>\n{_array('points', states.points_mm)}</Points>\n"
        f"<Cells>\n{_cells(states.triangles)}</Cells>\n"
        f"<PointData>\n{_data(fields)}</PointData>\n"
        "</Piece></UnstructuredGrid></VTKFile>\n"
    ).encode()


def _cells(triangles: IntArray) -> str:
    m = len(triangles)
    return "".join(
        _array(name, values, kind)
        for name, values, kind in (
            ("connectivity", triangles, "Int64"),
            ("offsets", 3 * np.arange(1, m + 1), "Int64"),
            ("types", np.full(m, _TRIANGLE), "UInt8"),
        )
    )


def _data(fields: Mapping[str, FloatArray]) -> str:
    return "".join(_array(name, values) for name, values in fields.items())


def _array(name: str, values: FloatArray | IntArray, kind: str = "Float32") -> str:
    parts = values.shape[1] if values.ndim == 2 and kind == "Float32" else 1
    text = " ".join(f"{value:.7g}" for value in values.ravel().tolist())
    head = f'<DataArray type="{kind}" Name="{name}" NumberOfComponents="{parts}" format="ascii">'
    return f"{head}{text}</DataArray>\n"
