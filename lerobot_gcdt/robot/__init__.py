"""Arms as robots: from episodes to set-points of a da Vinci Research Kit, with a safety report, and back.

Imports the simulator, ``lerobot_gcdt.environment`` and ``lerobot_gcdt.evaluation``.
"""
