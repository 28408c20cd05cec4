"""Switchboard: the routing inside a hub; knows peers and operations, and no socket."""

from mindstage.bridge.switchboard.peers import PLAIN_FORMAT, Peer, ReplyFormat
from mindstage.bridge.switchboard.switchboard import Broker, GraphInfo, ProviderInfo, TopicInfo

__all__ = ["PLAIN_FORMAT", "Broker", "GraphInfo", "Peer", "ProviderInfo", "ReplyFormat", "TopicInfo"]
