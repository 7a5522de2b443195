"""Publishing on the Hub: the checks before it, the cards of datasets and policies, sections that commands write.

Imports the rooms that make what is published: ``lerobot_gcdt.recording``, ``lerobot_gcdt.training`` and
``lerobot_gcdt.evaluation``, with what they stand on; no policy.
"""
