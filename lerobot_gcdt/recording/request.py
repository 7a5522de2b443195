"""What is asked of a recording."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from lerobot_gcdt.recording.features import Extras


@dataclass(frozen=True)
class Recording:
    """What was asked for; two recordings with equal fields give the same dataset.

    Attributes:
        env_id: The environment, with the module that registers it where that was named: makes it in any process.
        episodes: How many successful episodes.
        seed: Seed of the first episode; the following ones count up, failures are left out.
        disturb: Size of the pushes that divert the arm, in units of an action; 0 for none.
        extras: What is recorded beside what every dataset holds.
        package_version: Version of this package.
        policy: The policy that acts in the expert's place; None where the expert always acts.
        mix: Probability of the expert's action where the policy acts.
        human: Teleoperator with which a person acted; None where no person did.
        sensors: Arguments of the imperfect sensors that observations are recorded through; None for perfect ones.
        push_rate: Share of the steps that are pushed; None without pushes.
    """

    env_id: str
    episodes: int
    seed: int
    disturb: float
    extras: Extras
    package_version: str
    policy: str | None = None
    mix: float | None = None
    human: str | None = None
    sensors: dict[str, Any] | None = None
    push_rate: float | None = None

    def facts(self) -> dict:
        """Returns what files say of it: a policy and a person only where there is one."""
        return {name: value for name, value in asdict(self).items() if value is not None}

    def check_same(self, note: Path, folder: Path) -> None:
        """Raises ValueError unless a note says that its folder is the one of this recording."""
        if not note.exists():
            raise ValueError(f"{folder} exists and was not written by `gcdt record`; choose another --root.")
        found = json.loads(note.read_text())
        for name, value in asdict(self).items():
            if found.get(name) != value:
                raise ValueError(
                    f"{folder} holds a recording with {name} = {found.get(name)!r}, not {value!r}; choose another "
                    "--root or remove it."
                )
