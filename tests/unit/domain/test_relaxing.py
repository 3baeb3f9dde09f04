"""Materials that relax: the elastic one's energy, and shares as parameters after its own."""

import pickle

import numpy as np
import pytest

from palpate.api.mechanics import StandardMaterial
from palpate.domain.relaxing import relaxing
from palpate.errors import MaterialError, ParameterError
from palpate.executors.worker import packed
from palpate.testing import LinearMaterial
from palpate_materials.uncoupled import Ogden, Yeoh

TIMES_S = (0.5, 10.0)
THETA = np.array([0.0141, -0.0011, 1.05e-4, 0.4, 0.3, 0.2])


def test_it_is_the_elastic_material_with_more_parameters():
    elastic, material = Yeoh(), relaxing(Yeoh(), TIMES_S)
    stretches = np.array([[1.2, 0.9, 0.95], [0.7, 1.2, 1.1]])
    assert isinstance(material, Yeoh)
    assert [p.name for p in material.parameters[4:]] == ["relaxed_500ms", "relaxed_10s"]
    np.testing.assert_array_equal(material.energy(stretches, THETA), elastic.energy(stretches, THETA[:4]))
    written = material.from_textbook(THETA, "febio4")
    np.testing.assert_array_equal(written, [*elastic.from_textbook(THETA[:4], "febio4"), 0.3, 0.2])


def test_shares_add_up_to_less_than_one():
    material = relaxing(LinearMaterial(), TIMES_S)
    material.check(np.array([0.3, 0.5, 0.4]))
    with pytest.raises(ParameterError, match=r"shares that relax add up to 1\.1; they are less than 1"):
        material.check(np.array([0.3, 0.5, 0.6]))
    assert sum(p.upper for p in material.parameters[1:]) < 1.0


def test_a_share_is_no_parameter_of_the_elastic_material():
    """Ogden refuses exponents of zero, and nothing relaxes at the lower end of a share."""
    relaxing(Ogden(), TIMES_S).check(np.array([0.06, 3.1, 0.4, 0.0, 0.0]))
    with pytest.raises(MaterialError, match="exponent m1 = 0"):
        relaxing(Ogden(), TIMES_S).check(np.array([0.06, 0.0, 0.4, 0.1, 0.1]))


@pytest.mark.parametrize("times_s", [(1.0, 1.0), (1.0001, 1.0002), (1e-4,), (0.0,), (np.inf,), (np.nan,)])
def test_shares_have_names_of_their_own(times_s):
    with pytest.raises(MaterialError, match="time constants are at least 1 ms, and that far apart, got "):
        relaxing(Yeoh(), times_s)


def test_what_relaxes_is_not_made_to_relax_again():
    with pytest.raises(MaterialError, match="material 'yeoh' relaxes already; give it all times at once"):
        relaxing(relaxing(Yeoh(), TIMES_S), (1.0,))


def test_its_key_and_its_copies_know_the_times():
    material = relaxing(Yeoh(), TIMES_S, isochoric=True)
    for copy in (pickle.loads(pickle.dumps(material)), pickle.loads(packed(material))):
        assert copy == material
        assert hash(copy) == hash(material)
        assert copy.fingerprint() == Yeoh().fingerprint()
    others = Yeoh(), relaxing(Yeoh(), TIMES_S), relaxing(Yeoh(), (0.5,), isochoric=True)
    assert all(material != other for other in others)
    assert len({m.settings.model_dump_json() for m in (material, *others)}) == 4


def test_no_other_program_takes_its_energy_for_all_of_it():
    assert isinstance(Yeoh(), StandardMaterial)
    assert not isinstance(relaxing(Yeoh(), TIMES_S), StandardMaterial)
