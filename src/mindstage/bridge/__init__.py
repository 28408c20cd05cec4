"""Bridge: the rosbridge v2 protocol, its typed messages, and the connection for both of its ends."""

__all__: list[str] = []
