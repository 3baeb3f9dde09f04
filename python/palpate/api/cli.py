"""Commands: the session, its options and its progress."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.cli.listing import (
        RUN as RUN,
        examples as examples,
        name_of as name_of,
    )
    from palpate.cli.options import (
        AsJson as AsJson,
        OutFolder as OutFolder,
        StudyPath as StudyPath,
    )
    from palpate.cli.progress import (
        StageProgress as StageProgress,
    )
    from palpate.cli.session import (
        TEXT_WIDTH as TEXT_WIDTH,
        Session as Session,
        run_folder as run_folder,
    )
    from palpate.plugins.subcommands import (
        SubCommand as SubCommand,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)

    def __dir__() -> list[str]:
        return sorted({*globals(), *__getattr__("__all__")})
