"""Reads XML that may come from anybody.

No document type, so no entities, no bombs and no other files; no more than a
certain size and depth. Every message has the line.
"""

import xml.etree.ElementTree as ET
from pathlib import Path
from xml.parsers import expat

from palpate.api import MeshError

LARGEST_FILE_BYTES = 2_000_000_000
DEEPEST = 64


def parse_xml(path: Path, text: bytes) -> ET.Element:
    """The root element of a document.

    Parameters
    ----------
    path : Path
        Named in messages.
    text : bytes

    Raises
    ------
    MeshError
        Not well-formed, or with a document type; naming the line.
    """
    parser, tree = expat.ParserCreate(), ET.TreeBuilder()
    depth = 0

    def start(tag: str, attributes: dict[str, str]) -> None:
        nonlocal depth
        depth += 1
        if depth > DEEPEST:
            raise ValueError(f"elements are nested more than {DEEPEST} deep")
        tree.start(tag, attributes)

    def end(tag: str) -> None:
        nonlocal depth
        depth -= 1
        tree.end(tag)

    def refuse(*_: object) -> None:
        raise ValueError("a document type declaration, which could define entities; remove it")

    parser.buffer_text = True
    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.CharacterDataHandler = tree.data
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
        root: ET.Element = tree.close()
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise MeshError(
            f"{path}: line {parser.CurrentLineNumber}: not XML that can be read safely ({error}); "
            "write the deck again"
        ) from None
    return root


def read_xml(path: Path) -> ET.Element:
    """The root element of a file.

    Raises
    ------
    MeshError
        The file is missing, too large, or :func:`parse_xml` refuses it.
    """
    if not path.is_file():
        raise MeshError(f"{path}: no such file; check the path of the deck")
    if path.stat().st_size > LARGEST_FILE_BYTES:
        raise MeshError(f"{path}: larger than {LARGEST_FILE_BYTES:,} bytes; is this a deck?")
    return parse_xml(path, path.read_bytes())
