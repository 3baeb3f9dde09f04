"""A node is fixed if conditions hold it in all axes together; every condition is used or named."""

import numpy as np
from hypothesis import given, strategies as st

from palpate.limb.supports import AXES, Support, held_nodes, unused_supports

N = 8
conditions = st.lists(
    st.tuples(st.sets(st.integers(0, N - 1)), st.sets(st.sampled_from(AXES), min_size=1)), max_size=5
)


def supports_of(drawn):
    return [
        Support(name=f"condition {k}", nodes=np.array(sorted(nodes), dtype=int), axes="".join(sorted(axes)))
        for k, (nodes, axes) in enumerate(drawn)
    ]


@given(conditions, st.lists(st.booleans(), min_size=N, max_size=N))
def test_every_condition_on_the_limb_is_used_or_named(drawn, in_limb):
    supports, in_limb = supports_of(drawn), np.array(in_limb)
    found = held_nodes(supports, in_limb)
    fixed = set(found.nodes.tolist())
    for node in range(N):
        axes = {axis for nodes, of in drawn for axis in of if node in nodes}
        assert (node in fixed) == (in_limb[node] and axes == set(AXES))
    text = " ".join((*found.remarks, *found.warnings))
    for support in supports:
        assert (support.name in text) == bool(in_limb[support.nodes].any())
        here = {n for n in support.nodes.tolist() if in_limb[n]}
        assert any(support.name in warning for warning in found.warnings) == bool(here - fixed)


@given(conditions, st.sets(st.integers(0, N - 1)))
def test_a_condition_that_a_setting_leaves_out_is_named(drawn, chosen):
    supports = supports_of(drawn)
    warnings = unused_supports(supports, np.ones(N, bool), np.array(sorted(chosen), dtype=int), "fixed")
    for support in supports:
        is_left_out = bool(set(support.nodes.tolist()) - chosen)
        assert any(support.name in text for text in warnings) == is_left_out
