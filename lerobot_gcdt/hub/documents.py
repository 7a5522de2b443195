"""Sections that a command writes into a document: from ``<!-- name: its command -->`` to ``<!-- end of name -->``."""

import re
from pathlib import Path


def read_section(file: Path, name: str) -> str:
    """Returns the text of a section.

    Args:
        file: The document.
        name: Name of the section.

    Raises:
        ValueError: The document has no such section.
    """
    return _split(file, name)[1]


def write_section(file: Path, name: str, text: str) -> None:
    """Replaces the text of a section, whole lines; see ``read_section``."""
    before, _, after = _split(file, name)
    file.write_text(before + text + after)


def _split(file: Path, name: str) -> tuple[str, str, str]:
    """The document up to the section, the section, and the rest."""
    parts = re.fullmatch(rf"(.*<!-- {name}: [^\n]*-->\n)(.*)(<!-- end of {name} -->.*)", file.read_text(), re.DOTALL)
    if parts is None:
        raise ValueError(f"{file} has no section <!-- {name}: ... --> that ends with <!-- end of {name} -->.")
    return parts[1], parts[2], parts[3]
