"""Writes every URDF and OBJ file of `surrol_gym/assets`: `python -m tools.assets.generate [FOLDER]`.

Run it in the root of the repository; running it again gives the same bytes. Everything is in real metres; load with
`globalScaling=5`. The dimensions are those measured on SurRoL's scenes
(docs/objects.md); the shapes are our own.
"""

import sys
from pathlib import Path

from surrol_gym.bullet import ASSETS
from tools.assets import boards, glyphs, needle, pegs, psm, room
from tools.assets.urdf import GREEN, YELLOW


def main(folder: Path) -> None:
    """Writes all assets into a folder."""
    psm.write_psm(folder, "psm", YELLOW)
    psm.write_psm(folder, "psm2", GREEN)
    psm.write_gripper(folder)
    room.write_floor(folder)
    room.write_goal(folder)
    room.write_table(folder)
    room.write_tray(folder, "tray", pad=False)
    room.write_tray(folder, "tray_pad", pad=True)
    needle.write_needle(folder)
    pegs.write_gauze(folder)
    pegs.write_block(folder, "block", pegs.BLUE)
    pegs.write_block(folder, "block_red", pegs.RED)
    pegs.write_peg_board(folder, "peg_board_tall", top=0.0362)
    pegs.write_peg_board(folder, "peg_board_short", top=0.0306)
    pegs.write_ring_board(folder)
    pegs.write_ring(folder, "ring", pegs.BLUE)
    pegs.write_ring(folder, "ring_red", pegs.RED)
    glyphs.write_glyphs(folder)
    boards.write_match_panel(folder)
    boards.write_match_board(folder)
    boards.write_pots(folder)
    boards.write_jacks(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if sys.argv[1:] else ASSETS)
