"""The console command ``gcdt``, a module a command.

A package outside of ``lerobot_gcdt``, because importing that one registers its policies with LeRobot and so loads
PyTorch and LeRobot, which takes many seconds. Whoever asks for help or mistypes something is answered without them.
"""

import argparse
import os
import signal
import sys

from gcdt_cli import benchmark, evaluation, export_dvrk, importing, merging, publishing, record, training

COMMANDS = (record, importing, merging, training, evaluation, benchmark, publishing, export_dvrk)


def main(arguments: list[str] | None = None) -> None:
    """Runs ``gcdt``; a bad argument ends with one line and an exit status other than 0."""
    # Threads that wait busily for each other make a training beside other work take up to 40 times as long.
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # read when PyTorch is loaded
    parser = argparse.ArgumentParser(
        prog="gcdt", description="Datasets and policies of the SurRoL tasks.", epilog=record.EXAMPLE
    )
    commands = parser.add_subparsers(dest="command", required=True)
    for module in COMMANDS:
        module.add(commands)
    options = parser.parse_args(arguments)
    before = signal.signal(signal.SIGTERM, _end)
    try:
        options.run(options)
    except KeyboardInterrupt:
        print(f"gcdt {options.command}: interrupted", file=sys.stderr)
        sys.exit(130)  # as shells tell it
    except (ValueError, OSError, RuntimeError) as error:
        sys.exit(f"gcdt {options.command}: {error}")
    except Exception as error:
        from draccus.utils import DecodingError  # here, because most commands end without it

        if not isinstance(error, DecodingError):
            raise
        sys.exit(f"gcdt {options.command}: {error}")  # a checkpoint's settings, such as those of a missing plugin
    finally:
        signal.signal(signal.SIGTERM, before)


def _end(*_: object) -> None:
    """Ends as Ctrl+C does, with the processes that the command has launched, which would go on alone."""
    sys.exit(128 + signal.SIGTERM)  # as shells tell it
