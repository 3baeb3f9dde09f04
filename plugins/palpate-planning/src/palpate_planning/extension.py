"""A study with one more press, from what was proposed and what was measured."""

import os
from pathlib import Path

from palpate.errors import StudyError
from palpate.run.atomic_files import write_atomically
from palpate.run.directory import RunDirectory
from palpate_planning.study_text import AddedPress, with_presses


def extended_study(run: Path, study: Path, press: str | None, measured: Path) -> tuple[str, Path]:
    """Write the study with a proposed press next to the study file.

    Parameters
    ----------
    run : Path
        A run directory with a proposal.
    study : Path
        Its study file.
    press : str, optional
        Name of a candidate of the proposal; the best one when left out.
    measured : Path
        File of the measured curves.

    Returns
    -------
    tuple of str and Path
        Name of the press, and the file of the study, ``<study>-<press>.toml``.

    Raises
    ------
    StudyError
        There is no such candidate, no file of measured curves, or a file where the study would go.
    """
    known = RunDirectory(run).proposal()
    spots = {row["press"]: row["spot"] for row in known["ranking"]}
    name = press or known["presses"][0]["press"]
    if name not in spots:
        raise StudyError(f"{run}: no candidate '{name}' was proposed (known: {', '.join(spots)})")
    if not measured.is_file():
        raise StudyError(f"{measured}: no such file; give the measured curves of the press")
    file = study.with_name(f"{study.stem}-{name}.toml")
    if file.exists():
        raise StudyError(f"{file}: exists and is not overwritten; move it, or run it as it is")
    path = Path(os.path.relpath(measured.resolve(), file.parent.resolve())).as_posix()
    added = AddedPress(name=name, spot=spots[name], protocol=known["protocols"][name], measured=path)
    text = with_presses(study.read_text(encoding="utf-8-sig"), [added])
    write_atomically(file, text.encode())
    return name, file
