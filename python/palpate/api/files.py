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
    from palpate.experiment.delimited.header_units import (
        BASE_UNITS as BASE_UNITS,
        UNITS as UNITS,
        Kind as Kind,
        factor_to_base as factor_to_base,
        factors_of as factors_of,
        kind_of as kind_of,
        plain_letters as plain_letters,
        unit_in as unit_in,
    )
    from palpate.experiment.delimited.layout import (
        DELIMITERS as DELIMITERS,
        HEXADECIMAL as HEXADECIMAL,
        TextFormat as TextFormat,
    )
    from palpate.experiment.delimited.table import (
        Column as Column,
        TextTable as TextTable,
        check_columns as check_columns,
        close_to as close_to,
        listed as listed,
        refuse_binary as refuse_binary,
    )
    from palpate.plugins.optional import (
        CurveWriter as CurveWriter,
        FileInspector as FileInspector,
        InspectedTable as InspectedTable,
        Inspection as Inspection,
    )
    from palpate.run.atomic_files import write_atomically as write_atomically
    from palpate.toml_text import ASKED as ASKED, toml_document as toml_document, toml_value as toml_value

if not TYPE_CHECKING:
    __getattr__ = deferred(__name__)
    __dir__ = __getattr__("__dir__")
