"""Client and server of the rosbridge v2 protocol, with topics, services and actions."""

from mindstage.bridge.broker import GraphInfo, ProviderInfo, TopicInfo
from mindstage.bridge.calls import ActionHandler, ClientGoalHandle, GoalResult, ServerGoalHandle, ServiceHandler
from mindstage.bridge.client import ConnectionState, Refusal, RosbridgeClient
from mindstage.bridge.node import LocalNode, MessageHandler, Node, Subscription
from mindstage.bridge.protocol import Compression, GoalStatus, Status, StatusLevel
from mindstage.bridge.server import RosbridgeServer

__all__ = [
    "ActionHandler",
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
    "Refusal",
    "RosbridgeClient",
    "RosbridgeServer",
    "ServerGoalHandle",
    "ServiceHandler",
    "Status",
    "StatusLevel",
    "Subscription",
    "TopicInfo",
]

__dir__ = __all__.copy
