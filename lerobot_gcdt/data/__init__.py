"""Datasets in memory: the trajectory bank, what is drawn from it, sizes of tasks, episodes that are trained on.

Everything that learns from datasets stands on this room. It imports the keys alone and knows neither the simulator nor
any policy.
"""
