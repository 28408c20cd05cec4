"""Limits: how much one end of a connection lets the other one ask for.

Every queue, table and wait of the bridge has its bound here, so that no peer can fill the memory or keep the loop.
"""

from __future__ import annotations

import msgspec

__all__ = ["DEFAULT_LIMITS", "BridgeLimits"]

_MIB = 1 << 20


class BridgeLimits(msgspec.Struct, frozen=True, kw_only=True):
    """The defaults are generous for a robot and its tools, and small beside a machine's memory."""

    message_bytes: int = 32 * _MIB
    """One message, after its fragments were joined and its compression undone."""
    png_bytes: int = 1 * _MIB
    """What one PNG may hold: undoing its filters is slow work for Python."""
    cbor_bytes: int = 8 * _MIB
    """One binary frame: its typed arrays become many times larger while they are read."""
    depth: int = 64
    """How deep arrays and objects may nest."""
    fragments: int = 4096
    """Of one message, in both directions."""
    fragmented_messages: int = 16
    """Begun and not yet complete, of one connection."""
    fragment_timeout_s: float = 30.0
    """A message whose next fragment does not come for so long is forgotten [s]."""
    connections: int = 256
    """At one server."""
    calls: int = 256
    """Service calls of one client that wait for their answer."""
    goals: int = 64
    """Action goals of one client that are under way."""
    orphaned_goal_timeout_s: float = 60.0
    """So long does the hub wait for the end of a goal that it canceled because its sender is gone [s]."""
    advertisements: int = 1024
    """Services, actions and topics that one client may offer."""
    subscriptions: int = 1024
    """Of one client."""
    waiting_messages: int = 16384
    """Ready to be sent to one peer; a peer that reads so slowly that there are more is dropped."""
    waiting_bytes: int = 64 * _MIB
    """The same, counted in bytes."""
    call_timeout_s: float = 10.0
    """A service call that names no timeout has this one [s]."""
    max_call_timeout_s: float = 3600.0
    """No call may wait longer, whatever it names [s]."""
    auth_timeout_s: float = 10.0
    """So long may a client that needs a token take to show it [s]."""


DEFAULT_LIMITS = BridgeLimits()
"""What holds where nobody says otherwise."""
