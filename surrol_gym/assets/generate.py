"""Writes every URDF and OBJ file of this folder: `python -m surrol_gym.assets.generate`.

Running it again gives the same bytes. Everything is in real metres; load with `globalScaling=5`. The dimensions are
those measured on SurRoL's scenes ("facts" and a section number below mean the project's notes, surrol-facts.md); the
shapes are our own.
"""

from pathlib import Path

from surrol_gym.assets import needle, psm, room
from surrol_gym.assets.urdf import GREEN, YELLOW

HERE = Path(__file__).parent


def main(folder: Path = HERE) -> None:
    """Writes all assets into a folder."""
    psm.write_psm(folder, "psm", YELLOW)
    psm.write_psm(folder, "psm2", GREEN)
    room.write_floor(folder)
    room.write_table(folder)
    room.write_tray(folder, "tray", pad=False)
    room.write_tray(folder, "tray_pad", pad=True)
    needle.write_needle(folder)


if __name__ == "__main__":
    main()
