"""Plugin: the services of Unreal's UROSWorldControl, by the names that it gives them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from mindstage.engines.remote.link import ServiceClient
from mindstage.msgs import Message, Service, snake_case
from mindstage.msgs import world_control_msgs as wire
from mindstage.world import BodyId

__all__ = ["TIMEOUT_PER_ENTITY_S", "UROSWorldControlClient"]

TIMEOUT_PER_ENTITY_S = 0.05
"""So much longer may a call take for each model or constraint that it is about [s]."""
_SERVICE_NAMES: dict[type[Service], str] = {
    wire.SetMaterial: "change_material",
    wire.HighlightModel: "highlight_models",
}
"""Services that are not called after their type."""
_PING_REQUEST = wire.GetModelPose.Request(id="mindstage-ping")


class UROSWorldControlClient:
    """Calls one plugin."""

    def __init__(self, client: ServiceClient) -> None:
        self.client = client

    @property
    def is_available(self) -> bool:
        """Whether anybody at the other end offers its services."""
        return self.client.is_available(self._service_name(wire.GetModelPose), wire.GetModelPose, _PING_REQUEST)

    def call(self, service: type[Service], request: Message, *, entity_count: int = 0) -> Any:
        """Calls one service.

        Args:
            service: which.
            request: every field of it is sent.
            parts: how many models and constraints it is about, and so how long it may take.
        """
        self.client.wait_ready()
        patience_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * entity_count
        return self.client.call(self._service_name(service), service, request, timeout_s=patience_s)

    def call_each(self, service: type[Service], requests: Sequence[Message]) -> Iterator[Any]:
        """Calls one service many times; the responses come in the order of the requests."""
        self.client.wait_ready()
        patience_s = self.client.timeout_s + TIMEOUT_PER_ENTITY_S * len(requests)
        return self.client.call_each(self._service_name(service), service, requests, timeout_s=patience_s)

    def poses(self, ids: Iterable[BodyId]) -> list[wire.GetModelPose.Response]:
        """Where models are; they are read one by one."""
        return list(self.call_each(wire.GetModelPose, [wire.GetModelPose.Request(id=id) for id in ids]))

    def ping(self) -> None:
        """Asks for a sign of life: where somebody is whom nobody knows."""
        self.call(wire.GetModelPose, _PING_REQUEST)

    def delete(self, ids: Iterable[BodyId]) -> tuple[BodyId, ...]:
        """Takes models away; gives those that are still there."""
        wanted = tuple(ids)
        replies = self.call_each(wire.DeleteModel, [wire.DeleteModel.Request(id=id) for id in wanted])
        refused = [id for id, reply in zip(wanted, replies, strict=True) if not reply.success]
        return tuple(id for id, reply in zip(refused, self.poses(refused), strict=True) if reply.success)

    def _service_name(self, service: type[Service]) -> str:
        name = _SERVICE_NAMES.get(service) or snake_case(service)
        return "/".join(("", *filter(None, self.client.address.namespace.split("/")), name))
