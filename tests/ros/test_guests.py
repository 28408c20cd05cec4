"""Who is connected over rosbridge, as the people at the stage see it."""

from __future__ import annotations

from mindstage import KnowledgeBase, NullEngine, Simulation
from mindstage.bridge import LocalNode, RosbridgeClient, RosbridgeServer
from mindstage.ros import RosInterface
from mindstage.simulation import ConnectedClient
from tests.viewer.waiting import wait_until


def test_programs_at_the_hub_are_guests_while_they_are_connected() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as stage, LocalNode() as hub, RosbridgeServer(hub, port=0) as server:
        face = RosInterface(stage, hub)
        assert stage.clients.clients() == ()
        client = RosbridgeClient(server.url).wait_connected(30.0)
        client.subscribe("/unreal/clock_of_mine", lambda _: None, type="std_msgs/String")
        client.create_service("/robot/wave", "std_srvs/Trigger", lambda _: {"success": True, "message": ""})
        heard = "1 subscription, 1 service"
        wait_until(lambda: [guest.activity for guest in stage.clients.clients()] == [heard], "the robot is there")
        (guest,) = stage.clients.clients()
        assert guest.transport == "ROS"
        client.close()
        wait_until(lambda: stage.clients.clients() == (), "the robot is gone")
        face.close()


def test_the_rosbridge_that_a_stage_joined_is_its_guest() -> None:
    with Simulation(KnowledgeBase(), NullEngine()) as stage, LocalNode() as hub:
        server = RosbridgeServer(hub, port=0)
        server.__enter__()
        with RosbridgeClient(server.url) as client:
            client.wait_connected(30.0)
            face = RosInterface(stage, client)
            assert stage.clients.clients() == (ConnectedClient(name=server.url, transport="ROS", activity="connected"),)
            server.close()
            wait_until(lambda: stage.clients.clients()[0].activity in {"lost", "connecting"}, "the loss is told")
            face.close()
        assert stage.clients.clients() == ()
