"""The surgical tasks, one file each."""
