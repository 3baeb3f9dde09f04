"""A node is fixed if conditions hold it in all axes together; every condition is used or named."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from palpate.domain import BoolArray, IntArray
from palpate.errors import MeshError
from palpate.limb.supports import AXES, FixedNodes, Support, fixed_nodes

N = 8
conditions = st.lists(
    st.tuples(st.sets(st.integers(0, N - 1)), st.sets(st.sampled_from(AXES), min_size=1)), max_size=5
)


def supports_of(drawn):
    return [
        Support(name=f"condition {k}", nodes=np.array(sorted(nodes), dtype=int), axes="".join(sorted(axes)))
        for k, (nodes, axes) in enumerate(drawn)
    ]


def fixed_by(supports: list[Support], in_limb: BoolArray, named: IntArray | None) -> FixedNodes:
    return fixed_nodes(Path("m.vtu"), supports, in_limb, named, setting="fixed", there=["bone"])


@given(conditions, st.lists(st.booleans(), min_size=N, max_size=N))
def test_every_condition_on_the_limb_is_used_or_named(drawn, in_limb):
    supports, in_limb = supports_of(drawn), np.array(in_limb)
    held = ({axis for nodes, of in drawn for axis in of if node in nodes} == set(AXES) for node in range(N))
    expected = set(np.flatnonzero(in_limb & np.array(list(held))).tolist())
    if not expected:
        with pytest.raises(MeshError, match=r"no condition of the file holds nodes .* \(there: bone\)"):
            fixed_by(supports, in_limb, None)
        return
    found = fixed_by(supports, in_limb, None)
    fixed = set(found.nodes.tolist())
    assert fixed == expected
    text = " ".join((*found.remarks, *found.warnings))
    for support in supports:
        assert (support.name in text) == bool(in_limb[support.nodes].any())
        here = {n for n in support.nodes.tolist() if in_limb[n]}
        assert any(support.name in warning for warning in found.warnings) == bool(here - fixed)


@given(conditions, st.sets(st.integers(0, N - 1)))
def test_a_condition_that_a_setting_leaves_out_is_named(drawn, chosen):
    supports = supports_of(drawn)
    warnings = fixed_by(supports, np.ones(N, bool), np.array(sorted(chosen), dtype=int)).warnings
    for support in supports:
        is_left_out = bool(set(support.nodes.tolist()) - chosen)
        assert any(support.name in text for text in warnings) == is_left_out
