"""Arms as robots: from episodes to set-points of a da Vinci Research Kit, with a safety report, and back.

And as robots of LeRobot's, simulated (``surrol_psm``) and real (``dvrk_psm``), with a keyboard to move them.

Imports the simulator, ``lerobot_gcdt.environment``, ``lerobot_gcdt.evaluation``, ``lerobot_gcdt.recording`` and
``lerobot_gcdt.data``.
"""
