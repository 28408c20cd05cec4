"""Fixtures of the bridge, whose server is the simplest that has a gate."""

from tests.bridge.conftest import local_node, make_raw_client, server

__all__ = ["local_node", "make_raw_client", "server"]
