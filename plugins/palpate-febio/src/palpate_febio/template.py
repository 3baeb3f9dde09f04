"""A deck of the user's own, with placeholders that palpate fills in.

A placeholder is a name in double braces. What a template must have:

==================== =====================================================
``{{region.name}}``  each number that palpate gives FEBio, by FEBio's name of it
                     (``{{soft_tissue.c1}}``, ``{{soft_tissue.k}}``)
``{{depth}}``        points of the load curve of the depth [mm] over time
``{{rotation}}``     points of the load curve of the rotation [radians]
``{{steps}}``        points of the curve of the must-points, and
``{{n_steps}}``      how many steps there are, each of length 1
``{{record}}``       name of the record of the indenter's rigid body, with the data
                     ``z;thz;Fx;Fy;Fz;Mx;My;Mz``
==================== =====================================================

``{{friction}}`` may stand where the coefficient belongs.
"""

import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from palpate.api import StudyError
from palpate_febio.deck import RECORD_DATA, RECORD_NAME, points_of
from palpate_febio.deck_reader import refuse_reaching
from palpate_febio.safe_xml import parse_xml
from palpate_febio.spelling import Written
from palpate_febio.steps import Steps

OPTIONAL = frozenset({"friction"})

_PLACEHOLDER = re.compile(r"\{\{\s*([A-Za-z0-9_.\- ]+?)\s*\}\}")


def fill_template(path: Path, materials: Mapping[str, Written], steps: Steps, friction: float) -> bytes:
    """The user's deck with every placeholder replaced.

    Parameters
    ----------
    path : Path
    materials : mapping of region to Written
    steps : Steps
    friction : float

    Raises
    ------
    StudyError
        The template is missing, lacks a placeholder, has one that palpate does not
        know, or does not record the indenter.
    MeshError
        It is not XML that can be read safely, or names files outside of its folder.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{path}: template cannot be read ({error}); correct the setting template") from None
    values = _values(materials, steps, friction)
    found = set(_PLACEHOLDER.findall(text))
    if unknown := sorted(found - set(values)):
        raise StudyError(
            f"{path}: line {_line(text, unknown[0])}: placeholder '{unknown[0]}' is not known; palpate "
            f"fills in "
            f"{', '.join(values)}"
        )
    if missing := [name for name in values if name not in found | OPTIONAL]:
        raise StudyError(
            f"{path}: the template lacks the placeholder{'s' * (len(missing) > 1)} "
            f"{', '.join('{{' + name + '}}' for name in missing)}; without them every set would be "
            f"simulated alike"
        )
    filled = _PLACEHOLDER.sub(lambda match: values[match.group(1)], text).encode("utf-8")
    root = parse_xml(path, filled)
    refuse_reaching(path, root)
    wanted = ";".join(RECORD_DATA)
    records = root.findall("Output/logfile/rigid_body_data")
    if not any(e.get("file") == RECORD_NAME and e.get("data") == wanted for e in records):
        raise StudyError(
            f"{path}: no record of the indenter; add to Output/logfile: "
            f'<rigid_body_data data="{wanted}" delim="," file="{{{{record}}}}">number of its '
            f"material</rigid_body_data>"
        )
    return filled


def _values(materials: Mapping[str, Written], steps: Steps, friction: float) -> dict[str, str]:
    values = {
        f"{region}.{name}": format(value, ".12g")
        for region, material in materials.items()
        for name, value in material.values
    }
    curves = (
        ("depth", steps.depth_mm),
        ("rotation", np.deg2rad(steps.rotation_deg)),
        ("steps", np.ones(steps.n + 1)),
    )
    for name, curve in curves:
        values[name] = "".join(f"<pt>{point}</pt>" for point in points_of(curve))
    return {**values, "n_steps": str(steps.n), "record": RECORD_NAME, "friction": format(friction, ".12g")}


def _line(text: str, placeholder: str) -> int:
    place = re.search(r"\{\{\s*" + re.escape(placeholder), text)
    return text.count("\n", 0, place.start() if place else 0) + 1
