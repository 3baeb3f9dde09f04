"""What was computed, what failed and why: ``ledger.sqlite`` and the curves beside it.

::

    ledger.sqlite    simulations   one row per key: state, message, seconds, attempts …
                     attempts      one row per attempt: state, message, seconds
                     jobs          spot and set_id → key, for the sweep begun last
                     curve_files   size and SHA-256 of each file in curves/
    curves/<n>.parquet             curves of one or more simulations, by key

A simulation counts as finished once its row is on the disk, and its row is written after
its curves are. Any SQLite and any Parquet reader opens both without palpate::

    polars.read_database("SELECT * FROM simulations", sqlite3.connect("ledger.sqlite"))
    polars.scan_parquet(f"curves/{row['curves']}").filter(polars.col("key") == row["key"])

The file that a row names holds the curves that count; another may hold those of an earlier attempt.
"""

from palpate.run.ledger.reader import Entry, Ledger
from palpate.run.ledger.writer import Finished, Writer

__all__ = ["Entry", "Finished", "Ledger", "Writer"]
