"""Who is connected over rosbridge, as the people at the stage see it."""

from __future__ import annotations

from mindstage import KnowledgeBase, NullEngine, Stage
from mindstage.bridge import Client, Hub, Server
from mindstage.ros import RosFace
from mindstage.stage import Guest
from tests.viewport.waiting import wait_until


def test_programs_at_the_hub_are_guests_while_they_are_connected() -> None:
    with Stage(KnowledgeBase(), NullEngine()) as stage, Hub() as hub, Server(hub, port=0) as server:
        face = RosFace(stage, hub)
        assert stage.company.guests() == ()
        client = Client(server.url).wait_connected(30.0)
        client.subscribe("/unreal/clock_of_mine", lambda _: None, type="std_msgs/String")
        client.offer_service("/robot/wave", "std_srvs/Trigger", lambda _: {"success": True, "message": ""})
        heard = "1 topics heard, 1 services offered"
        wait_until(lambda: [guest.activity for guest in stage.company.guests()] == [heard], "the robot is there")
        (guest,) = stage.company.guests()
        assert guest.transport == "ROS"
        client.close()
        wait_until(lambda: stage.company.guests() == (), "the robot is gone")
        face.close()


def test_the_rosbridge_that_a_stage_joined_is_its_guest() -> None:
    with Stage(KnowledgeBase(), NullEngine()) as stage, Hub() as hub:
        server = Server(hub, port=0)
        server.__enter__()
        with Client(server.url) as client:
            client.wait_connected(30.0)
            face = RosFace(stage, client)
            assert stage.company.guests() == (Guest(name=server.url, transport="ROS", activity="connected"),)
            server.close()
            wait_until(lambda: stage.company.guests()[0].activity in {"lost", "connecting"}, "the loss is told")
            face.close()
        assert stage.company.guests() == ()
