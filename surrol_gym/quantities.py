"""What the numbers of observations, goals and actions are: said once, as data.

Names of recorded features, tables of docstrings and cards, and the experts' reading of observations come from it.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

XYZ, RPY = ("x", "y", "z"), ("roll", "pitch", "yaw")


@dataclass(frozen=True)
class Quantity:
    """Numbers that belong together, such as the coordinates of a point.

    Attributes:
        name: What the names of its numbers begin with.
        meaning: What it is, for tables; of a goal, what is achieved.
        components: What the names of its numbers end in; a single number may have the name alone.
        unit: Unit of its numbers; of an action, what 1 does.
        wanted: Of a goal: what is desired.
        derived_from: Keys of the quantities that it is computed from: one that it repeats, or two of which it is the
            difference, the first minus the second. Empty where it is measured by itself.
    """

    name: str
    meaning: str
    components: tuple[str, ...] = ()
    unit: str = ""
    wanted: str = ""
    derived_from: tuple[str, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The name of each number."""
        return tuple(f"{self.name}_{component}" for component in self.components) or (self.name,)

    @property
    def key(self) -> str:
        """The name by which ``GoalEnv.read`` gives all of its numbers."""
        return f"{self.name}_rpy" if self.components == RPY else self.name


def point(name: str, meaning: str, wanted: str = "", derived_from: tuple[str, ...] = ()) -> Quantity:
    """Describes a position in the world frame, ``<name>_x`` and so on, su."""
    return Quantity(name, meaning, XYZ, "su", wanted, derived_from)


def euler(name: str, meaning: str) -> Quantity:
    """Describes fixed-axis x-y-z Euler angles, ``<name>_roll`` and so on, radians."""
    return Quantity(name, meaning, RPY, "rad")


def names(quantities: Iterable[Quantity]) -> tuple[str, ...]:
    """Returns the name of each number."""
    return tuple(name for quantity in quantities for name in quantity.names)


def repeated_names(quantities: Iterable[Quantity]) -> list[str]:
    """Returns the names that several quantities have, of numbers or as a whole."""
    counts = Counter(name for quantity in quantities for name in {*quantity.names, quantity.key})
    return sorted(name for name, count in counts.items() if count > 1)


def table(titles: Sequence[str], rows: Iterable[Sequence]) -> str:
    """Returns a table as Markdown; rows may be shorter than the titles."""
    lines = [titles, ["---"] * len(titles), *([*row, *[""] * (len(titles) - len(row))] for row in rows)]
    return "\n".join("|" + "".join(f" {cell} |" if cell != "" else " |" for cell in line) for line in lines)


def described(quantities: Iterable[Quantity], *titles: str) -> str:
    """Returns a Markdown table with the indices, names, meaning and unit of each quantity, under four titles."""
    rows, start = [], 0
    for quantity in quantities:
        indices = range(start, start := start + len(quantity.names))
        listed = ", ".join(map(str, indices)), ", ".join(f"`{name}`" for name in quantity.names)
        rows.append((*listed, quantity.meaning, quantity.unit))
    return table(titles, rows)


def places(quantities: Iterable[Quantity]) -> dict[str, int | slice]:
    """Returns where a vector holds each number and each quantity, by name."""
    found: dict[str, int | slice] = {}
    start = 0
    for quantity in quantities:
        end = start + len(quantity.names)
        found |= dict(zip(quantity.names, range(start, end), strict=True))
        if quantity.components:
            found[quantity.key] = slice(start, end)
        start = end
    return found
