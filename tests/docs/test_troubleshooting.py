"""Guides with tables of symptoms quote what palpate prints."""

import re
from pathlib import Path

ROOT = Path(__file__).parents[2]
GUIDES = [(ROOT / "docs" / f"{name}.md").read_text(encoding="utf-8") for name in ("troubleshooting", "mri")]
PLACEHOLDER = r"\{[^\n]{1,160}?\}"


def sources() -> str:
    """Code of the core and of all plugins, with each string that is split over lines in one."""
    files = (file for of in ("python/palpate", "plugins/*/src") for file in ROOT.glob(f"{of}/**/*.py"))
    text = "\n".join(file.read_text(encoding="utf-8") for file in files if "testing" not in file.parts)
    return re.sub(r"""["']\s*\n\s*f?["']""", "", text)


def is_printed(message: str, code: str) -> bool:
    return re.search(PLACEHOLDER.join(map(re.escape, message.split("…"))), code) is not None


def test_every_message_that_is_quoted_is_in_the_code() -> None:
    code = sources()
    cells = [cell for guide in GUIDES for cell in re.findall(r"^\| (`[^|]+) \|", guide, flags=re.MULTILINE)]
    quoted = [message for cell in cells for message in re.findall(r"`([^`]+)`", cell)]
    assert len(cells) > 50
    assert [message for message in quoted if not is_printed(message.removeprefix("… "), code)] == []
    assert not is_printed(f"{quoted[0]}, or is it", code)
