"""The console script `ge-torchrl`: what `python -m ge_torchrl` is under another name."""

from ge_torchrl.interrupts import leave_quietly


def main() -> int:
    """Run the command line of the process and return its exit status, as `ge_torchrl.__main__.main` does."""
    leave_quietly()
    from ge_torchrl.__main__ import main as run

    return run()
