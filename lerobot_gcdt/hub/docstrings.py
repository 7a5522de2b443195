"""What the docstring of a task says, in pieces."""

import inspect
import re


def sections(env_class: type) -> dict[str, str]:
    """Returns the sections of a docstring by heading, such as ``"Description"``."""
    _, *parts = re.split(r"^## (.+)\n", inspect.getdoc(env_class) or "", flags=re.MULTILINE)
    return dict(zip(parts[::2], map(str.strip, parts[1::2]), strict=True))


def remarks(section: str) -> str:
    """Returns what stands below the table of a section."""
    return section.rpartition("|")[2].strip()
