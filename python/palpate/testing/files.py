"""Laws of what reads files: curves and limbs."""

import contextlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from palpate.domain import Spot
from palpate.errors import CurveError, MeshError, PalpateError
from palpate.limb.checks import check_limb
from palpate.plugins.interfaces import ExperimentLoader, LimbSource
from palpate.plugins.optional import CurveWriter, LoadingDrawer
from palpate.testing.components import ComponentContract, overridden


@dataclass(frozen=True, slots=True, kw_only=True)
class Expected:
    """Content of a file for a channel, as a person reads it there.

    Parameters
    ----------
    abscissa, ordinate : (float, float)
        Least and largest value, in the units of the channel.
    n_branches : int
        Monotone runs of the abscissa: 1 for a press, 3 for a twist 0 → −22.5 → 22.5 → 0.
    """

    abscissa: tuple[float, float]
    ordinate: tuple[float, float]
    n_branches: int = 1


@contextlib.contextmanager
def refused(error: type[PalpateError], path: Path) -> Iterator[None]:
    """Fail, naming the file, unless it is refused with this error and its name."""
    try:
        yield
    except error as found:
        assert path.name in str(found), f"{path.name}: the error does not name it: {found}"  # noqa: PT017
    except Exception as found:
        pytest.fail(f"{path.name}: raises {found!r}, not {error.__name__}")
    else:
        pytest.fail(f"{path.name}: accepted; raise {error.__name__} with its name")


class LoaderContract(ComponentContract):
    """Laws of an experiment loader; override ``loader``, ``good_file``, ``bad_files`` and ``expected``."""

    channel: str | None = None
    """Passed to ``load`` where a file holds one channel that the study names."""

    loader = overridden("the loader under test")

    good_file = overridden("a file that it reads")

    bad_files = overridden("files that it must refuse, such as an empty one and one with text in a curve")

    @pytest.fixture
    def expected(self) -> Mapping[str, Expected]:
        """Provide what ``good_file`` holds, by channel, read by eye and not by the loader."""
        return {}

    component = pytest.fixture(lambda self, loader: loader)

    def test_keeps_units_and_branches(
        self, loader: ExperimentLoader, good_file: Path, expected: Mapping[str, Expected]
    ) -> None:
        if not expected:
            pytest.skip("no `expected` is given: nothing shows that units and branches are right")
        response = loader.load(good_file, self.channel)
        assert set(response) == set(expected), f"reads {', '.join(response)}, not {', '.join(expected)}"
        for name, known in expected.items():
            curve = response[name]
            for what in ("abscissa", "ordinate"):
                span = float(getattr(curve, what).min()), float(getattr(curve, what).max())
                assert span == pytest.approx(getattr(known, what), rel=1e-6), (
                    f"channel '{name}': {what} spans {span}, not {getattr(known, what)}: is it in the "
                    "channel's unit (mm, N, MPa, N·mm, degrees)?"
                )
            assert len(curve.branches) == known.n_branches, (
                f"channel '{name}': {len(curve.branches)} branches, not {known.n_branches}: rows must stay "
                "in the order travelled, neither sorted nor averaged over the way back"
            )

    def test_reads_curves(self, loader: ExperimentLoader, good_file: Path) -> None:
        response = loader.load(good_file, self.channel)
        assert list(response)
        for name in response:
            assert response[name].channel == name
        assert {item.channel for item in response.relaxations} <= set(response)

    def test_refuses_bad_files_by_name(self, loader: ExperimentLoader, bad_files: Sequence[Path]) -> None:
        assert bad_files
        for path in bad_files:
            with refused(CurveError, path):
                loader.load(path, self.channel)

    def test_reads_back_what_it_writes(self, loader: ExperimentLoader, good_file: Path) -> None:
        if not isinstance(loader, CurveWriter):
            pytest.skip("writes no curves")
        written, copy = loader.load(good_file, self.channel), good_file.with_stem("copy")
        loader.save(copy, written, self.channel)
        found = loader.load(copy, self.channel)
        assert set(found) == set(written)
        for name in written:
            one, other = found[name], written[name]
            np.testing.assert_allclose(one.abscissa, other.abscissa, rtol=1e-12)
            np.testing.assert_allclose(one.ordinate, other.ordinate, rtol=1e-12)
            for field in ("std", "time_s"):
                was, read = getattr(one, field), getattr(other, field)
                assert (was is None) == (read is None)
                if was is not None:
                    np.testing.assert_allclose(read, was, rtol=1e-12)

    def test_reads_the_same_twice_and_leaves_the_file_alone(
        self, loader: ExperimentLoader, good_file: Path
    ) -> None:
        before = good_file.read_bytes()
        once, again = (loader.load(good_file, self.channel) for _ in range(2))
        assert set(once) == set(again)
        for name in once:
            np.testing.assert_array_equal(again[name].abscissa, once[name].abscissa)
            np.testing.assert_array_equal(again[name].ordinate, once[name].ordinate)
        assert good_file.read_bytes() == before

    def test_load_gives_the_last_press_of_a_file(self, loader: ExperimentLoader, good_file: Path) -> None:
        alone, presses = loader.load(good_file, self.channel), loader.load_presses(good_file, self.channel)
        assert presses, "load_presses returned no press"
        last = list(presses.values())[-1]
        assert set(last) == set(alone)
        for name in alone:
            np.testing.assert_array_equal(last[name].ordinate, alone[name].ordinate)

    def test_its_record_is_plain(self, loader: ExperimentLoader, good_file: Path) -> None:
        record = dict(loader.load(good_file, self.channel).record)
        assert json.loads(json.dumps(record, allow_nan=False)) == record

    def test_draws_in_the_given_folder(
        self, loader: ExperimentLoader, good_file: Path, tmp_path: Path
    ) -> None:
        if not isinstance(loader, LoadingDrawer):
            pytest.skip("draws nothing")
        folder = tmp_path / "pictures of one file"
        folder.mkdir()
        files = loader.draw(good_file, folder, self.channel)
        assert set(files) == set(folder.iterdir())

    def test_a_corrupt_file_is_refused_or_read_but_never_falls_over(
        self, loader: ExperimentLoader, good_file: Path, tmp_path: Path
    ) -> None:
        whole = good_file.read_bytes()
        corrupt = {f"cut_{share}": whole[: len(whole) * share // 100] for share in (0, 30, 90)}
        corrupt["flipped"] = bytes(byte ^ (0x80 if i % 97 == 50 else 0) for i, byte in enumerate(whole))
        corrupt["junk"] = np.random.default_rng(1).bytes(2000)
        for name, content in corrupt.items():
            path = tmp_path / f"{name}{good_file.suffix}"
            path.write_bytes(content)
            try:
                response = loader.load(path, self.channel)
            except CurveError as error:
                assert path.name in str(error)  # noqa: PT017 - it may also be read
            except Exception as error:
                pytest.fail(f"{path.name}: raises {error!r}, not CurveError")
            else:
                assert list(response), f"{path.name}: accepted, and no curve is read"

    def test_refuses_a_folder_by_name(self, loader: ExperimentLoader, good_file: Path) -> None:
        folder = good_file.with_name("a_folder" + good_file.suffix)
        folder.mkdir()
        with refused(CurveError, folder):
            loader.load(folder, self.channel)

    def test_refuses_a_missing_file_by_name(self, loader: ExperimentLoader, good_file: Path) -> None:
        with pytest.raises(PalpateError, match="no_such"):
            loader.load(good_file.with_name("no_such" + good_file.suffix), self.channel)


class LimbSourceContract(ComponentContract):
    """Laws of a limb source; override ``limb_source``, ``good_file``, ``bad_files`` and ``spot``."""

    extent_mm = (5.0, 1000.0)
    """Least and largest extent of the limb of ``good_file``, to tell millimetres from metres."""

    limb_source = overridden("the limb source under test")

    good_file = overridden("a file that it reads")

    bad_files = overridden("files that it must refuse")

    @pytest.fixture
    def spot(self) -> Spot:
        """Provide a spot on the limb of ``good_file``."""
        return Spot(name="p1")

    component = pytest.fixture(lambda self, limb_source: limb_source)

    def test_makes_a_limb(self, limb_source: LimbSource, good_file: Path, spot: Spot) -> None:
        limb = limb_source.load(good_file, spot)
        assert limb.spot.name == spot.name, f"the limb is of spot '{limb.spot.name}', not '{spot.name}'"
        check_limb(limb, limb.mesh.regions)

    def test_is_in_millimetres(self, limb_source: LimbSource, good_file: Path, spot: Spot) -> None:
        points = limb_source.load(good_file, spot).mesh.points_mm
        extent, (least, largest) = float(np.ptp(points, axis=0).max()), self.extent_mm
        assert least <= extent <= largest, (
            f"the limb is {extent:g} mm long, outside {least:g} to {largest:g} mm: are its points in mm?"
        )

    def test_refuses_bad_files_by_name(
        self, limb_source: LimbSource, bad_files: Sequence[Path], spot: Spot
    ) -> None:
        assert bad_files
        for path in bad_files:
            with refused(MeshError, path):
                limb_source.load(path, spot)
