"""Values that the shell completes: ready studies, kinds and names of components, studies and runs."""

from collections.abc import Iterable
from pathlib import Path

import typer

from palpate.cli.runs import FOLDER, STUDY_FILE, runs_in
from palpate.cli.session import Session


def matching(values: Iterable[object], incomplete: str) -> list[str]:
    """Values that begin with what is typed."""
    return [text for text in map(str, values) if text.startswith(incomplete)]


def ready_studies(context: typer.Context, incomplete: str) -> list[str]:
    """Names of ready studies."""
    return matching(Session.of(context).only("studies").studies, incomplete)


def kinds(incomplete: str) -> list[str]:
    """Kinds of components, and commands."""
    from palpate.cli.plugins import COMMANDS
    from palpate.plugins.registry import KINDS

    return matching([*KINDS, COMMANDS], incomplete)


def components(context: typer.Context, incomplete: str) -> list[str]:
    """Names of the kind that the word before gives."""
    from palpate.plugins.registry import KINDS

    kind = str(context.params.get("kind") or "").replace("-", "_")
    return matching(Session.of(context).only(kind).catalogue(kind) if kind in KINDS else (), incomplete)


def templates(incomplete: str) -> list[str]:
    """Kinds of plugins that can be made."""
    from palpate.plugins.scaffold import KITS

    return matching(KITS, incomplete)


def runs(incomplete: str) -> list[str]:
    """Run directories in the folder that is typed, the newest first; in runs/ where none is."""
    folder = _folder(incomplete)
    return matching(runs_in(FOLDER if folder == Path() else folder), incomplete)


def studies(incomplete: str) -> list[str]:
    """Folders that hold a study, in the folder that is typed."""
    from palpate.run.ownership import is_run

    found = sorted(file.parent for file in _folder(incomplete).glob(f"*/{STUDY_FILE}"))
    return matching((folder for folder in found if not is_run(folder)), incomplete)


def studies_and_runs(incomplete: str) -> list[str]:
    """Folders that hold a study, then run directories."""
    return [*studies(incomplete), *runs(incomplete)]


def _folder(incomplete: str) -> Path:
    return Path(incomplete) if incomplete.endswith("/") else Path(incomplete).parent
