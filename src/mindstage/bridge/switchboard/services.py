"""Services: a call goes to its provider, the answer back to its caller; every call gets exactly one, in time."""

from __future__ import annotations

import asyncio

import msgspec

from mindstage.bridge.names import resolve_name
from mindstage.bridge.protocol import (
    AdvertiseService,
    BridgeLimits,
    CallService,
    Compression,
    Id,
    MessageEncoder,
    ServiceResponse,
    StatusLevel,
    UnadvertiseService,
    content,
)
from mindstage.bridge.switchboard.exchange import PendingRequest, Provider, ProviderTable
from mindstage.bridge.switchboard.peers import Peer, ReplyFormat
from mindstage.errors import ServiceNotFoundError

__all__ = ["ServiceRouter"]


class _Call(PendingRequest):
    timer: asyncio.TimerHandle


class ServiceRouter:
    """All services at the hub."""

    def __init__(self, loop: asyncio.AbstractEventLoop, limits: BridgeLimits) -> None:
        self.providers: ProviderTable[_Call] = ProviderTable("service", limits)
        self.timeouts_s: dict[str, float] = {}
        """Instead of the limits' `call_timeout_s`, for services that are known to take longer [s]."""
        self._loop = loop
        self._limits = limits

    def advertise(self, peer: Peer, offer: AdvertiseService) -> None:
        """A peer becomes the provider."""
        self.providers.register(peer, offer.service, offer.type)

    def unadvertise(self, peer: Peer, offer: UnadvertiseService) -> None:
        """It is no longer."""
        self.providers.unregister(peer, offer.service)

    def forward_call(self, caller: Peer, call: CallService) -> None:
        """Passes a call on, or answers it with an error."""
        route = ReplyFormat(call.compression or Compression.NONE, call.fragment_size)
        offer = self.providers.find(call.service)
        if offer is None:
            unknown = ServiceNotFoundError(call.service, known=self.providers.names)
            _send_error_response(caller, call.service, call.id, route, str(unknown))
        elif self.providers.request_count(caller) >= self._limits.calls and not caller.is_local:
            _send_error_response(
                caller, call.service, call.id, route, f"{self._limits.calls} of your calls wait already"
            )
        else:
            self._forward(caller, call, offer, route)

    def forward_response(self, provider: Peer, response: ServiceResponse) -> None:
        """Passes an answer on; one that nobody waits for any more is dropped with a remark."""
        call = self.providers.request(provider, response.id)
        if call is None or response.id is None:
            return
        self._end(response.id, call)
        values = content(response.values)
        if response.result and not bytes(values).startswith((b"{", b"[")):
            text = f"the answer of {call.provider.name} is no object"
            provider.send_status(StatusLevel.ERROR, text, response.id)
            _send_error_response(call.caller, call.name, call.id, call.reply_format, text)
        elif call.caller is not None:
            answer = ServiceResponse(id=call.id, service=call.name, values=values, result=response.result)
            call.caller.deliver(MessageEncoder(answer), call.reply_format)

    def remove_peer(self, peer: Peer) -> None:
        """Answers those who wait for a peer that is gone."""
        owed, asked = self.providers.remove_peer(peer)
        for id, call in asked:
            self._end(id, call)
        for id, call in owed:
            if call.caller is not peer:
                self._end(id, call)
                text = f"the provider of {call.provider.name} is gone"
                _send_error_response(call.caller, call.name, call.id, call.reply_format, text)

    def _forward(self, caller: Peer, call: CallService, provider: Provider, reply_format: ReplyFormat) -> None:
        usual_s = self.timeouts_s.get(resolve_name(provider.name), self._limits.call_timeout_s)
        timeout_s = min(usual_s if call.timeout is None else call.timeout, self._limits.max_call_timeout_s)
        request = _Call(name=call.service, id=call.id, caller=caller, provider=provider, reply_format=reply_format)
        id = self.providers.add_request(request)
        request.timer = self._loop.call_later(timeout_s, self._time_out, id, request, timeout_s)
        forwarded = CallService(id=id, service=provider.name, args=content(call.args), timeout=timeout_s)
        provider.peer.deliver(MessageEncoder(forwarded), sender=caller)

    def _time_out(self, id: Id, call: _Call, timeout_s: float) -> None:
        self._end(id, call)
        text = f"{call.provider.name} did not answer within {timeout_s:g} s"
        _send_error_response(call.caller, call.name, call.id, call.reply_format, text)

    def _end(self, id: Id, call: _Call) -> None:
        call.timer.cancel()
        self.providers.pop_request(id)


def _send_error_response(
    caller: Peer | None, service: str, id: Id | None, reply_format: ReplyFormat, text: str
) -> None:
    if caller is not None:
        values = msgspec.Raw(msgspec.json.encode(text))
        caller.deliver(
            MessageEncoder(ServiceResponse(id=id, service=service, values=values, result=False)), reply_format
        )
