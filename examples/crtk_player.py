"""Plays a trajectory of `gcdt export-dvrk` on a da Vinci Research Kit, over its CRTK client.

No real robot was ever moved with this: read docs/dvrk.md first. All but a dry run needs ROS with crtk, dvrk and PyKDL.
python3 examples/crtk_player.py outputs/peg_transfer_dvrk/trajectory.npz --speed 0.2 --dry_run
"""

import argparse
import select
import sys
import time
from itertools import product

import numpy as np

LOST, LONGEST_PERIOD = 0.25, 0.1  # seconds: without a measurement, which ends the motion; between two set-points


def main(arguments: list[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=argparse.FileType("rb"), help="trajectory.npz")
    parser.add_argument("--speed", type=float, default=0.2, help="share of the trajectory's speed (default 0.2)")
    parser.add_argument("--dry_run", action="store_true", help="print what would be sent; needs no ROS")
    options = parser.parse_args(arguments)
    file = dict(np.load(options.file))
    slowest = 1 / (LONGEST_PERIOD * file["rate"])
    if not slowest <= options.speed <= 1:
        parser.error(f"--speed must be {slowest:g} (slower, commands time out) to 1; got {options.speed:g}")
    names, count, period = file["arms"].tolist(), len(file["time"]), 1 / (file["rate"] * options.speed)
    print(f"{', '.join(names)}: {count} set-points in {count * period:.1f} s")
    if options.dry_run:
        for index, arm in product(range(0, count, round(1 / period)), names):
            told = np.round((*file[f"{arm}_position"][index], *file[f"{arm}_quaternion"][index]), 4).tolist()
            print(f"{index * period:7.1f} s  {arm}  {told}, jaws {file[f'{arm}_jaw'][index]:.3f} rad")
        return
    play(names, file, period)


def play(names: list[str], file: dict, period: float) -> None:
    try:
        import crtk
        import dvrk
        import PyKDL as kdl
    except ImportError as error:
        sys.exit(f"{error}: build the dVRK's ROS 2 workspace (docs/dvrk.md#play) and source its setup.bash.")
    ral = crtk.ral("gcdt_player")
    arms = {name: dvrk.psm(ral, name) for name in names}
    ral.check_connections()
    ral.spin()
    poses, heard = {}, dict.fromkeys(arms, (0.0, 0.0))
    for name, arm in arms.items():
        (there, stamp), (local, local_stamp) = arm.setpoint_cp(), arm.local.setpoint_cp()
        if 0 in (stamp, local_stamp) or "ENABLED" not in arm.operating_state():
            sys.exit(f"{name} is {arm.operating_state()}, or has no valid pose. Home and enable it. Nothing was moved.")
        pairs = zip(file[f"{name}_position"].tolist(), file[f"{name}_quaternion"].tolist(), strict=True)
        base = there * local.Inverse()  # the arm's base frame, whichever was set
        poses[name] = [base * kdl.Frame(kdl.Rotation.Quaternion(*turn), kdl.Vector(*at)) for at, turn in pairs]
    if input("Approach the start? Type yes: ") != "yes":
        sys.exit("Nothing was moved.")
    for name, arm in arms.items():
        arm.move_cp(poses[name][0]).wait()
        arm.jaw.move_jp(file[f"{name}_jaw"][:1]).wait()
    if input("Play? The enter key stops. Type yes: ") != "yes":
        sys.exit("The arms stay at the start.")
    try:
        for index in range(len(file["time"])):
            for name, arm in arms.items():
                stamp, now = arm.measured_cp()[1], time.monotonic()  # 0 if invalid; a TimeoutError if too old
                heard[name] = heard[name] if stamp in (0, heard[name][0]) else (stamp, now)
                key, lost = select.select([sys.stdin], [], [], 0)[0], now - heard[name][1] > LOST
                if key or lost or "ENABLED" not in arm.operating_state():
                    sys.exit(f"Stopped at set-point {index}: {'a key' if key else f'{name} is silent or not enabled'}.")
                arm.servo_cp(poses[name][index])
                arm.jaw.servo_jp(file[f"{name}_jaw"][index : index + 1])
            time.sleep(period)  # never catches up, so that nothing is faster than it was checked for
    finally:
        [arm.hold() for arm in arms.values()]


if __name__ == "__main__":
    main()
