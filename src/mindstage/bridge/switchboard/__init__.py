"""Switchboard: the routing inside a hub; knows peers and operations, and no socket."""

from mindstage.bridge.switchboard.peers import PLAIN, Peer, Route
from mindstage.bridge.switchboard.switchboard import Directory, Listing, Switchboard, TopicListing

__all__ = ["PLAIN", "Directory", "Listing", "Peer", "Route", "Switchboard", "TopicListing"]
