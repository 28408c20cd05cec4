"""The clients over rosbridge that a simulation lists."""

from __future__ import annotations

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.ros import RosInterface
from mindstage.simulation import ConnectedClient
from tests.viewer.waiting import wait_until


def test_connected_programs_are_listed_as_clients() -> None:
    with (
        Simulation(KnowledgeBase(), NullEngine()) as simulation,
        LocalNode() as local_node,
        RosbridgeServer(local_node, port=0) as server,
    ):
        ros_interface = RosInterface(simulation, local_node)
        assert simulation.clients.clients() == ()
        client = RosbridgeClient(server.url).wait_connected(30.0)
        client.subscribe("/unreal/clock_of_mine", lambda _: None, type="std_msgs/String")
        client.create_service("/robot/wave", "std_srvs/Trigger", lambda _: {"success": True, "message": ""})
        received = "1 subscription, 1 service"
        wait_until(
            lambda: [client_info.activity for client_info in simulation.clients.clients()] == [received],
            "the client is listed",
        )
        (client_info,) = simulation.clients.clients()
        assert client_info.transport == "ROS"
        client.close()
        wait_until(lambda: simulation.clients.clients() == (), "the client is removed")
        ros_interface.close()


def test_the_server_of_a_remote_node_is_listed_as_a_client() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as simulation, LocalNode() as local_node:
        server = RosbridgeServer(local_node, port=0)
        server.__enter__()
        with RosbridgeClient(server.url) as client:
            client.wait_connected(30.0)
            ros_interface = RosInterface(simulation, client)
            assert simulation.clients.clients() == (
                ConnectedClient(name=server.url, transport="ROS", activity="connected"),
            )
            server.close()
            wait_until(
                lambda: simulation.clients.clients()[0].activity in {"lost", "connecting"}, "the loss is reported"
            )
            ros_interface.close()
        assert simulation.clients.clients() == ()
