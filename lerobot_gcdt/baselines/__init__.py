"""Baselines as LeRobot policies, trained on the same data as GCDT.

Imports what ``lerobot_gcdt.policy`` may import, and nothing from there: no baseline rests on what it is compared with.
"""
