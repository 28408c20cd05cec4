"""Guests: which programs are connected over rosbridge, as a stage's own people see it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

from mindstage.bridge import Client, Directory, Hub, Participant
from mindstage.errors import MindstageError
from mindstage.stage import Guest

__all__ = ["guests_at"]

_TRANSPORT = "ROS"


def guests_at(participant: Participant) -> tuple[Guest, ...]:
    """Who is connected to a hub of ours, or the rosbridge that we are connected to."""
    if isinstance(participant, Client):
        return (Guest(name=participant.url, transport=_TRANSPORT, activity=participant.state.value),)
    if not isinstance(participant, Hub) or participant.closed:
        return ()
    try:
        return tuple(_at_hub(participant.directory(), participant.name))
    except MindstageError:  # it is being closed, or has better things to do
        return ()


def _at_hub(directory: Directory, ours: str) -> Iterator[Guest]:
    hears = Counter(name for topic in directory.topics for name in topic.subscribers)
    says = Counter(name for topic in directory.topics for name in topic.publishers)
    offers = Counter(each.provider for each in (*directory.services, *directory.actions))
    for peer in directory.peers:
        if peer != ours:
            parts = ((hears[peer], "topics heard"), (says[peer], "told"), (offers[peer], "services offered"))
            does = ", ".join(f"{count} {what}" for count, what in parts if count)
            yield Guest(name=peer, transport=_TRANSPORT, activity=does or "calls only")
