"""Decks of tissue that relaxes, written around its elastic material."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from palpate.api import RelaxingMaterial, relaxing
from palpate.errors import MaterialError, StudyError
from palpate_febio.steps import halved, steps_of, with_hold
from palpate_materials import NeoHookean

from .decks import MATERIALS, SOLVER, TIMED, TIMES_S, job_of, materials_in, mixed_limb, numbers, relaxing_job


def test_what_relaxes_is_written_around_its_elastic_material_of_the_long_term():
    """With the shares of FEBio's recorded curves its g are 0.25 and 0.15, and its moduli those recorded."""
    found = materials_in(SOLVER.write_deck(relaxing_job(), mixed_limb()))
    elastic = materials_in(SOLVER.write_deck(job_of(), mixed_limb()))
    terms = pytest.approx({"g1": 0.25, "t1": 0.5, "g2": 0.15, "t2": 5.0})
    kinds = {
        "1_skin": ("uncoupled viscoelastic", "Ogden"),
        "2_soft_tissue": ("uncoupled viscoelastic", "Yeoh"),
        "3_fat": ("viscoelastic", "neo-Hookean"),
    }
    for name, kind in kinds.items():
        inner = found[name].find("elastic")
        assert (found[name].get("type"), inner.get("type")) == kind
        assert numbers(found[name]) == terms
        assert numbers(inner) == pytest.approx(numbers(elastic[name]), rel=1e-11)
        assert float(inner.findtext("density")) == 1e-9


def test_material_cards_have_the_same_numbers():
    """Two writers of one convention: a card has the element of the deck."""
    from palpate_prediction.cards.card import CardData
    from palpate_prediction.cards.programs import PROGRAMS

    job = relaxing_job()
    for name, element in materials_in(SOLVER.write_deck(job, mixed_limb())).items():
        region = {"1_skin": "skin", "2_soft_tissue": "soft tissue", "3_fat": "fat"}.get(name)
        if region is None:
            continue
        material, none = job.materials[region], {}
        origins = {p.name: "fitted" for p in material.parameters}
        card = PROGRAMS["febio"](
            CardData(
                title="",
                region=region,
                material=material,
                theta=job.thetas[region],
                intervals=none,
                strain=none,
                origins=origins,
                verdicts=none,
            )
        )
        written = ET.fromstring(card[card.index("<material") :])
        assert written.get("type") == element.get("type")
        assert numbers(written) == pytest.approx(numbers(element), rel=1e-11)
        assert numbers(written.find("elastic")) == pytest.approx(numbers(element.find("elastic")), rel=1e-11)


def test_times_of_the_moves_are_points_that_febio_must_balance_at():
    root = ET.fromstring(SOLVER.write_deck(relaxing_job(), mixed_limb()))
    curves = [
        np.array([pt.text.split(",") for pt in curve.iterfind("points/pt")], dtype=float)
        for curve in root.iterfind("LoadData/load_controller")
    ]
    depth, turn, longest = curves
    time_s = depth[:, 0]
    assert {0.0, 0.5, 1.0, 5.0, 6.0} <= set(time_s)
    dwell = time_s[(time_s >= 1.0) & (time_s <= 5.0)]
    assert dwell[1] == pytest.approx(1.05)
    assert (np.diff(dwell[1:], 2) > 0.0).all()
    np.testing.assert_allclose(np.interp([0.5, 1.0, 3.0, 5.5], *depth.T), [1.5, 3.0, 3.0, 3.0])
    np.testing.assert_allclose(
        np.interp([5.0, 5.5, 6.0], *turn.T), np.deg2rad([0.0, -11.25, -22.5]), atol=1e-9
    )
    np.testing.assert_array_equal(longest[:, 0], time_s)
    assert (longest[:, 1] == longest[0, 1]).all()
    assert longest[0, 1] == pytest.approx(np.diff(time_s).max())
    control = root.find("Control")
    step, n = float(control.findtext("step_size")), int(control.findtext("time_steps"))
    assert n * step == pytest.approx(6.0)
    assert step <= np.diff(time_s).min() * (1.0 + 1e-9)
    assert float(control.findtext("time_stepper/dtmin")) < np.diff(time_s).min()


def test_a_hold_that_verifies_friction_is_too_short_to_relax():
    steps = steps_of(TIMED, 3, 5.0, fastest_s=0.5)
    held = with_hold(halved(steps), 4, 1e-4)
    assert held.time_s[-5] == 6.0
    assert held.time_s[-1] == pytest.approx(6.0004)
    np.testing.assert_array_equal(halved(steps).time_s[::2], steps.time_s)


@pytest.mark.parametrize(
    ("job", "error", "text"),
    [
        (
            relaxing_job(isochoric=()),
            MaterialError,
            "'ogden'.*whole stress relaxes.*relaxing_stress = \"isochoric",
        ),
        (relaxing_job(isochoric=tuple(MATERIALS)), MaterialError, "'neo_hookean'.*shape alone.*= \"all"),
        (relaxing_job(times_s=tuple(range(1, 8))), MaterialError, "take 6 time constants, and it has 7"),
        (
            relaxing_job(protocol=replace(TIMED, time_s=None)),
            StudyError,
            "needs the times of its press; give durations",
        ),
    ],
)
def test_what_febio_cannot_relax_is_refused(job, error, text):
    with pytest.raises(error, match=text):
        SOLVER.write_deck(job, mixed_limb())


class Stiffening(NeoHookean):
    """A material whose kinds of parameters are wrong: half of its stress is not in proportion to E."""

    name, febio = "stiffening", ("neo-Hookean", {"E": "E", "nu": "v"})

    def energy(self, stretches, theta):
        return super().energy(stretches, theta) * (1.0 + theta[0])


def test_a_stress_that_is_not_in_proportion_to_its_moduli_is_refused():
    job = relaxing_job()
    material = relaxing(Stiffening(), TIMES_S)
    assert isinstance(material, RelaxingMaterial)
    with pytest.raises(MaterialError, match="'stiffening': its stress is not in proportion to its moduli"):
        SOLVER.write_deck(replace(job, materials={**job.materials, "fat": material}), mixed_limb())
