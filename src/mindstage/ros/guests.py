"""Guests: which programs are connected over rosbridge, as a stage's own people see it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mindstage.bridge import GraphInfo, LocalNode, Node, RosbridgeClient
from mindstage.errors import MindstageError
from mindstage.stage import ConnectedClient

__all__ = ["connected_clients"]

_TRANSPORT = "ROS"


def connected_clients(node: Node) -> tuple[ConnectedClient, ...]:
    """Who is connected to a hub of ours, or the rosbridge that we are connected to."""
    if isinstance(node, RosbridgeClient):
        return (ConnectedClient(name=node.url, transport=_TRANSPORT, activity=node.state.value),)
    if not isinstance(node, LocalNode) or node.closed:
        return ()
    try:
        return tuple(_hub_clients(node.graph_info(), node.name))
    except MindstageError:  # it is being closed, or has better things to do
        return ()


def _hub_clients(graph: GraphInfo, own_name: str) -> Iterator[ConnectedClient]:
    hears = Counter(name for topic in graph.topics for name in topic.subscribers)
    says = Counter(name for topic in graph.topics for name in topic.publishers)
    offers = Counter(each.provider for each in (*graph.services, *graph.actions))
    for peer in graph.peers:
        if peer != own_name:
            parts = ((hears[peer], "topics heard"), (says[peer], "told"), (offers[peer], "services offered"))
            does = ", ".join(f"{count} {what}" for count, what in parts if count)
            yield ConnectedClient(name=peer, transport=_TRANSPORT, activity=does or "calls only")
