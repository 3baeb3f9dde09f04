"""Code that decides a result: a changed byte of it changes the key, anything else does not."""

import hashlib
import importlib
import itertools
import sys
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given, strategies as st
from pydantic import Field

from palpate.domain import HomogeneousTests, Indentation, Job
from palpate.domain.component import Settings
from palpate.domain.indenter import Indenter, Sphere, SphereSettings
from palpate.errors import PluginError
from palpate.fingerprints import code_hash
from palpate.plugins.interfaces import Solver
from palpate.plugins.registry import load_file
from palpate.run import keys
from palpate.run.keys import identity, job_key

MATERIAL = """
from palpate.domain import Parameter
from palpate.domain.material import IsotropicMaterial
{imports}

class Fat(IsotropicMaterial):
    name, summary = "fat", "a material"
    parameters = (Parameter(name="mu", unit="MPa", lower=1.0, upper=2.0, kind="modulus", description="m"),)

    def energy(self, stretches, theta):
        return {factor} * theta[0] * ((stretches**2).sum(-1) - 3.0)
"""


@pytest.fixture
def packaged(tmp_path, monkeypatch):
    """Import a package ``name`` with these modules, and return its ``material.Fat``."""
    folders = itertools.count()

    def make(name, **modules):
        root = tmp_path / str(next(folders))
        (root / name / "deep").mkdir(parents=True)
        (root / name / "__init__.py").write_text("")
        for module, text in modules.items():
            (root / name / f"{module.replace('__', '/')}.py").write_text(text)
        monkeypatch.syspath_prepend(str(root))
        for known in [module for module in sys.modules if module.partition(".")[0] == name]:
            monkeypatch.delitem(sys.modules, known)
        return importlib.import_module(f"{name}.material").Fat

    return make


@pytest.fixture
def key(tissue):
    def of(material, protocol=None, solver=None, **asked):
        tests = HomogeneousTests(paths={"pull": np.array([1.0, 2.0])})
        job = Job(
            spot="p1",
            set_id=0,
            materials={"m": material},
            thetas={"m": np.array([1.0])},
            protocol=tests if protocol is None else protocol,
            **asked,
        )
        return job_key(job, None, solver or tissue.Analytic())

    return of


def test_the_energy_and_every_module_of_its_package_are_in_the_key(packaged, key):
    usual, doubled = MATERIAL.format(imports="", factor=1.0), MATERIAL.format(imports="", factor=2.0)
    first = key(packaged("lab_a", material=usual, deep__parts="C = 1.0")())
    assert key(packaged("lab_a", material=usual, deep__parts="C = 1.0")()) == first
    others = [
        key(packaged("lab_a", material=doubled, deep__parts="C = 1.0")()),
        key(packaged("lab_a", material=usual, deep__parts="C = 2.0")()),
        key(packaged("lab_b", material=doubled)()),
    ]
    assert len({first, *others}) == 4


def test_a_base_from_another_package_counts_with_its_sources(packaged, key):
    derived = MATERIAL.format(imports="import lab_base.material", factor=1.0).replace(
        "(IsotropicMaterial)", "(lab_base.material.Fat)"
    )
    found = set()
    for factor in (1.0, 2.0):
        packaged("lab_base", material=MATERIAL.format(imports="", factor=factor))
        found.add(key(packaged("lab_c", material=derived)()))
    assert len(found) == 2


def test_a_one_file_plugin_counts_by_the_content_that_was_imported(tmp_path, key):
    file = tmp_path / "goh.py"
    file.write_text(MATERIAL.format(imports="", factor=1.0))
    first = load_file(file).Fat()
    before = identity(first)
    file.write_text(MATERIAL.format(imports="", factor=2.0))
    assert identity(first) == before
    second = load_file(file).Fat()
    assert identity(second) != before
    assert key(first) != key(second)
    other = tmp_path / "elsewhere" / "renamed.py"
    other.parent.mkdir()
    other.write_text(MATERIAL.format(imports="", factor=1.0))
    assert key(load_file(other).Fat()) == key(first)


def test_a_class_without_a_file_needs_a_fingerprint(tmp_path, key, monkeypatch):
    typed = {}
    exec(MATERIAL.format(imports="", factor=1.0), typed)
    with pytest.raises(PluginError, match=r"class Fat .* is in no file.*--plugin FILE"):
        key(typed["Fat"]())
    notebook = {"__name__": "__main__"}
    exec(MATERIAL.format(imports="", factor=1.0), notebook)
    monkeypatch.setattr(sys, "ps1", ">>> ", raising=False)
    with pytest.raises(PluginError, match="is in no file"):
        key(notebook["Fat"]())
    typed["Fat"].fingerprint = lambda self: "1"
    pinned = key(typed["Fat"]())
    typed["Fat"].fingerprint = lambda self: "2"
    assert key(typed["Fat"]()) != pinned
    typed["Fat"].fingerprint = lambda self: None
    with pytest.raises(PluginError, match=r"its version or fingerprint is None; return a non-empty text"):
        key(typed["Fat"]())


@given(
    files=st.dictionaries(st.sampled_from("abcd"), st.binary(max_size=20), min_size=1),
    position=st.integers(0, 100),
    flip=st.integers(1, 255),
)
def test_any_changed_byte_of_code_changes_the_hash_and_other_files_do_not(
    tmp_path_factory, files, position, flip
):
    folder = tmp_path_factory.mktemp("package")
    for name, content in files.items():
        (folder / f"{name}.py").write_bytes(content)
    before = code_hash(folder)
    (folder / "__pycache__").mkdir()
    (folder / "__pycache__" / "a.pyc").write_bytes(b"compiled")
    (folder / "notes.txt").write_text("notes")
    assert code_hash(folder) == before
    name, content = next(iter(files.items()))
    changed = bytearray(content or b"\0")
    changed[position % len(changed)] ^= flip
    (folder / f"{name}.py").write_bytes(changed)
    assert code_hash(folder) != before or bytes(changed) == content


class ManySettings(Settings):
    by_name: dict[str, float] = Field(default_factory=dict, description="Numbers.")


def test_what_is_asked_of_a_solver_beyond_its_curves_is_in_the_key(tissue, key):
    asked = ({}, {"slopes": True}, {"surface": True}, {"warm_starts": {"m": np.ones((1, 1))}})
    assert len({key(tissue.Spongy(), **each) for each in asked}) == len(asked)


def test_the_order_of_settings_is_no_difference(tissue, key):
    class Sorted(tissue.Analytic, Solver[ManySettings]):
        pass

    one, two = ({"a": 1.0, "b": 2.0}, {"b": 2.0, "a": 1.0})
    keys = {key(tissue.Spongy(), solver=Sorted(ManySettings(by_name=each))) for each in (one, two)}
    other = key(tissue.Spongy(), solver=Sorted(ManySettings(by_name={"a": 1.0})))
    assert len(keys) == 1
    assert other not in keys


class PunchSettings(SphereSettings):
    edge: float = Field(1.0, description="radius of its edge [mm]")


class Punch(Sphere, Indenter[PunchSettings]):
    name, summary = "punch", "a punch"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cyclic(Indentation):
    n_cycles: int = 1


@dataclass(frozen=True, kw_only=True)
class Relaxation:
    hold_s: float


def test_every_field_of_a_third_party_s_indenter_and_protocol_is_in_the_key(tissue, key):
    path, material = [(0, 0), (5, 0)], tissue.Spongy()
    press = Indentation(indenter=Sphere(radius_mm=5.0), path=path, friction=0.5)
    protocols = [
        press,
        replace(press, indenter=Punch(PunchSettings(radius="5 mm", edge=1.0))),
        replace(press, indenter=Punch(PunchSettings(radius="5 mm", edge=2.0))),
        replace(press, tilt_deg=(1.0, 0.0)),
        *(Cyclic(indenter=press.indenter, path=path, friction=0.5, n_cycles=n) for n in (1, 2)),
        Relaxation(hold_s=1.0),
        Relaxation(hold_s=2.0),
    ]
    assert len({key(material, protocol) for protocol in protocols}) == len(protocols)
    with pytest.raises(PluginError, match="cannot be part of its key; make the class a dataclass"):
        key(material, object())


def test_a_press_of_a_sphere_has_the_key_of_every_run_so_far():
    """Its part of the key was written when a sphere was the only indenter; results are found by it."""
    path = [(0, 0), (10, 0), (10, -22.5), (10, 22.5), (10, 0)]
    digest = hashlib.sha256()
    keys._add(digest, Indentation(indenter=Sphere(radius_mm=7.5), path=path, friction=1.0))
    assert digest.hexdigest() == "c1355ad85a218b75ad3ad831a50e9ea44a238677d4fe91d1d615205abee872e3"
