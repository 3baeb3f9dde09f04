# ruff: noqa: E501 - a line of a layout is a line here
"""Poses as transforms of 3 x 4 or 4 x 4 numbers, by rows or by columns."""

import json
from collections.abc import Callable, Mapping
from functools import partial
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import FloatArray

from .known_presses import DEPTH_MM, FORCE_N, TORQUE_NMM, press
from .test_layouts_of_makers import proposed

pytestmark = pytest.mark.usefixtures("in_this_process")


def _transforms() -> Mapping[str, Callable[[], bytes]]:
    made = press(twist=True)
    turn, place = made.pose.as_matrix(), 1e-3 * made.tip_mm[:, :, None]
    matrix = np.concatenate([turn, place], axis=2)
    whole = np.concatenate([matrix, np.tile([[[0.0, 0.0, 0.0, 1.0]]], (len(turn), 1, 1))], axis=1)
    wrench = np.column_stack([made.force_N, made.moment_Nm])
    names = "fx_N,fy_N,fz_N,tx_Nm,ty_Nm,tz_Nm"

    def named(pose: str, values: FloatArray) -> bytes:
        table = np.column_stack([made.time_s, values.reshape(len(values), -1), wrench])
        lines = [",".join(map(repr, row)) for row in table.tolist()]
        return "\n".join([f"t_s,{pose},{names}", *lines, ""]).encode()

    def samples() -> bytes:
        of = zip(made.time_s.tolist(), whole.tolist(), wrench.tolist(), strict=True)
        return "\n".join(json.dumps({"t": t, "pose": p, "wrench": w}) for t, p, w in of).encode()

    def archive() -> bytes:
        stream = BytesIO()
        np.savez(stream, t=made.time_s, T=matrix, wrench=wrench)
        return stream.getvalue()

    by_column = matrix.transpose(0, 2, 1)
    noap = ",".join(f"{of}{on}" for of in "noap" for on in "xyz")
    return {
        "T00 to T23.csv": partial(named, ",".join(f"T{i}{j}" for i in range(3) for j in range(4)), matrix),
        "T11 to T44.csv": partial(named, ",".join(f"T{i}{j}" for i in (1, 2, 3, 4) for j in (1, 2, 3, 4)), whole),
        "by columns.csv": partial(named, ",".join(f"T_{i}" for i in range(12)), by_column),
        "normal, orientation, approach, place.csv": partial(named, noap, by_column),
        "matrices of rows.jsonl": samples,
        "matrices of 3 x 4.npz": archive,
    }  # fmt: skip


TRANSFORMS = _transforms()


@pytest.mark.parametrize("name", TRANSFORMS)
def test_a_transform_is_a_place_and_a_turn(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_bytes(TRANSFORMS[name]())
    curves, problem = proposed(tmp_path / name)
    assert curves is not None, problem
    force, torque = curves["force"], curves["torque"]
    assert (force.abscissa.max(), force.ordinate.max()) == pytest.approx((DEPTH_MM, FORCE_N), abs=0.1)
    assert torque.abscissa.max() == pytest.approx(22.5, abs=0.1)
    assert torque.ordinate.max() == pytest.approx(TORQUE_NMM, abs=0.5)
