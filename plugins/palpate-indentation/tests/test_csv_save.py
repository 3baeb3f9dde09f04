"""Curves that the CSV loader writes are the curves that it reads."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import Curve, FloatArray, Response
from palpate.errors import CurveError
from palpate_indentation import CsvLoader, CsvSettings

finite = st.floats(-1e100, 1e100)
moving = st.lists(st.tuples(finite, finite), min_size=2, max_size=20).filter(
    lambda rows: rows[0][0] != rows[1][0] and rows[-1][0] != rows[-2][0]
)
dialects = st.fixed_dictionaries(
    {
        "decimal": st.sampled_from([".", ","]),
        "delimiter": st.sampled_from([None, ";", "\t"]),
        "skip_lines": st.integers(0, 3),
        "comment": st.sampled_from(["#", "", "%"]),
    }
)
DEPTH = np.array([0.0, 1.0, 2.0])


def loader(**given_settings: object) -> CsvLoader:
    return CsvLoader(CsvSettings.model_validate(given_settings))


def response(**rows: FloatArray) -> Response:
    return Response(
        curves={name: Curve(channel=name, abscissa=xy[:, 0], ordinate=xy[:, 1]) for name, xy in rows.items()}
    )


def assert_same(found: Response, expected: Response, tolerance: float = 0.0) -> None:
    assert set(found) == set(expected)
    for name in expected:
        for a, b in (
            (found[name].abscissa, expected[name].abscissa),
            (found[name].ordinate, expected[name].ordinate),
        ):
            np.testing.assert_allclose(a, b, rtol=tolerance, atol=tolerance * np.abs(b).max())


@given(force=moving, torque=moving, dialect=dialects)
def test_two_channels_in_one_file_are_read_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory,
    force: list[tuple[float, float]],
    torque: list[tuple[float, float]],
    dialect: dict[str, object],
) -> None:
    path = tmp_path_factory.mktemp("curves") / "c.csv"
    written = response(force=np.array(force), torque=np.array(torque))
    loader(**dialect).save(path, written)
    assert_same(loader(**dialect).load(path), written)


@given(rows=moving, channel=st.sampled_from(["force", "uniaxial", "simple_shear", "warmth"]))
def test_one_channel_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, rows: list[tuple[float, float]], channel: str
) -> None:
    path = tmp_path_factory.mktemp("curves") / "c.csv"
    written = response(**{channel: np.array(rows)})
    loader().save(path, written, channel)
    assert_same(loader().load(path, channel), written)


def test_numbers_are_written_in_the_files_units(tmp_path: Path) -> None:
    strain = {"name": "strain", "scale": 0.01, "offset": 1.0}
    stress = {"name": "stress_kPa", "scale": 1e-3}
    own = loader(channels={"uniaxial": {"abscissa": strain, "ordinate": stress}})
    written = response(uniaxial=np.array([[1.0, 0.0], [1.5, 0.02], [2.0, 0.05]]))
    own.save(tmp_path / "c.csv", written)
    header, *rows = (tmp_path / "c.csv").read_text().splitlines()
    assert header == "strain,stress_kPa"
    assert [float(x) for x in rows[1].split(",")] == pytest.approx([50.0, 20.0])
    assert_same(own.load(tmp_path / "c.csv"), written, tolerance=1e-15)


def test_columns_of_other_channels_rest(tmp_path: Path) -> None:
    force = np.column_stack([DEPTH, [0.0, 2.0, 7.0]])
    torque = np.column_stack([[0.0, -9.0, 9.0], [0.0, -3.0, 3.0]])
    loader().save(tmp_path / "c.csv", response(force=force, torque=torque))
    assert (tmp_path / "c.csv").read_text().splitlines() == [
        "depth_mm,angle_deg,force_N,torque_Nmm",
        *("0.0,0.0,0.0,0.0", "1.0,0.0,2.0,0.0", "2.0,0.0,7.0,0.0"),
        *("2.0,0.0,7.0,0.0", "2.0,-9.0,7.0,-3.0", "2.0,9.0,7.0,3.0"),
    ]


def test_channels_that_the_settings_do_not_name_are_refused(tmp_path: Path) -> None:
    force = response(force=np.column_stack([DEPTH, DEPTH]))
    with pytest.raises(CurveError, match=r"c\.csv: the curves are force, .* columns for force, torque"):
        loader().save(tmp_path / "c.csv", force)
    assert not (tmp_path / "c.csv").exists()


def test_two_channels_over_one_column_are_refused(tmp_path: Path) -> None:
    channels = {name: {"abscissa": "depth_mm", "ordinate": name} for name in ("force", "lateral")}
    both = response(**{name: np.column_stack([DEPTH, DEPTH]) for name in channels})
    with pytest.raises(CurveError, match=r"c\.csv: two curves need one column .*separate file"):
        loader(channels=channels).save(tmp_path / "c.csv", both)


STD = {
    "force": {"abscissa": "d", "ordinate": "f", "std": {"name": "sf", "scale": 0.001}},
    "torque": {"abscissa": "a", "ordinate": "t"},
}


def unsure(std: object) -> Response:
    force = Curve(channel="force", abscissa=DEPTH, ordinate=DEPTH**2, std=std)
    return Response(
        curves={"force": force, "torque": Curve(channel="torque", abscissa=DEPTH, ordinate=-DEPTH)}
    )


def test_standard_deviations_are_read_back_in_their_unit(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    loader(channels=STD).save(path, unsure([0.1, 0.0, 0.3]))
    assert path.read_text().splitlines()[:2] == ["d,a,f,t,sf", "0.0,0.0,0.0,-0.0,100.0"]
    found = loader(channels=STD).load(path)
    assert found["force"].std == pytest.approx([0.1, 0.0, 0.3])
    assert found["torque"].std is None


@pytest.mark.parametrize(
    ("channels", "std", "says"),
    [
        (STD, None, "channel 'force' has no standard deviation; remove channels.force.std in"),
        (
            {c: {k: STD[c][k] for k in ("abscissa", "ordinate")} for c in STD},
            [0.1] * 3,
            "has a standard .*name a",
        ),
    ],
)
def test_a_standard_deviation_is_neither_made_up_nor_dropped(
    tmp_path: Path, channels: object, std: object, says: str
) -> None:
    with pytest.raises(CurveError, match=says):
        loader(channels=channels).save(tmp_path / "c.csv", unsure(std))


TIMED = {
    "force": {"abscissa": "d", "ordinate": "f", "time": {"name": "t_ms", "scale": 0.001}},
    "torque": {"abscissa": "a", "ordinate": "t", "time": {"name": "t_ms", "scale": 0.001}},
}


def timed(force_s: object, torque_s: object) -> Response:
    force = Curve(channel="force", abscissa=DEPTH, ordinate=DEPTH**2, time_s=force_s)
    return Response(
        curves={
            "force": force,
            "torque": Curve(channel="torque", abscissa=DEPTH, ordinate=-DEPTH, time_s=torque_s),
        }
    )


def test_times_of_curves_in_one_column_are_read_back_in_seconds(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    loader(channels=TIMED).save(path, timed([0.0, 0.5, 2.0], [3.0, 3.5, 4.0]))
    assert path.read_text().splitlines()[:2] == ["d,a,f,t,t_ms", "0.0,0.0,0.0,-0.0,0.0"]
    found = loader(channels=TIMED).load(path)
    assert found["force"].time_s == pytest.approx([0.0, 0.5, 2.0])
    assert found["torque"].time_s == pytest.approx([3.0, 3.5, 4.0])
    assert loader(channels={"force": {"abscissa": "d", "ordinate": "f"}}).load(path)["force"].time_s is None


def test_a_time_is_neither_made_up_nor_dropped(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    with pytest.raises(CurveError, match=r"channel 'torque' has no time; remove channels\.torque\.time in"):
        loader(channels=TIMED).save(path, timed([0.0, 0.5, 2.0], None))
    plain = {c: {k: TIMED[c][k] for k in ("abscissa", "ordinate")} for c in TIMED}
    with pytest.raises(CurveError, match=r"channel 'force' has a time; name a column under"):
        loader(channels=plain).save(path, timed([0.0, 0.5, 2.0], None))


def test_a_time_that_goes_back_names_its_file(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    path.write_text("d,f,t_ms\n0,0,0\n1,2,500\n2,3,400\n")
    with pytest.raises(CurveError, match=r"c\.csv: channel 'force'.*time_s\[2\] is 0.4"):
        loader(channels={"force": TIMED["force"]}).load(path)


def test_a_negative_standard_deviation_names_its_file(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    path.write_text("d,f,sf\n0,0,1\n1,2,-1\n")
    with pytest.raises(CurveError, match=r"c\.csv: channel 'force'.*std\[1\] is -0.001"):
        loader(channels={"force": STD["force"]}).load(path)
