"""The tasks of ``surrol_gym`` as LeRobot's environment type ``surrol``, with the names of our datasets' columns.

Imports the simulator, the keys and the errors.
"""
