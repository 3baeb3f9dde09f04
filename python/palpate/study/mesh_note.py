"""The note that whoever made a mesh left next to it."""

import json
from pathlib import Path
from typing import Any

from palpate.errors import MeshError
from palpate.study.plain_values import MOST_BYTES, check_plain


def mesh_note(mesh: Path) -> dict[str, Any] | None:
    """The note of a mesh by whoever made it, ``<mesh>.json``; None without one.

    A MeshError where it is no JSON object, larger than 1 MB, or holds what JSON or a terminal does not take.
    """
    note_file = mesh.with_suffix(".json")
    if not note_file.is_file():
        return None
    try:
        if note_file.stat().st_size > MOST_BYTES:
            raise ValueError("larger than 1 MB")
        note = json.loads(note_file.read_text(encoding="utf-8"))
        if not isinstance(note, dict):
            raise ValueError("not an object")
        check_plain(note)
        json.dumps(note, allow_nan=False)
    except (ValueError, RecursionError, OSError) as error:
        raise MeshError(
            f"{note_file}: not a note on the mesh of that name ({error}); write it again, or move it away"
        ) from error
    return note
