"""Measurements of the policies: how fast they compute, and how fast they learn.

Imports ``lerobot_gcdt.policy``, ``lerobot_gcdt.recording``, ``lerobot_gcdt.training``, ``lerobot_gcdt.evaluation`` and
what they stand on.
"""
