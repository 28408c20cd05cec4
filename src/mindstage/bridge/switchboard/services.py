"""Services: a call goes to its provider, the answer back to its caller; every call gets exactly one, in time."""

from __future__ import annotations

import asyncio

import msgspec

from mindstage.bridge.names import resolved
from mindstage.bridge.protocol import (
    AdvertiseService,
    CallService,
    Compression,
    Id,
    Level,
    Limits,
    Outgoing,
    ServiceResponse,
    UnadvertiseService,
    content,
)
from mindstage.bridge.switchboard.exchange import Exchange, Offer, Request
from mindstage.bridge.switchboard.peers import Peer, Route
from mindstage.errors import ServiceUnknown

__all__ = ["Services"]


class _Call(Request):
    timer: asyncio.TimerHandle


class Services:
    """All services at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: Limits) -> None:
        self.exchange: Exchange[_Call] = Exchange("service", limits)
        self.patience_s: dict[str, float] = {}
        """Instead of the limits' `call_s`, for services that are known to take longer [s]."""
        self._loop = loop
        self._limits = limits

    def advertise(self, peer: Peer, offer: AdvertiseService) -> None:
        """A peer becomes the provider."""
        self.exchange.offer(peer, offer.service, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseService) -> None:
        """It is no longer."""
        self.exchange.withdraw(peer, offer.service)

    def call(self, caller: Peer, call: CallService) -> None:
        """Passes a call on, or answers it with an error."""
        route = Route(call.compression or Compression.NONE, call.fragment_size)
        offer = self.exchange.find(call.service)
        if offer is None:
            unknown = ServiceUnknown(call.service, known=self.exchange.names)
            _answer_error(caller, call.service, call.id, route, str(unknown))
        elif self.exchange.asked_by(caller) >= self._limits.calls and not caller.local:
            _answer_error(caller, call.service, call.id, route, f"{self._limits.calls} of your calls wait already")
        else:
            self._pass_on(caller, call, offer, route)

    def respond(self, provider: Peer, response: ServiceResponse) -> None:
        """Passes an answer on; one that nobody waits for any more is dropped with a remark."""
        call = self.exchange.request(provider, response.id)
        if call is None or response.id is None:
            return
        self._end(response.id, call)
        values = content(response.values)
        if response.result and not bytes(values).startswith((b"{", b"[")):
            text = f"the answer of {call.offer.name} is no object"
            provider.remark(Level.ERROR, text, response.id)
            _answer_error(call.caller, call.name, call.id, call.route, text)
        elif call.caller is not None:
            answer = ServiceResponse(id=call.id, service=call.name, values=values, result=response.result)
            call.caller.deliver(Outgoing(answer), call.route)

    def leave(self, peer: Peer) -> None:
        """Answers those who wait for a peer that is gone."""
        owed, asked = self.exchange.leave(peer)
        for id, call in asked:
            self._end(id, call)
        for id, call in owed:
            if call.caller is not peer:
                self._end(id, call)
                text = f"the provider of {call.offer.name} is gone"
                _answer_error(call.caller, call.name, call.id, call.route, text)

    def _pass_on(self, caller: Peer, call: CallService, offer: Offer, route: Route) -> None:
        usual_s = self.patience_s.get(resolved(offer.name), self._limits.call_s)
        timeout_s = min(usual_s if call.timeout is None else call.timeout, self._limits.longest_call_s)
        request = _Call(name=call.service, id=call.id, caller=caller, offer=offer, route=route)
        id = self.exchange.begin(request)
        request.timer = self._loop.call_later(timeout_s, self._time_out, id, request, timeout_s)
        forwarded = CallService(id=id, service=offer.name, args=content(call.args), timeout=timeout_s)
        offer.provider.deliver(Outgoing(forwarded), sender=caller)

    def _time_out(self, id: Id, call: _Call, timeout_s: float) -> None:
        self._end(id, call)
        text = f"{call.offer.name} did not answer within {timeout_s:g} s"
        _answer_error(call.caller, call.name, call.id, call.route, text)

    def _end(self, id: Id, call: _Call) -> None:
        call.timer.cancel()
        self.exchange.end(id)


def _answer_error(caller: Peer | None, service: str, id: Id | None, route: Route, text: str) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        caller.deliver(Outgoing(ServiceResponse(id=id, service=service, values=values, result=False)), route)
