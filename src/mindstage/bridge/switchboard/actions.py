"""Actions: a goal goes to its provider, feedback and the result come back, a cancel follows it.

A goal whose sender is gone is cancelled; one whose provider is gone ends as aborted.
"""

from __future__ import annotations

import asyncio

import msgspec

from mindstage.bridge.protocol import (
    ActionFeedback,
    ActionResult,
    AdvertiseAction,
    CancelActionGoal,
    Compression,
    GoalStatus,
    Id,
    Level,
    Limits,
    Outgoing,
    SendActionGoal,
    UnadvertiseAction,
    content,
)
from mindstage.bridge.switchboard.exchange import Exchange, Request
from mindstage.bridge.switchboard.peers import Peer, Route

__all__ = ["Actions"]


class _Goal(Request):
    wants_feedback = False


class Actions:
    """All actions at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: Limits) -> None:
        self.exchange: Exchange[_Goal] = Exchange("action", limits)
        self._loop = loop
        self._limits = limits
        self._sent: dict[tuple[Peer, Id], Id] = {}
        """Sender and its id, to ours: a cancel names the former."""

    def advertise(self, peer: Peer, offer: AdvertiseAction) -> None:
        """A peer becomes the provider."""
        self.exchange.offer(peer, offer.action, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseAction) -> None:
        """It is no longer."""
        self.exchange.withdraw(peer, offer.action)

    def send(self, caller: Peer, order: SendActionGoal) -> None:
        """Passes a goal on, or answers that nothing will come of it."""
        route = Route(order.compression or Compression.NONE, order.fragment_size)
        offer = self.exchange.find(order.action)
        why = ""
        if offer is None:
            why = f"Action {order.action} does not exist"
        elif self.exchange.asked_by(caller) >= self._limits.goals and not caller.local:
            why = f"{self._limits.goals} of your goals are under way already"
        elif order.id is not None and (caller, order.id) in self._sent:
            why = f"a goal {order.id!r} is under way already"
        if offer is None or why:
            _abort(caller, order.action, order.id, route, why)
            return
        goal = _Goal(name=order.action, id=order.id, caller=caller, offer=offer, route=route)
        goal.wants_feedback = order.feedback
        id = self.exchange.begin(goal)
        if order.id is not None:
            self._sent[caller, order.id] = id
        forwarded = SendActionGoal(
            id=id, action=offer.name, action_type=order.action_type, args=content(order.args), feedback=order.feedback
        )
        offer.provider.deliver(Outgoing(forwarded), sender=caller)

    def cancel(self, caller: Peer, order: CancelActionGoal) -> None:
        """Passes a cancel on; of a goal that has ended, nothing is left to cancel."""
        id = self._sent.get((caller, order.id))
        goal = None if id is None else self.exchange.request_of(id)
        if id is None or goal is None:
            caller.remark(Level.WARNING, f"no goal {order.id!r} of yours is under way", order.id)
        else:
            _cancel(id, goal)

    def feedback(self, provider: Peer, told: ActionFeedback) -> None:
        """Passes on how a goal goes, to a sender who wants to hear it."""
        goal = self.exchange.request(provider, told.id)
        if goal is not None and goal.wants_feedback and goal.caller is not None and goal.id is not None:
            passed = ActionFeedback(id=goal.id, action=goal.name, values=content(told.values))
            goal.caller.deliver(Outgoing(passed), goal.route)

    def result(self, provider: Peer, result: ActionResult) -> None:
        """Passes on how a goal ended."""
        goal = self.exchange.request(provider, result.id)
        if goal is None or result.id is None:
            return
        self._end(result.id, goal)
        if goal.caller is not None:
            passed = ActionResult(
                id=goal.id, action=goal.name, values=content(result.values), status=result.status, result=result.result
            )
            goal.caller.deliver(Outgoing(passed), goal.route)

    def leave(self, peer: Peer) -> None:
        """Cancels what a peer wanted that is gone, and ends what it had still to reach."""
        owed, asked = self.exchange.leave(peer)
        for id, goal in owed:
            self._end(id, goal)
            if goal.caller is not peer:
                text = f"the provider of {goal.offer.name} is gone"
                _abort(goal.caller, goal.name, goal.id, goal.route, text)
        for id, goal in asked:
            if goal.offer.provider is not peer:
                self._orphan(id, goal)

    def _orphan(self, id: Id, goal: _Goal) -> None:
        """Cancels a goal whose sender is gone, and waits for its end, but not for ever."""
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        goal.caller = None
        _cancel(id, goal)
        self._loop.call_later(self._limits.orphaned_goal_s, self.exchange.forget, id)

    def _end(self, id: Id, goal: _Goal) -> None:
        if goal.caller is not None and goal.id is not None:
            self._sent.pop((goal.caller, goal.id), None)
        self.exchange.end(id)


def _cancel(id: Id, goal: _Goal) -> None:
    goal.offer.provider.deliver(Outgoing(CancelActionGoal(id=id, action=goal.offer.name)))


def _abort(caller: Peer | None, action: str, id: Id | None, route: Route, text: str) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        status = GoalStatus.ABORTED
        caller.deliver(Outgoing(ActionResult(id=id, action=action, values=values, status=status, result=False)), route)
