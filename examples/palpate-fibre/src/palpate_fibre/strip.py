"""Files of a tensile testing machine."""

from pathlib import Path

import numpy as np

from palpate.api import Curve, CurveError, ExperimentLoader, FloatArray, Response

NEEDED = ("gauge_length_mm", "area_mm2")


class Strip(ExperimentLoader):
    """Force over extension of one specimen, as nominal stress over stretch.

    A preamble of ``key: value`` names at least ``gauge_length_mm`` and ``area_mm2`` (the undeformed
    cross-section); rows of ``extension_mm force_N`` follow, in the order travelled. The study says
    which test it is: ``measured = { uniaxial = "strip.txt" }``.
    """

    name = "strip"
    summary = "force over extension from a tensile testing machine, with the specimen's size in the preamble"

    def load(self, path: Path, channel: str | None = None) -> Response:
        """Read one file.

        Raises
        ------
        CurveError
            Naming file and row.
        """
        if channel is None:
            raise CurveError(f'{path}: say which test it is, as in measured = {{ uniaxial = "{path.name}" }}')
        size, rows = _read(path)
        stretch = 1.0 + rows[:, 0] / size["gauge_length_mm"]
        try:
            curve = Curve(channel=channel, abscissa=stretch, ordinate=rows[:, 1] / size["area_mm2"])
        except CurveError as error:
            raise CurveError(f"{path}: {error}") from None
        return Response(curves={channel: curve}, record=size)


def _read(path: Path) -> tuple[dict[str, float], FloatArray]:
    """Read the numbers of the preamble, and the rows (n, 2)."""
    try:
        lines = path.read_text(encoding="utf-8").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CurveError(f"{path}: cannot be read ({error}); give a text file in UTF-8") from None
    size: dict[str, float] = {}
    rows: list[tuple[float, float]] = []
    for number, line in enumerate(lines, start=1):
        key, colon, value = line.partition(":")
        where = f"{path}, row {number}: '{line[:40]}'"
        if colon and not rows:
            if key.strip() in NEEDED:
                size[key.strip()] = _positive(value, where)
        elif line.strip():
            rows.append(_pair(line, where))
    if missing := [key for key in NEEDED if key not in size]:
        raise CurveError(f"{path}: the preamble lacks {missing[0]}; add a line such as {missing[0]}: 20")
    return size, np.array(rows, dtype=np.float64).reshape(-1, 2)


def _positive(text: str, where: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise CurveError(f"{where} holds no number; write e.g. gauge_length_mm: 20") from None
    if not 0.0 < value < float("inf"):
        raise CurveError(f"{where}: a size must be greater than zero; measure the specimen")
    return value


def _pair(line: str, where: str) -> tuple[float, float]:
    try:
        extension, force = map(float, line.split())
    except ValueError:
        raise CurveError(f"{where} is no pair of extension_mm and force_N; fix the row") from None
    return extension, force
