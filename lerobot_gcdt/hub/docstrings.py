"""What the docstring of a task says, in pieces: its sections, and what it tells of every number."""

import inspect
import re

INDICES = re.compile(r"\d+(?:, \d+)*|\d+ ?- ?\d+")
"""First cell of a row that describes numbers: one index, several, or a range."""


def sections(env_class: type) -> dict[str, str]:
    """Returns the sections of a docstring by heading, such as ``"Description"``."""
    _, *parts = re.split(r"^## (.+)\n", inspect.getdoc(env_class), flags=re.MULTILINE)
    return dict(zip(parts[::2], map(str.strip, parts[1::2]), strict=True))


def described_numbers(section: str) -> dict[int, list[str]]:
    """Reads the table of a section, whose rows may describe several numbers.

    Args:
        section: Text with a table whose first column holds indices.

    Returns:
        The other cells of the row that describes a number, by index. Numbers that share a row share the list.
    """
    numbers = {}
    for line in section.splitlines():
        first, *cells = [cell.strip() for cell in line.strip("|").split("|")]
        if line.startswith("|") and INDICES.fullmatch(first):
            numbers |= dict.fromkeys(_expand(first), cells)
    return numbers


def remarks(section: str) -> str:
    """Returns what stands below the table of a section."""
    return section.rpartition("|")[2].strip()


def _expand(indices: str) -> list[int]:
    bounds = [int(number) for number in re.findall(r"\d+", indices)]
    return list(range(bounds[0], bounds[1] + 1)) if "-" in indices else bounds
