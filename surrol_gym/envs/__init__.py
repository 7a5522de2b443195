"""Bases of the ten tasks: the goal environment, the arms' action semantics, the grasping rule."""
