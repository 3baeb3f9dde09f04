"""Run directories as arguments: which one is meant, and whether its plugin files may be executed."""

import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from palpate.cli.session import Session
from palpate.errors import StudyError, typed

if TYPE_CHECKING:
    from palpate.study.reading import Study

STUDY_FILE = "study.toml"
"""File of a study in its folder."""

FOLDER = Path("runs")
"""Where runs go that are given no other folder."""


def find_run(given: Path | None) -> Path:
    """Run directory that is meant: a given one, the newest of a given study, or the newest in runs/.

    Raises
    ------
    StudyError
        There is none.
    """
    if given is None:
        found, missing = next(iter(runs_in(FOLDER)), None), f"{FOLDER}/ holds no run; name one"
    elif not is_study(given):
        return given
    else:
        found = newest_run(given)
        missing = f"{given}: a study, of which runs/ holds no run; name its run directory"
    if found is None:
        raise StudyError(missing)
    return found


def newest_run(study: Path) -> Path | None:
    """Newest run of a study in runs/, here or next to the study; None where there is none."""
    file = _study_file(study)
    places = (file.parent / FOLDER, FOLDER)
    found = [run for place in places for run in runs_in(place) if is_of(run, file)]
    return max(found, key=_written, default=None)


def is_study(given: Path) -> bool:
    """Whether a study is given, as a file or its folder, and not a run directory."""
    from palpate.run.ownership import is_run

    return not is_run(given) and _study_file(given).is_file()


def _study_file(given: Path) -> Path:
    return given if given.is_file() else given / STUDY_FILE


def runs_in(folder: Path) -> list[Path]:
    """Run directories in a folder, the newest first."""
    from palpate.run.ownership import is_run

    found = folder.iterdir() if folder.is_dir() else ()
    return sorted((path for path in found if path.is_dir() and is_run(path)), key=_written, reverse=True)


def is_of(run: Path, study: Path) -> bool:
    """Whether a run directory was written for a study file."""
    from palpate.run.directory import RunDirectory

    try:
        return run.joinpath(RunDirectory(run).manifest()["study_file"]).samefile(study)
    except (StudyError, OSError):
        return False


def _written(run: Path) -> float:
    return max(path.stat().st_mtime for path in run.iterdir())


def session_of_run(session: Session, run: Path, named: Iterable[Path], *, trust: bool) -> Session:
    """Session with the plugin files that a received run names, once the user trusts them.

    A file given with ``--plugin`` is trusted, and is used instead of a named one of the same file name. A
    StudyError where a file is missing, or nobody can be asked whether to execute it.
    """
    given = {file.name for file in session.files}
    command = shlex.join(session.arguments) or f"run {typed(run)}"
    others = list(dict.fromkeys(file.resolve() for file in named if file.name not in given))
    for file in others:
        if not file.is_file():
            raise StudyError(
                f"{file}: a plugin file of this run is not there any more; name it: "
                f"palpate --plugin {typed(Path(file.name))} {command}"
            )
    if others and not trust:
        lines = [f"{run} names plugin files, which are programs:", *(f"  {file}" for file in others)]
        call = " ".join([*(f"--plugin {typed(file)}" for file in others), command])
        remedy = f"look at them; then use --trust-plugins, or name them: palpate {call}"
        session.confirm("\n".join(lines), "execute them?", remedy)
    return Session((*session.files, *others), session.without, session.make_app, session.given)


def study_of_run(session: Session, run: Path, *, trust: bool) -> tuple[Session, "Study"]:
    """Read a run's own copy of its study, and a session with the plugins that it was run with.

    Raises
    ------
    StudyError
        The copy cannot be read, or its plugin files are missing or not trusted.
    """
    from palpate.run.directory import RunDirectory
    from palpate.stages.saved_run import copied_study

    named = plugins_of(run, RunDirectory(run).manifest())
    found = session_of_run(session, run, named, trust=trust)
    return found, copied_study(run, found.plugins)


def original_study(
    session: Session, run: Path, *, trust: bool, moved: Path | None = None
) -> tuple[Session, Path]:
    """Session with the plugin files of a run, and the study file that it was made from.

    Where that file is not there any more, it is the copy that the run keeps.

    Raises
    ------
    StudyError
        The study file or a plugin file is not there any more, or plugin files are not trusted.
    """
    from palpate.run.directory import RunDirectory
    from palpate.run.kept_inputs import study_file
    from palpate.study.reading import study_plugins

    manifest = RunDirectory(run).manifest()
    file, original = study_file(run, manifest), run / manifest["study_file"]
    if moved:
        file = _study_file(moved)
    elif file != original:
        session.note(f"{original.name} is not where it was; the copy in the run is used: {file}")
    named = plugins_of(run, manifest)
    if not file.is_file():
        raise StudyError(
            f"{file}: the study file of this run is not there any more; put it back, with its meshes, or "
            f"name it once: palpate run {typed(run)} --study FILE"
        )
    named += [] if moved else study_plugins(file)
    return session_of_run(session, run, named, trust=trust), file.resolve()


def plugins_of(run: Path, manifest: Mapping[str, Any]) -> list[Path]:
    """Plugin files that the manifest of a run names; where one is gone, its copy in the run."""
    from palpate.run.kept_inputs import kept_plugin, kept_study
    from palpate.study.reading import study_plugins

    kept = kept_study(run, manifest)
    copies = {file.name: file for file in study_plugins(kept)} if kept else {}
    found = []
    for number, file in enumerate(run / name for name in manifest["plugin_files"]):
        copy = kept_plugin(run, number, file)
        found.append(file if file.is_file() else copy if copy.is_file() else copies.get(file.name, copy))
    return found
