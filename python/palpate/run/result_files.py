"""Results as files: curves as rows of a table."""

import io
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import polars as pl

from palpate.domain import Curve, FloatArray, Response

Files = Mapping[str, pl.DataFrame | Mapping[str, Any]]
"""Results of a stage by name: a table is the file ``<name>.parquet``, plain values are ``<name>.json``."""

_NUMBERS = ("abscissa", "ordinate", "std", "time_s")
_CURVES = pl.Schema({"channel": pl.String, "point": pl.Int64} | dict.fromkeys(_NUMBERS, pl.Float64))


def frame_of(response: Response) -> pl.DataFrame:
    """Curves as rows of channel, point, abscissa, ordinate and, where any curve has them, std and time_s."""
    curves = [
        {"channel": c.channel, "point": range(c.abscissa.size), **{n: getattr(c, n) for n in _NUMBERS}}
        for c in response.curves.values()
    ]
    frame = pl.concat([pl.DataFrame(schema=_CURVES), *(pl.DataFrame(c, schema=_CURVES) for c in curves)])
    return frame.drop(name for name in ("std", "time_s") if not frame[name].count())


def response_of(frame: pl.DataFrame) -> Response:
    """Make curves of rows: the inverse of :func:`frame_of`."""

    def known(rows: pl.DataFrame, name: str) -> FloatArray | None:
        return rows[name].to_numpy() if name in rows and rows[name].count() else None

    return Response(
        curves={
            str(name): Curve(
                channel=str(name),
                abscissa=rows["abscissa"].to_numpy(),
                ordinate=rows["ordinate"].to_numpy(),
                std=known(rows, "std"),
                time_s=known(rows, "time_s"),
            )
            for (name,), rows in frame.group_by("channel", maintain_order=True)
        }
    )


FIT_KEYS = ("fit", "scenario", "spot")
"""Columns that name a fit at a spot."""


def curves_of(
    responses: Iterable[tuple[tuple[str | None, ...], Response]], keys: Sequence[str] = FIT_KEYS
) -> pl.DataFrame:
    """Curves by the values of some columns, as rows of one table: the inverse of :func:`responses_of`."""
    frames = [
        frame_of(response).select(
            *(pl.lit(part, pl.String).alias(name) for name, part in zip(keys, key, strict=True)), pl.all()
        )
        for key, response in responses
    ]
    return pl.concat(frames, how="diagonal") if frames else pl.DataFrame()


def responses_of(curves: pl.DataFrame) -> dict[tuple[str, str, str], Response]:
    """Curves by fit, scenario and spot of a table of them."""
    parts = curves.partition_by(*FIT_KEYS, as_dict=True, include_key=False)
    return {(str(a), str(b), str(c)): response_of(part) for (a, b, c), part in parts.items()}


def parquet(frame: pl.DataFrame) -> bytes:
    """Content of a Parquet file."""
    buffer = io.BytesIO()
    frame.write_parquet(buffer)
    return buffer.getvalue()
