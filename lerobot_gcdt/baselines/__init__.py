"""Baselines as LeRobot policies, trained on the same data as GCDT."""
