"""Bridge: the rosbridge v2 protocol and the connection for both of its ends."""

from mindstage.bridge.client import ConnectionState, RosbridgeClient
from mindstage.bridge.goals import ClientGoalHandle, GoalResult, ServerGoalHandle
from mindstage.bridge.hub import LocalNode
from mindstage.bridge.participant import MessageHandler, Node, Subscription
from mindstage.bridge.protocol import BridgeLimits, Compression, GoalStatus, Status, StatusLevel
from mindstage.bridge.server import RosbridgeServer
from mindstage.bridge.serving import ActionHandler, ServiceHandler
from mindstage.bridge.switchboard import GraphInfo, ProviderInfo, TopicInfo

__all__ = [
    "ActionHandler",
    "BridgeLimits",
    "ClientGoalHandle",
    "Compression",
    "ConnectionState",
    "GoalResult",
    "GoalStatus",
    "GraphInfo",
    "LocalNode",
    "MessageHandler",
    "Node",
    "ProviderInfo",
    "RosbridgeClient",
    "RosbridgeServer",
    "ServerGoalHandle",
    "ServiceHandler",
    "Status",
    "StatusLevel",
    "Subscription",
    "TopicInfo",
]
