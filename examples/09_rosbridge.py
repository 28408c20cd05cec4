"""Serve a simulation over rosbridge and connect to it as a client, in one process."""

import mindstage as ms
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.ros import RosInterface

with ms.open("bundled:kitchen") as served, LocalNode() as node, RosbridgeServer(node, port=0) as server:
    interface = RosInterface(served, node, namespace="kitchen")
    address = server.url.replace("ws://", "ros://") + "/kitchen"
    with ms.connect(address, "bundled:kitchen") as sim:  # roslibpy and roslibjs clients can call it as well
        print(sim)
        sim.highlight("fridge", "green")
        print(served.state.highlights)
        print(sim.ask("where_is", thing="fridge")[0])
    interface.close()
