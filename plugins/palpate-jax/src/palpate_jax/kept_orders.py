"""Orders of elimination, kept on disk for the next process.

The search for an order takes as long as several factors, and depends on the mesh alone. A file holds the
order of one pattern, named by a hash of the pattern and of the compiled code that searches. Any number of
workers may share the folder; a file that is damaged or was deleted is written again.
"""

import hashlib
import sys
from contextlib import suppress
from functools import cache
from pathlib import Path

import numpy as np
import platformdirs
from numpy.typing import NDArray

from palpate.api.files import write_atomically
from palpate.api.mechanics import SparseFactor

Order = NDArray[np.uint32]

CHECKSUM = hashlib.sha256


def order_file(indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> Path:
    """Where the order of a pattern is kept."""
    name = CHECKSUM(_searching_code() + indptr.tobytes() + indices.tobytes()).hexdigest()[:32]
    return platformdirs.user_cache_path("palpate") / "orders" / name


def kept_order(file: Path) -> Order | None:
    """The order in a file; None where there is none, or it is not what was written."""
    try:
        content = file.read_bytes()
    except OSError:
        return None
    digest, numbers = content[: CHECKSUM().digest_size], content[CHECKSUM().digest_size :]
    sound = CHECKSUM(numbers).digest() == digest
    return np.frombuffer(numbers, dtype="<u4").astype(np.uint32) if sound else None


def keep_order(file: Path, order: Order) -> None:
    """Write an order; without a folder for it, the next process searches again."""
    numbers = order.astype("<u4").tobytes()
    with suppress(OSError):
        write_atomically(file, CHECKSUM(numbers).digest() + numbers)


@cache
def _searching_code() -> bytes:
    """Hash of the extension module: another one may order otherwise, and results follow to the last bit."""
    return CHECKSUM(Path(str(sys.modules[SparseFactor.__module__].__file__)).read_bytes()).digest()
