"""The `mindstage` command. Each verb parses its options, calls the library and prints the result."""

from mindstage.cli.app import main

__all__ = ["main"]
