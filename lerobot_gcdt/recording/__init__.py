"""From episodes to LeRobot datasets: recording, importing, merging, the published collection and its manifest.

Imports the simulator, ``lerobot_gcdt.environment`` and ``lerobot_gcdt.data``; no policy and no
teleoperator: what acts is handed in.
"""

from lerobot_gcdt.recording.demonstrations import record
from lerobot_gcdt.recording.importing import import_demonstrations
from lerobot_gcdt.recording.learners import Learner
from lerobot_gcdt.recording.merging import merge
from lerobot_gcdt.recording.persons import Person

__all__ = ["Learner", "Person", "import_demonstrations", "merge", "record"]
