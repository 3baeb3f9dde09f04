"""State of one call of the command line: its plugins, and where it writes."""

import re
import sys
import textwrap
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from time import process_time
from typing import TYPE_CHECKING, Any, cast

import typer

from palpate.errors import PluginError, StudyError, typed

if TYPE_CHECKING:
    import polars as pl
    from rich.console import Console

    from palpate.plugins.catalogue import Plugins
    from palpate.plugins.guard import BrokenPlugin
    from palpate.study.reading import Study

MAX_ROWS = 30
"""Longest table that is shown whole; files hold the rest."""

TEXT_WIDTH = 80
"""Most columns of a line of running text."""

LABEL_WIDTH = 12
"""Columns of the label of a line."""


class Session:
    """Plugins loaded once, results to stdout, everything else to stderr.

    Parameters
    ----------
    files : sequence of Path
        One-file plugins.
    without : sequence of str
        Installed plugins to leave out.
    make_app : callable
        Builds the application with the core's commands, to which plugins add theirs.
    given : sequence of Path, optional
        Files that the command line names: no other one is refused because it is broken.
    """

    def __init__(
        self,
        files: Sequence[Path] = (),
        without: Sequence[str] = (),
        make_app: Callable[[], typer.Typer] = typer.Typer,
        given: Sequence[Path] | None = None,
    ) -> None:
        self.files = tuple(files)
        self.given = self.files if given is None else tuple(given)
        self.without = tuple(without)
        self.make_app = make_app
        self.arguments: tuple[str, ...] = ()
        """Command that runs and what follows it, as typed, without the options ``--plugin``."""
        self.asked: Path | None = None
        """Study that was read last."""
        self.usual_out = ""
        """Option ``--out`` with the folder of its run, as it is without the option."""
        self.began_processor_s = process_time()
        """Processor time of this process when the command began."""

    @classmethod
    def of(cls, context: typer.Context) -> "Session":
        """Session of the running command."""
        return cast("Session", context.obj)

    @cached_property
    def plugins(self) -> "Plugins":
        """Everything that plugins provide; a broken one is mentioned once, or refused (`refuse_broken`)."""
        plugins = self.with_broken
        self.refuse_broken(plugins.broken)
        return plugins

    @cached_property
    def with_broken(self) -> "Plugins":
        """The same for a command that shows what is broken, files included."""
        from palpate.plugins.catalogue import Plugins

        return Plugins.load(self.files, without=self.without)

    def only(self, kind: str) -> "Plugins":
        """Components of one kind alone, which is quicker; broken plugins are left out silently."""
        from palpate.plugins.catalogue import Plugins

        return Plugins.load(self.files, without=self.without, kinds=(kind,))

    def refuse_broken(self, broken: Iterable["BrokenPlugin"]) -> None:
        """Mention broken plugins on stderr.

        Raises
        ------
        PluginError
            One of them is a file that the command line names.
        """
        for each in broken:
            if not each.component and each.source in map(str, map(Path.resolve, self.given)):
                remedy = f"correct it (palpate --plugin {each.source} plugins --traceback shows the calls)"
                raise PluginError(f"plugin file {each.source}: {each.reason}; {remedy}")
            label, rest = each.headline.split(":", 1)
            self.note(f"[yellow]{label}:[/]{_escaped(rest)}")

    @cached_property
    def stdout(self) -> "Console":
        """Stream of results."""
        console = _console()
        if not console.is_terminal:
            console.width = 200  # of a table that goes to a file or a pipe
        return console

    @cached_property
    def stderr(self) -> "Console":
        """Stream of progress and notes."""
        return _console(stderr=True)

    def study(self, path: Path, *, need_measured: bool = True) -> "Study":
        """Read and check a study file; its own plugin files join the files of this session."""
        from palpate.study.reading import read_study, with_study_plugins

        _refuse_run(path)
        self.asked = path
        known = self.plugins.broken
        self.plugins = with_study_plugins(path, self.plugins)
        self.refuse_broken(each for each in self.plugins.broken if each not in known)
        study = read_study(path, self.plugins, need_measured=need_measured)
        self.usual_out = f" --out {typed(run_folder(study, None))}"
        return study

    def note(self, text: str) -> None:
        """Print a message to stderr (rich markup)."""
        self.stderr.print(text)

    def confirm(self, text: str, question: str, otherwise: str) -> None:
        """Ask whether to go on, and stop if not.

        Raises
        ------
        StudyError
            Nobody can be asked; with the text, and what to do otherwise.
        """
        if not (sys.stdin.isatty() and self.stderr.is_terminal):
            raise StudyError(f"{text}\n{otherwise}")
        typer.confirm(f"{text}\n{question}", abort=True, err=True)

    def next(self, command: str, before: str = "", **paths: Path | None) -> None:
        """Print the command to run next, with the plugin files of this one; a path is named in braces."""
        command = command.format(**{name: typed(path) for name, path in paths.items() if path})
        self.stderr.print(f"{before}next: palpate {self._options}{command}", markup=False)

    def addressed(self, text: str) -> str:
        """Message whose commands on ``STUDY`` are those on the study that was read, with its plugins."""
        if self.asked is None:
            return text
        study = typed(self.asked)

        def command(found: re.Match[str]) -> str:
            options = found[2].removesuffix(self.usual_out)
            return f"`palpate {self._options}{found[1]}{study}{options}`"

        return re.sub(r"`palpate ([^`]* )STUDY((?: [^`]*)?)`", command, text)

    @property
    def _options(self) -> str:
        """Options by which another call has the plugins of this one."""
        options = [f"--plugin {typed(file)} " for file in self.files]
        return "".join([*options, *(f"--no-plugin {name} " for name in self.without)])

    def say(self, text: str) -> None:
        """Print a line of the result, without markup."""
        self.stdout.print(text, markup=False)

    def labelled(self, label: str, text: str) -> None:
        """Print text after its label: in lines of a terminal's width, in one line to a file."""
        line = f"{label:<{LABEL_WIDTH}}{text}"
        indent = " " * LABEL_WIDTH
        if self.stdout.is_terminal:
            width = max(2 * LABEL_WIDTH, self.stdout.width)
            line = textwrap.fill(
                line, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
            )
        self.say(line)

    def paragraph(self, text: str) -> None:
        """Print running text, broken between words into lines that can be read."""
        width = min(self.stdout.width, TEXT_WIDTH)
        self.say(textwrap.fill(text, width, break_long_words=False, break_on_hyphens=False))

    def json(self, value: object) -> None:
        """Print a value as JSON; numbers that are not finite become null."""
        from pydantic_core import to_json

        def plain(other: object) -> object:
            return dict(other) if isinstance(other, Mapping) else str(other)

        text = to_json(value, indent=2, inf_nan_mode="null", fallback=plain)
        typer.echo(visible(text.decode()))

    def frame(self, title: str, frame: "pl.DataFrame") -> None:
        """Print a data frame as a table; a wide one of few rows is transposed."""
        from palpate.plugins.sections import heading, rounded_rows, shown

        heads = tuple(map(heading, frame.columns))
        rows = [tuple(map(shown, row)) for row in rounded_rows(frame.head(MAX_ROWS))]
        widths = [max(map(len, column)) + 3 for column in zip(heads, *rows, strict=True)]
        if sum(widths) > self.stdout.width and len(rows) <= 6:
            heads, *rows = zip(heads, *rows, strict=True)
        self.table(title, heads, rows)
        if frame.height > MAX_ROWS:
            self.say(f"… {frame.height - MAX_ROWS} more rows")

    def table(self, title: str, columns: Sequence[str], rows: Iterable[Sequence[object]]) -> None:
        """Print a table; each value as :func:`shown` prints it."""
        from rich import box
        from rich.table import Table

        from palpate.plugins.sections import shown

        table = Table(title=title, box=box.SIMPLE_HEAD, title_justify="left", title_style="bold")
        for column in columns:
            table.add_column(_escaped(column), overflow="fold")
        for row in rows:
            table.add_row(*(_escaped(shown(value)) for value in row))
        self.stdout.print(table)


def visible(text: str) -> str:
    """Spell out control characters, so that no name or message can steer the terminal."""
    return re.sub(r"[\x00-\x08\x0b-\x1f\x7f-\x9f]", lambda found: f"\\u{ord(found[0]):04x}", text)


def _console(*, stderr: bool = False) -> "Console":
    """Make a console that prints control characters of any text as they are spelt."""
    from rich.console import Console
    from rich.segment import Segment

    class Visible(Console):
        def render(self, renderable: Any, options: Any = None) -> "Iterator[Segment]":  # noqa: ANN401 - rich's
            for text, style, control in super().render(renderable, options):
                yield Segment(text if control else visible(text), style, control)

    return Visible(stderr=stderr, highlight=False, soft_wrap=True)


def _refuse_run(path: Path) -> None:
    """Refuse a run directory where a study is meant: its copy of the study names files of the original."""
    from palpate.cli.runs import is_of
    from palpate.run.ownership import is_run

    if is_run(path) and not is_of(path, path / "study.toml"):
        raise StudyError(
            f"{path}: a run directory, not a study; `palpate run {typed(path)}` continues it, "
            f"`palpate report {typed(path)}` shows it"
        )


def run_folder(study: "Study", out: Path | None) -> Path:
    """Folder of the run: what ``--out`` names, or ``runs/<study>``, which is never the study's own."""
    if out is not None:
        return out
    folder = Path("runs") / study.name
    return folder.with_name(f"{study.name}-run") if folder.resolve() == study.folder.resolve() else folder


def opened(
    context: typer.Context, study: Path, out: Path | None, *, trust: bool
) -> tuple[Session, "Study", Path]:
    """Session of the running command, its study, checked, and the folder of the run.

    Of a run directory, the study that it was made from, or the copy that it keeps.
    """
    from palpate.cli.runs import original_study
    from palpate.run.ownership import is_run

    session = Session.of(context)
    if is_run(study):
        session, file = original_study(session, study, trust=trust)
        return session, session.study(file), out or study
    checked = session.study(study)
    return session, checked, run_folder(checked, out)


def _escaped(text: str) -> str:
    from rich.markup import escape

    return escape(text)
