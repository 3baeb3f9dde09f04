"""Files: delimited text, writing whole, and programs and functions within limits of time and memory."""

from typing import TYPE_CHECKING

from palpate.lazy_imports import deferred

if TYPE_CHECKING:
    from palpate.executors.sandbox import (
        Ended as Ended,
        ProcessLimits as ProcessLimits,
        run_function as run_function,
        run_program as run_program,
    )
    from palpate.experiment.delimited import (
        BASE_UNITS as BASE_UNITS,
        DELIMITERS as DELIMITERS,
        UNITS as UNITS,
        Column as Column,
        Kind as Kind,
        TextFormat as TextFormat,
        TextTable as TextTable,
        close_to as close_to,
        factor_to_base as factor_to_base,
        factors_of as factors_of,
        kind_of as kind_of,
        listed as listed,
        refuse_binary as refuse_binary,
        unit_in as unit_in,
    )
    from palpate.plugins.optional import (
        CurveWriter as CurveWriter,
        FileInspector as FileInspector,
        InspectedTable as InspectedTable,
        Inspection as Inspection,
    )
    from palpate.run.atomic_files import (
        write_atomically as write_atomically,
    )
    from palpate.toml_text import (
        toml_value as toml_value,
    )

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
