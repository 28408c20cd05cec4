"""Actions: a goal goes to its provider, feedback and the result come back, a cancel follows it.

A goal whose sender is gone is canceled; one whose provider is gone ends as aborted.
"""

from __future__ import annotations

import asyncio

import msgspec

from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    BridgeLimits,
    CancelActionGoal,
    Compression,
    GoalStatus,
    Id,
    MessageEncoder,
    SendActionGoal,
    StatusLevel,
    UnadvertiseAction,
    content,
)
from mindstage.bridge.switchboard.exchange import PendingRequest, ProviderTable
from mindstage.bridge.switchboard.peers import Peer, ReplyFormat

__all__ = ["ActionRouter"]


class _Goal(PendingRequest):
    wants_feedback = False


class ActionRouter:
    """All actions at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Goal] = ProviderTable("action", limits)
        self._loop = loop
        self._limits = limits
        self._sent: dict[tuple[Peer, Id], Id] = {}
        """Sender and its id, to ours: a cancel names the former."""

    def advertise(self, peer: Peer, offer: AdvertiseAction) -> None:
        """A peer becomes the provider."""
        self.providers.register(peer, offer.action, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseAction) -> None:
        """It is no longer."""
        self.providers.unregister(peer, offer.action)

    def send_goal(self, caller: Peer, request: SendActionGoal) -> None:
        """Passes a goal on, or answers that nothing will come of it."""
        route = ReplyFormat(request.compression or Compression.NONE, request.fragment_size)
        offer = self.providers.find(request.action)
        why = ""
        if offer is None:
            why = f"Action {request.action} does not exist"
        elif self.providers.request_count(caller) >= self._limits.goals and not caller.is_local:
            why = f"{self._limits.goals} of your goals are under way already"
        elif request.id is not None and (caller, request.id) in self._sent:
            why = f"a goal {request.id!r} is under way already"
        if offer is None or why:
            _send_aborted(caller, request.action, request.id, route, why)
            return
        goal = _Goal(name=request.action, id=request.id, caller=caller, provider=offer, reply_format=route)
        goal.wants_feedback = request.feedback
        id = self.providers.add_request(goal)
        if request.id is not None:
            self._sent[caller, request.id] = id
        forwarded = SendActionGoal(
            id=id,
            action=offer.name,
            action_type=request.action_type,
            args=content(request.args),
            feedback=request.feedback,
        )
        offer.peer.deliver(MessageEncoder(forwarded), sender=caller)

    def cancel_goal(self, caller: Peer, request: CancelActionGoal) -> None:
        """Passes a cancel on; of a goal that has ended, nothing is left to cancel."""
        id = self._sent.get((caller, request.id))
        goal = None if id is None else self.providers.pending_request(id)
        if id is None or goal is None:
            caller.send_status(StatusLevel.WARNING, f"no goal {request.id!r} of yours is under way", request.id)
        else:
            _send_cancel(id, goal)

    def forward_feedback(self, provider: Peer, message: ActionFeedback) -> None:
        """Passes on how a goal goes, to a sender who wants to hear it."""
        goal = self.providers.request(provider, message.id)
        if goal is not None and goal.wants_feedback and goal.caller is not None and goal.id is not None:
            passed = ActionFeedback(id=goal.id, action=goal.name, values=content(message.values))
            goal.caller.deliver(MessageEncoder(passed), goal.reply_format)

    def forward_result(self, provider: Peer, result: ActionResult) -> None:
        """Passes on how a goal ended."""
        goal = self.providers.request(provider, result.id)
        if goal is None or result.id is None:
            return
        self._end_goal(result.id, goal)
        if goal.caller is not None:
            passed = ActionResult(
                id=goal.id, action=goal.name, values=content(result.values), status=result.status, result=result.result
            )
            goal.caller.deliver(MessageEncoder(passed), goal.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Cancels what a peer wanted that is gone, and ends what it had still to reach."""
        owed, asked = self.providers.remove_peer(peer)
        for id, goal in owed:
            self._end_goal(id, goal)
            if goal.caller is not peer:
                text = f"the provider of {goal.provider.name} is gone"
                _send_aborted(goal.caller, goal.name, goal.id, goal.reply_format, text)
        for id, goal in asked:
            if goal.provider.peer is not peer:
                self._cancel_orphan(id, goal)

    def _cancel_orphan(self, id: Id, goal: _Goal) -> None:
        """Cancels a goal whose sender is gone, and waits for its end, but not for ever."""
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        goal.caller = None
        _send_cancel(id, goal)
        self._loop.call_later(self._limits.orphaned_goal_timeout_s, self.providers.discard_request, id)

    def _end_goal(self, id: Id, goal: _Goal) -> None:
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        self.providers.pop_request(id)


def _send_cancel(id: Id, goal: _Goal) -> None:
    goal.provider.peer.deliver(MessageEncoder(CancelActionGoal(id=id, action=goal.provider.name)))


def _send_aborted(caller: Peer | None, action: str, id: Id | None, reply_format: ReplyFormat, text: str) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        status = GoalStatus.ABORTED
        caller.deliver(
            MessageEncoder(ActionResult(id=id, action=action, values=values, status=status, result=False)), reply_format
        )
