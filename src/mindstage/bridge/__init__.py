"""Bridge: the rosbridge v2 protocol and the connection for both of its ends."""

from mindstage.bridge.client import Client, LinkState
from mindstage.bridge.goals import GoalOutcome, SentGoal, ServedGoal
from mindstage.bridge.hub import Hub
from mindstage.bridge.participant import MessageHandler, Participant, Subscription
from mindstage.bridge.protocol import Compression, GoalStatus, Level, Limits, Status
from mindstage.bridge.server import Server
from mindstage.bridge.serving import ActionHandler, ServiceHandler
from mindstage.bridge.switchboard import Directory, Listing, TopicListing

__all__ = [
    "ActionHandler",
    "Client",
    "Compression",
    "Directory",
    "GoalOutcome",
    "GoalStatus",
    "Hub",
    "Level",
    "Limits",
    "LinkState",
    "Listing",
    "MessageHandler",
    "Participant",
    "SentGoal",
    "ServedGoal",
    "Server",
    "ServiceHandler",
    "Status",
    "Subscription",
    "TopicListing",
]
