"""Remote engines: worlds that run in another process, reached through a rosbridge server.

`connect` creates the engine for an address. The other process is another Mindstage (`MindstageRemoteEngine`), a game
engine that simulates a physics model compiled here (`CompiledRemoteEngine`), or Unreal with its plugin
(`UnrealEngine`).
"""

from __future__ import annotations

from typing import Any

from mindstage.access.limits import Timeout
from mindstage.access.visitors import is_loopback
from mindstage.engines.base import EngineFactory, EngineSettings
from mindstage.engines.remote.client import SCHEME, RemoteProfile, RemoteUrl, ServiceClient
from mindstage.engines.remote.compiled import CompiledRemoteEngine
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.engines.remote.godot import GodotEngine
from mindstage.engines.remote.mindstage import MeshExporter, MindstageRemoteEngine
from mindstage.engines.remote.unreal import UnrealEngine
from mindstage.errors import BridgeError, EngineUnavailableError
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire
from mindstage.ranges import checked

__all__ = [
    "REMOTE_ENGINE",
    "SCHEME",
    "TLS_ENGINE",
    "GodotEngine",
    "RemoteEngine",
    "RemoteProfile",
    "RemoteUrl",
    "connect",
]

_ENGINE_SERVICES = ("/mindstage/describe", "/spawn_semantic_map")
"""Service names, after the namespace, that only an engine has."""


@checked
def connect(
    address: RemoteUrl | str,
    *,
    profile: RemoteProfile | None = None,
    timeout_s: Timeout = 10.0,
    control_time: bool = True,
) -> RemoteEngine:
    """Connects to an engine behind a rosbridge.

    Args:
        address: address of the engine, such as `ros://127.0.0.1:9090/unreal`.
        profile: the set of services to use; by default the one in the address, otherwise the one that is offered there.
        timeout_s: the timeout of the connection and of a call; a spawn has more time, by the size of its world [s].
        control_time: whether simulated time passes there only by `step`, from now until `close`; False observes a
            world that runs by itself. Unreal's time always runs by itself.

    Raises:
        EngineUnavailableError: nothing answers at the address, or no engine does.
    """
    url = RemoteUrl.parse(address) if isinstance(address, str) else address
    profile = profile or url.profile
    client = ServiceClient(url, timeout_s=timeout_s)
    try:
        # In this order, since a Mindstage also offers the services of Unreal's plugin.
        if profile is not RemoteProfile.UNREAL and MindstageRemoteEngine.is_available(client):
            return _mindstage_engine(client, control_time=control_time)
        if profile is not RemoteProfile.MINDSTAGE and UnrealEngine.is_available(client):
            return UnrealEngine(client)
        missing = f"no engine of the profile {profile.value}" if profile else "no engine"
        raise EngineUnavailableError(
            client.name, cause=f"{missing} answers below /{url.namespace} there", remedy=_alternatives(client)
        )
    except BaseException:
        client.close()
        raise


def _make_remote(name: str, settings: EngineSettings) -> RemoteEngine:
    return connect(name, timeout_s=10.0 if settings.timeout_s is None else settings.timeout_s)


REMOTE_ENGINE = EngineFactory(("ros://HOST:PORT/NAMESPACE",), _make_remote)
TLS_ENGINE = EngineFactory(("ros+tls://HOST:PORT/NAMESPACE",), _make_remote)


def _mindstage_engine(client: ServiceClient, *, control_time: bool) -> MindstageRemoteEngine:
    """The engine for a Mindstage, or for an engine that also takes a compiled physics model."""
    name = engine_service(wire.Describe, client.address.namespace)
    description: Any = client.call(name, wire.Describe, wire.Describe.Request())
    engine_class = CompiledRemoteEngine if "plan" in description.takes else MindstageRemoteEngine
    return engine_class(client, control_time=control_time, export_mesh=_mesh_exporter(client.address))


def _mesh_exporter(address: RemoteUrl) -> MeshExporter:
    """Writes mesh files for engines on this machine; others cannot read them."""
    if not is_loopback(address.host):
        return lambda geometry: ""
    from mindstage.assets.cache import cache_geometry_glb

    return cache_geometry_glb


def _alternatives(client: ServiceClient) -> str:
    """A remedy that names the engines found on the server."""
    try:
        names = client.call_raw("/rosapi/services", timeout_s=min(client.timeout_s, 2.0))["services"]
        found = {
            name.removesuffix(suffix).strip("/")
            for name in names
            for suffix in _ENGINE_SERVICES
            if name.endswith(suffix)
        }
    except (BridgeError, KeyError, TypeError, AttributeError):
        found = set()
    if not found:
        return "start mindstage serve there, or connect Unreal's plugin to that rosbridge"
    return f"engines there: {', '.join(f'/{name}' for name in sorted(found))}"
