"""Connecting to a remote engine: finds out which services an address offers, and makes the engine for them."""

from __future__ import annotations

from typing import Any

from mindstage.bridge.server import is_loopback
from mindstage.engines.remote.client import RemoteProfile, RemoteUrl, ServiceClient
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.engines.remote.mindstage import MeshExporter, MindstageRemoteEngine
from mindstage.engines.remote.unreal import UnrealEngine
from mindstage.errors import BridgeError, EngineUnavailableError
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire

__all__ = ["connect"]

_ENGINE_SERVICES = ("/mindstage/describe", "/spawn_semantic_map")
"""How services end that tell where an engine is."""


def connect(
    address: RemoteUrl | str,
    *,
    profile: RemoteProfile | None = None,
    timeout_s: float = 10.0,
    control_time: bool = True,
) -> RemoteEngine:
    """Connects to an engine behind a rosbridge.

    Args:
        address: such as `ros://127.0.0.1:9090/unreal`.
        profile: the set of services to use; by default the one in the address, otherwise the one that is offered there.
        timeout_s: the timeout of a call; a spawn has more time, by the size of its world [s].
        control_time: whether simulated time passes there only by `step`, from now until `close`; False observes a
            world that runs by itself. Unreal's time always runs by itself.

    Raises:
        EngineUnavailableError: nothing answers at the address, or no engine does.
    """
    url = RemoteUrl.parse(address) if isinstance(address, str) else address
    profile = profile or url.profile
    link = ServiceClient(url, timeout_s=timeout_s)
    try:
        # In this order: a Mindstage answers as Unreal's plugin does, too.
        if profile is not RemoteProfile.UNREAL and MindstageRemoteEngine.is_available(link):
            return _mindstage_engine(link, control_time=control_time)
        if profile is not RemoteProfile.MINDSTAGE and UnrealEngine.is_available(link):
            return UnrealEngine(link)
        what = f"no engine of the profile {profile.value}" if profile else "no engine"
        raise EngineUnavailableError(
            link.name, cause=f"{what} answers below /{url.namespace} there", remedy=_alternatives(link)
        )
    except BaseException:
        link.close()
        raise


def _mindstage_engine(client: ServiceClient, *, control_time: bool) -> MindstageRemoteEngine:
    """The engine of a Mindstage, or one that wants to be told as well what Mindstage decides."""
    name = engine_service(wire.Describe, client.address.namespace)
    far: Any = client.call(name, wire.Describe, wire.Describe.Request())
    kind = CompiledRemoteEngine if "plan" in far.takes else MindstageRemoteEngine
    return kind(client, control_time=control_time, export_mesh=_mesh_exporter(client.address))


def _mesh_exporter(address: RemoteUrl) -> MeshExporter:
    """Files go where whoever is on this machine can read them."""
    if not is_loopback(address.host):
        return lambda form: ""
    from mindstage.assets.cache import cache_geometry_glb

    return cache_geometry_glb


def _alternatives(client: ServiceClient) -> str:
    """What to try, from what the hub says that there is."""
    try:
        names = client.call_raw("/rosapi/services", timeout_s=min(client.timeout_s, 2.0))["services"]
        found = {
            name.removesuffix(sign).strip("/") for name in names for sign in _ENGINE_SERVICES if name.endswith(sign)
        }
    except (BridgeError, KeyError, TypeError, AttributeError):
        found = set()
    if not found:
        return "start mindstage serve there, or let Unreal's plugin join that rosbridge"
    return f"there is one below {', '.join(f'/{name}' for name in sorted(found))}"
