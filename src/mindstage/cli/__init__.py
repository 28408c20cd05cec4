"""The `mindstage` command. Each verb parses its options, calls the library and prints the result."""

from mindstage.cli.termination import terminable

__all__ = ["main"]


def main() -> None:
    """Runs the command line and exits the process, with 143 if SIGTERM is received at any time."""
    with terminable():  # before the imports, which take most of the time of some verbs
        from mindstage.cli.app import main as run

        run()
