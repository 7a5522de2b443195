"""PegTransfer: grasp a wall of the block, lift, carry, lower, let go, retreat."""

from surrol_gym.envs.goal_env import Reading
from surrol_gym.experts import Target
from surrol_gym.experts.blocks import Block, Hand
from surrol_gym.tasks.peg_board import REST, is_on_peg
from surrol_gym.tasks.peg_transfer import PegTransferEnv

PEG_TIP = 0.07
"""Height of a peg's tip above its frame, su."""


def law(seen: Reading) -> Target:
    """Recognises each phase from the state; a block that fell over is stood up at the goal's peg."""
    goal = seen.goal_block
    rest = goal - (0.0, 0.0, REST)
    block = Block(seen.block, seen.wall_rpy, ground=rest[2], tip=goal[2] + PEG_TIP)
    hand = Hand(seen.psm1, seen.psm1_yaw, seen.psm1_jaw, block, PegTransferEnv.mounts[0].limits())
    # Once the peg is in the hole the block falls the rest of the way; a tilted one might jam if it were lowered.
    if block.is_threaded(goal) or (is_on_peg(block.centre, goal) and not hand.holds):
        return hand.retreat()
    if not hand.holds:
        return hand.grasp()
    return hand.carry(rest) if block.stands else hand.lay_across(goal[:2])
