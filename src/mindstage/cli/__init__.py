"""Command line: each verb parses, calls a room, and prints what came of it."""

from mindstage.cli.app import main

__all__ = ["main"]
