"""Measurements of the policies.

Imports ``lerobot_gcdt.policy``, ``lerobot_gcdt.recording`` and what they stand on.
"""
