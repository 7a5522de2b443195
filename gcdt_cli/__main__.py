"""``python -m gcdt_cli``."""

from gcdt_cli import main

main()
