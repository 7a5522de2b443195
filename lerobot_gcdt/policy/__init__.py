"""GCDT: configuration, model and processors, each where LeRobot looks for it, and the parts of the model.

Imports ``lerobot_gcdt.data``, the keys and the errors: a policy is trained and loaded without PyBullet.
"""
