"""How much a file may ask for before it is refused."""

from pydantic import Field

from palpate.errors import CurveError
from palpate.interfaces import Settings


class Limits(Settings):
    """Bounds on reading one file. A log of an hour at 1 kHz needs a tenth of them."""

    file_mb: float = Field(default=2000.0, gt=0.0, description="Largest file, or bag folder [MB].")
    values: int = Field(
        default=150_000_000, ge=1, description="Most numbers in the columns read, after decompression."
    )
    memory_mb: float = Field(
        default=6000.0, ge=300.0, description="Most memory of the process that reads [MB]; Unix only."
    )
    time_s: float = Field(default=120.0, gt=0.0, description="Longest time that reading may take [s].")

    @property
    def n_bytes(self) -> int:
        """Most bytes that the numbers may take."""
        return 8 * self.values

    def check_values(self, source: str, n_values: int, what: str) -> None:
        """Refuse before loading what would not fit.

        Raises
        ------
        CurveError
        """
        if n_values > self.values:
            raise CurveError(
                f"{source}: {what} would be {n_values} numbers where at most {self.values} are read; "
                "export fewer, or raise values under limits in the loader's settings"
            )

    def check_bytes(self, source: str, n_bytes: int, what: str) -> None:
        """Refuse before unpacking what would not fit.

        Raises
        ------
        CurveError
        """
        if n_bytes > self.n_bytes:
            raise CurveError(
                f"{source}: {what} unpacks to {n_bytes} bytes where at most {self.n_bytes} are read; "
                "export fewer, or raise values under limits in the loader's settings"
            )
