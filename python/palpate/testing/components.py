"""What holds for everything that a plugin provides."""

import pickle
import re
from typing import Never

import pytest

from palpate.domain.component import Component
from palpate.units import Quantity

DIMENSIONAL = re.compile(
    r"time|duration|length|distance|radius|diameter|depth|height|width|thickness|angle|rotation|edge|size|memory"
    r"|_(s|mm|m|deg|rad|MB|GB)$"
)
"""Names of settings whose value has a unit."""


def missing(fixture: str, contract: str) -> Never:
    """Fail, because a plugin's suite has to override a fixture."""
    pytest.fail(f"{contract}: override the fixture '{fixture}'")


def check_described(component: Component) -> None:
    """Assert that name, summary and every setting say what they are."""
    assert component.name.isidentifier(), f"name {component.name!r} must be an identifier"
    assert component.summary.strip(), f"'{component.name}' needs a summary"
    for name, field in type(component.settings).model_fields.items():
        said = f"setting '{name}' of '{component.name}'"
        assert field.description, f"{said} needs a description"
        if "float" in str(field.annotation) and DIMENSIONAL.search(name):
            typed = any(isinstance(each, Quantity) for each in field.metadata)
            assert typed or "[" in field.description, (
                f"{said}: a time, length, angle or size needs its unit; write [mm] in the description, "
                'or annotate it as Annotated[float, Quantity("mm")]'
            )


class ComponentContract:
    """What holds for every component."""

    @pytest.fixture
    def component(self) -> Component:
        """Provide the component under test; each contract fills it in."""
        missing("component", type(self).__name__)

    def test_says_what_it_is(self, component: Component) -> None:
        check_described(component)

    def test_travels_to_another_process(self, component: Component) -> None:
        copy = pickle.loads(pickle.dumps(component))
        assert type(copy) is type(component)
        assert copy.settings == component.settings
