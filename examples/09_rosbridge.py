"""Serve a simulation over rosbridge and use it from a client, here in one process."""

import mindstage as ms
from mindstage.bridge import LocalNode, RosbridgeServer
from mindstage.ros import RosInterface

with ms.open("bundled:kitchen") as served, LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
    face = RosInterface(served, hub, namespace="kitchen")
    address = server.url.replace("ws://", "ros://") + "/kitchen"
    with ms.connect(address, "bundled:kitchen") as sim:  # any roslibpy or roslibjs client can call it, too
        print(sim)
        sim.highlight("fridge", "green")
        print(served.state.highlights)
        print(sim.ask("where_is", thing="fridge")[0])
    face.close()
