"""The README is true, short, and leads to every guide."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
GUIDES = sorted((ROOT / "docs").glob("*.md"))
STEPS = ["start", "your data", "your limb", "fit", "certainty", "write it up", "plugins", "reference"]


@pytest.mark.parametrize("target", sorted(set(re.findall(r"\]\(([^)#]+)", README))))
def test_a_file_that_the_readme_links_exists(target: str) -> None:
    assert (ROOT / target).is_file()


def test_the_readme_fits_on_three_screens() -> None:
    assert README.count("\n") <= 150


def test_the_readme_lists_every_guide_by_the_steps_of_a_reader() -> None:
    rows = re.findall(r"^\| ([\w ]*) ?\| \[[^\]]+\]\(([^)]+)\) \|", README, flags=re.MULTILINE)
    assert [step.strip() for step, _ in rows if step.strip()] == STEPS
    assert {path for _, path in rows} >= {f"docs/{guide.name}" for guide in GUIDES}


@pytest.mark.parametrize("guide", [*GUIDES, ROOT / "plugins" / "README.md"], ids=lambda path: path.stem)
def test_a_guide_opens_with_what_the_reader_can_do_afterwards(guide: Path) -> None:
    _, first, *_ = guide.read_text(encoding="utf-8").split("\n\n")
    assert first.startswith("After this guide you can ")
    assert first.count(".") == 1


@pytest.mark.parametrize(
    ("study", "time", "in_words"), [("first-press", "45 s", "45 s"), ("forearm-demo", "12 min", "12 minutes")]
)
def test_a_ready_study_takes_one_time(study: str, time: str, in_words: str) -> None:
    guides = {guide.stem: guide.read_text(encoding="utf-8") for guide in GUIDES}
    assert re.search(rf"^\| \[{study}\].*\| {time} \|$", guides["studies"], flags=re.MULTILINE)
    folder = ROOT / "plugins" / "palpate-forearm" / "src" / "palpate_forearm"
    for text in (README, (folder / "studies" / study / "README.md").read_text(encoding="utf-8")):
        assert in_words in text
    if study == "forearm-demo":
        assert in_words in (folder / "__init__.py").read_text(encoding="utf-8")
    assert f"`{study}` takes" not in guides["runs"]
    assert not re.search(r"How long does a run take\?[^?]*(?:minute|second)", guides["faq"])
