"""Laws of scenarios."""

from collections.abc import Collection

import pytest

from palpate.domain import Scenario, channel_of
from palpate.testing.components import missing


class ScenarioContract:
    """Laws of a scenario; override ``scenario``, and ``channels`` where they are your own."""

    @pytest.fixture
    def scenario(self) -> Scenario:
        """Provide the scenario under test."""
        missing("scenario", type(self).__name__)

    @pytest.fixture
    def channels(self) -> Collection[str]:
        """Provide the names of all channels: those of every installed plugin."""
        from palpate.plugins.catalogue import Plugins

        return set(Plugins.load().channels)

    def test_says_what_it_is(self, scenario: Scenario) -> None:
        assert scenario.name.strip(), "a scenario needs a name"
        assert scenario.description.strip(), f"scenario '{scenario.name}' needs a description"

    def test_weighs_channels_that_exist(self, scenario: Scenario, channels: Collection[str]) -> None:
        unknown = sorted(set(map(channel_of, scenario.weights)) - set(channels))
        assert not unknown, (
            f"scenario '{scenario.name}' weighs {', '.join(unknown)}, which no plugin declares "
            f"(known: {', '.join(sorted(channels))}); correct the name, or declare the channel"
        )
